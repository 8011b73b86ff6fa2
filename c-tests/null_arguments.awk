# Writes calls of every function of lapd.h with each of its pointers NULL, one at a time, for
# test_null.c to include: awk -v out=FILE -f null_arguments.awk lapd.h
#
# New functions are covered as they appear in the header. Where the header allows NULL, that is said
# here.
#
# It relies on the header's form, which cbindgen gives it: comments on lines of their own,
# declarations that begin in column 1.

BEGIN {
    allowed["lapd_image_create strides"]
    allowed["lapd_image_create direction"]
    allowed["lapd_image_create_gray strides"]
    allowed["lapd_image_create_gray direction"]
    allowed["lapd_image_create_gray labels"]
    allowed["lapd_image_create_probabilities strides"]
    allowed["lapd_image_create_probabilities direction"]
    allowed["lapd_image_create_level_sets strides"]
    allowed["lapd_image_create_level_sets direction"]
    allowed["lapd_image_read_labels layer_order"]
    allowed["lapd_mesh_write_with options"]
    allowed["lapd_mesh_write_report extra"]
    allowed["lapd_image_read_gray labels"]
    allowed["lapd_image_read_probabilities labels"]
    allowed["lapd_image_read_level_sets labels"]
}

/^\/\*/ { comment = 1 }
comment { if (/\*\//) comment = 0; next }
/^[a-z].*lapd_[a-z0-9_]*\(/ && !/^typedef/ { declaration = ""; inside = 1 }
inside { declaration = declaration " " $0 }
inside && /\);$/ { inside = 0; calls(declaration) }
END { print "#define FUNCTIONS " functions > out }

function may_be_null(name, type, parameter) {
    return name ~ /_free$/ || type ~ /_fn$/ || type == "void *" || (name " " parameter) in allowed
}

# Something that the function takes, so that nothing but the NULL is wrong.
function valid(type, parameter,    base) {
    base = type
    sub(/^const /, "", base)
    if (base ~ /^lapd_(context|image|params|mesh|write_options) \*$/) {
        sub(/^lapd_/, "", base)
        sub(/ \*$/, "", base)
        return base
    }
    if (type == "const char *")
        return "\"null.vtu\""
    if (type == "const void *")
        return "ones"
    if (type ~ /^lapd_.* \*\*$/) {
        sub(/^lapd_/, "", type)
        sub(/ \*\*$/, "", type)
        return "&made_" type
    }
    if (type ~ /\*const \*$/) {
        sub(/ \*const \*$/, " *", type)
        return "(" type "const[16]){" valid(type, parameter) "}"
    }
    if (type ~ /\*\*$/) {
        sub(/ \*\*$/, " *", type)
        return "&(" type "){NULL}"
    }
    if (base ~ /^lapd_.*\*$/) {
        sub(/ \*$/, "", base)
        return "&(" base "){.struct_size = sizeof(" base ")}"
    }
    if (base ~ /\*$/) {
        sub(/ \*$/, "", base)
        return "(" base "[16]){1, 1, 1, 1, 1, 1, 1, 1, 1}"
    }
    return parameter == "index" ? "0" : "1"
}

function calls(text,    name, list, count, i, k, types, names, arguments, is_null, told) {
    name = text
    sub(/\(.*/, "", name)
    sub(/.*[ *]/, "", name)
    list = text
    sub(/^[^(]*\(/, "", list)
    sub(/\);$/, "", list)
    functions++
    if (list == "void")
        return
    count = split(list, names, / *, */)
    for (i = 1; i <= count; i++) {
        types[i] = names[i]
        sub(/[a-z0-9_]*$/, "", types[i])
        sub(/ $/, "", types[i])
        sub(/.*[ *]/, "", names[i])
    }
    for (k = 1; k <= count; k++) {
        if (types[k] !~ /\*$/)
            continue
        arguments = ""
        for (i = 1; i <= count; i++) {
            arguments = arguments (i > 1 ? ", " : "")
            is_null = i == k || may_be_null(name, types[i], names[i])
            arguments = arguments (is_null ? "NULL" : valid(types[i], names[i]))
        }
        if (text !~ /^ *lapd_status / || may_be_null(name, types[k], names[k]))
            print "SURVIVES(" name "(" arguments "));" > out
        else {
            told = list ~ /^lapd_context \*context/ && k > 1 ? "\"" names[k] "\"" : "NULL"
            print "REFUSES(" told ", " name "(" arguments "));" > out
        }
    }
}
