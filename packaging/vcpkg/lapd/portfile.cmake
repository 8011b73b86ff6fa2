# Port for vcpkg, to be used as an overlay port:
#
#   vcpkg install lapd --overlay-ports=packaging/vcpkg
#
# NEVER RUN: vcpkg was not at hand, and there is no release yet. Fill in what is marked
# PLACEHOLDER.
#
# vcpkg's own registry takes no ports that need Rust: vcpkg brings no Rust toolchain, and ports may
# not take files from the network by other means than its own (microsoft/vcpkg, issue 20619 and pull
# request 30251, both open). So this port wants cargo on the machine, and lets it take the crates
# from crates.io; Cargo.lock has their hashes. On Windows vcpkg hides most of the environment:
# VCPKG_KEEP_ENV_VARS=CARGO_HOME;RUSTUP_HOME shows it where cargo is, if it is not in the usual
# folder.

# Both libraries side by side are against vcpkg's rules. Rust links the C runtime as a .dll.
vcpkg_check_linkage(ONLY_DYNAMIC_LIBRARY ONLY_DYNAMIC_CRT)

find_program(CARGO cargo
    HINTS "$ENV{CARGO_HOME}/bin" "$ENV{HOME}/.cargo/bin" "$ENV{USERPROFILE}/.cargo/bin" NO_CACHE)
if(NOT CARGO)
    message(FATAL_ERROR
        "${PORT}: cargo was not found; install a Rust toolchain, 1.92 or later "
        "(https://rustup.rs)")
endif()

# Rust's words for the triplet.
if(VCPKG_TARGET_ARCHITECTURE STREQUAL "x64")
    set(rust_target x86_64)
elseif(VCPKG_TARGET_ARCHITECTURE STREQUAL "arm64")
    set(rust_target aarch64)
else()
    message(FATAL_ERROR "${PORT}: x64 and arm64 only, not ${VCPKG_TARGET_ARCHITECTURE}")
endif()
if(VCPKG_TARGET_IS_MINGW)
    string(APPEND rust_target -pc-windows-gnu)
elseif(VCPKG_TARGET_IS_WINDOWS)
    string(APPEND rust_target -pc-windows-msvc)
elseif(VCPKG_TARGET_IS_OSX)
    string(APPEND rust_target -apple-darwin)
else()
    string(APPEND rust_target -unknown-linux-gnu)
endif()

# PLACEHOLDER: owner of the repository, and hash of the release.
vcpkg_from_github(
    OUT_SOURCE_PATH SOURCE_PATH
    REPO OWNER/lapd
    REF "v${VERSION}"
    SHA512 0
    HEAD_REF main
)

# The interface is C, and cargo's debug build is for those who change lapd: one build serves both.
set(VCPKG_BUILD_TYPE release)
set(VCPKG_POLICY_MISMATCHED_NUMBER_OF_BINARIES enabled)

vcpkg_cmake_configure(
    SOURCE_PATH "${SOURCE_PATH}"
    OPTIONS
        "-DLAPD_CARGO=${CARGO}"
        "-DLAPD_RUST_TARGET=${rust_target}"
        -DLAPD_BUILD_TOOLS=OFF
        -DLAPD_HWLOC=OFF
)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/lapd)
vcpkg_fixup_pkgconfig()

# The shared library is what the triplet asked for. lapdConfig.cmake then has no lapd::lapd_static.
file(REMOVE
    "${CURRENT_PACKAGES_DIR}/lib/liblapd.a"
    "${CURRENT_PACKAGES_DIR}/lib/lapd.lib")
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/share/doc")

file(INSTALL "${CMAKE_CURRENT_LIST_DIR}/usage" DESTINATION "${CURRENT_PACKAGES_DIR}/share/${PORT}")
vcpkg_install_copyright(
    COMMENT "lapd is under MIT or Apache-2.0, at your option. Crates that are linked in are under \
permissive licences: packaging/licenses.py lists them."
    FILE_LIST "${SOURCE_PATH}/LICENSE-MIT" "${SOURCE_PATH}/LICENSE-APACHE"
)
