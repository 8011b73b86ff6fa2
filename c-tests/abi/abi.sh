#!/bin/sh
# The binary interface against that of the last release: what was in it must still be there,
# unchanged; additions are fine.
#
#   sh abi.sh check SOURCE INSTALLED WORK    compares, and proves that the comparison notices what
#                                            it should
#   sh abi.sh update SOURCE INSTALLED WORK   at a release: writes the dump
#                                            c-tests/abi/lapd-MAJOR.MINOR.abi, to be committed
#
# The dumps come from a stub library made of the header (see stub.awk); that the real library
# exports the same functions is checked beside.
set -eu
command=$1 source=$2 installed=$3 work=$4
here=$source/c-tests/abi
rm -rf "$work"
mkdir -p "$work"

for tool in abidw abidiff; do
    command -v $tool >/dev/null 2>&1 || {
        echo "SKIPPED: the comparison of binary interfaces;" \
            "$tool is missing (Debian: abigail-tools)"
        exit 0
    }
done
# Sizes and names of types are those of one architecture.
[ "$(uname -m)" = x86_64 ] || {
    echo "SKIPPED: the comparison of binary interfaces, which is for x86_64"
    exit 0
}

version=$(sed -n 's/^version = "\([0-9]*\.[0-9]*\)\..*/\1/p' "$source/Cargo.toml" | head -n 1)
soname=$(readelf -d "$installed/lib/liblapd.so" | sed -n 's/.*(SONAME).*\[\(.*\)\]/\1/p')
dump=$here/lapd-$version.abi

# stub NAME: the stub library of the header $work/NAME/lapd.h, as far as its structs were released.
stub() {
    awk -f "$here/stub.awk" "$work/$1/lapd.h" >"$work/$1/stub.c"
    mkdir "$work/$1/released"
    if [ "$command" = update ]; then
        cp "$work/$1/lapd.h" "$work/$1/released/"
    else
        awk -f "$here/trim.awk" "$dump" "$work/$1/lapd.h" >"$work/$1/released/lapd.h"
    fi
    # By relative names: the dump holds them.
    (cd "$work/$1" && cc -std=c11 -g -fPIC -shared -w -Ireleased stub.c -Wl,-soname,"$soname" -o \
        liblapd.so)
}

# compare NAME: abidiff's answer about it.
compare() {
    abidiff --no-added-syms "$dump" "$work/$1/liblapd.so"
}

functions() {
    nm -D --defined-only "$1" | awk '$2 == "T" { print $3 }' | sort
}

[ "$command" = update ] || [ -e "$dump" ] || {
    echo "there is no $dump: a release makes it, see CONTRIBUTING.md"
    exit 1
}
mkdir "$work/now"
# One line for each function, for the changes below: where cbindgen breaks lines depends on the
# comments.
awk '
    joined == "" && /^[a-z].*lapd_[a-z0-9_]*\(/ && !/;$/ { joined = $0; next }
    joined != "" { sub(/^ */, " "); joined = joined $0; if (/;$/) { print joined; joined = "" }; \
        next }
    { print }' "$installed/include/lapd.h" >"$work/now/lapd.h"
stub now
functions "$work/now/liblapd.so" >"$work/declared"
functions "$installed/lib/liblapd.so" >"$work/exported"
diff "$work/declared" "$work/exported" || {
    echo "the functions of the header (<) are not those of the library (>)"
    exit 1
}

if [ "$command" = update ]; then
    abidw --no-show-locs --no-comp-dir-path --no-corpus-path --type-id-style hash \
        "$work/now/liblapd.so" >"$dump"
    echo "wrote $dump"
    exit 0
fi

compare now || {
    echo "the binary interface is not that of $dump any more;" \
            "programs linked against $version would break"
    exit 1
}

# The comparison is worth something only if it notices. change NAME SED_SCRIPT: the header with a
# change in it.
change() {
    mkdir "$work/$1"
    sed "$2" "$work/now/lapd.h" >"$work/$1/lapd.h"
    if cmp -s "$work/now/lapd.h" "$work/$1/lapd.h"; then
        echo "the change $1 does not fit the header any more"
        exit 1
    fi
    stub "$1"
}
must_fail() {
    change "$@"
    if compare "$1" >"$work/$1/report"; then
        echo "abidiff did not notice: $1"
        exit 1
    fi
}
must_pass() {
    change "$@"
    compare "$1" || {
        echo "abidiff refuses what is allowed: $1"
        exit 1
    }
}
must_fail member_type 's/^  uint64_t tissue_tets;/  uint32_t tissue_tets;/'
must_fail last_member_type 's/^  uint64_t components_mesh;/  uint32_t components_mesh;/'
must_fail last_member_removed '/^  uint64_t components_mesh;/d'
must_fail member_removed '/^  uint64_t tissue_tets;/d'
must_fail member_inserted 's/^  uint64_t vertices;/  uint64_t before; &/'
must_fail parameter_type 's/\(lapd_params_set_delta(.*\)double delta/\1float delta/'
must_fail parameter_added 's/\(lapd_params_set_delta(.*\)double delta/&, int more/'
must_fail return_type 's/^void lapd_mesh_free/int lapd_mesh_free/'
must_fail function_removed '/^lapd_status lapd_params_set_delta/d'
must_fail enum_value 's/LAPD_VOXEL_I16 = 3/LAPD_VOXEL_I16 = 30/'
must_fail enum_value_removed '/LAPD_ERROR_BUSY = 11/d'
must_fail callback_type \
    's/int32_t (\*lapd_progress_fn)(void \*user/int64_t (*lapd_progress_fn)(void *user/'
must_pass function_added 's/^void lapd_mesh_free/int lapd_mesh_new(void);\n&/'
must_pass enum_value_added 's/LAPD_ERROR_BUSY = 11,/& LAPD_ERROR_NEW = 99,/'
must_pass member_added 's/^} lapd_counts;/  uint64_t more;\n&/'
must_fail member_added_and_changed \
    's/^} lapd_counts;/  uint64_t more;\n&/; s/^  uint64_t tissue_tets;/  uint32_t tissue_tets;/'
must_pass type_added 's/^} lapd_counts;/&\ntypedef struct {\n  int value;\n} lapd_new;/'
