# Turns lapd.h into C whose debug information holds the whole interface: every function with an
# empty body, and a pointer to every type, so that types which no function names (enums are passed
# as int32_t) are reached too. Rust's own debug information would not do: the release build has line
# tables only.
#
# It relies on the header's form, which cbindgen gives it: comments on lines of their own,
# declarations that begin in column 1.

/^\/\*/ { comment = 1 }
comment { if (/\*\//) comment = 0; next }

/^} lapd_[a-z0-9_]*;$/ {
    type = $2
    sub(/;/, "", type)
    types[++type_count] = type
}

/^[a-z].*lapd_[a-z0-9_]*\(/ && !/^typedef/ { declaration = ""; inside = 1 }
inside { declaration = declaration " " $0 }
inside && /\);$/ {
    inside = 0
    sub(/;$/, "", declaration)
    functions[++function_count] = declaration
}

END {
    print "#include <lapd.h>"
    for (i = 1; i <= type_count; i++)
        print types[i] " *abi_" types[i] ";"
    for (i = 1; i <= function_count; i++)
        print functions[i] (functions[i] ~ /^ *void / ? " {}" : " { return 0; }")
}
