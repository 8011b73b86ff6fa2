# Drops from lapd.h what was appended to structs since the dump was made: awk -f trim.awk DUMP
# lapd.h
#
# By docs/reference/conventions.md structs with a struct_size, and lapd_progress, may grow at their
# end.
# abidiff would call that a change, and its suppressions for members at the end let changed members
# pass too.

FNR == NR {
    if (/<class-decl name=/) {
        match($0, /name='[^']*'/)
        name = substr($0, RSTART + 6, RLENGTH - 7)
    }
    if (/<data-member /)
        released[name]++
    next
}

/^typedef struct \{/ { inside = 1; head = $0; members = 0; next }
inside && /^  [a-z]/ { member[++members] = $0 }
inside && /^} / {
    inside = 0
    name = $2
    sub(/;/, "", name)
    grows = member[1] ~ /struct_size;/ || name == "lapd_progress"
    if (grows && name in released && released[name] < members)
        members = released[name]
    print head
    for (i = 1; i <= members; i++)
        print member[i]
}
inside { next }
{ print }
