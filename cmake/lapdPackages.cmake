# cpack: a .tar.gz of the install tree, and Debian packages of its parts. packaging/make.sh makes
# both; each wants a build tree of its own, because Debian's folders depend on the machine's kind.

if(NOT LAPD_INSTALL)
    message(FATAL_ERROR "lapd: packages hold what is installed; set LAPD_INSTALL to ON")
endif()
if(NOT LAPD_BUILD_TOOLS)
    message(FATAL_ERROR "lapd: packages hold mesh_image; set LAPD_BUILD_TOOLS to ON")
endif()
find_package(Python3 QUIET COMPONENTS Interpreter)
if(NOT Python3_FOUND)
    message(FATAL_ERROR
        "lapd: Python 3 was not found; it collects the licences of what is linked "
        "(Debian: python3)")
endif()

# ---- Licences of what is linked, once cargo has fetched it ----

set(lapd_license_features ${lapd_cargo_features})
list(REMOVE_ITEM lapd_license_features --features)
list(JOIN lapd_license_features "," lapd_license_features)
set(lapd_third_party "${lapd_package_dir}/THIRD-PARTY.txt")
set(lapd_rust_notices "${lapd_package_dir}/RUST-STANDARD-LIBRARY.html")
add_custom_command(OUTPUT "${lapd_third_party}"
    COMMAND "${Python3_EXECUTABLE}" "${CMAKE_CURRENT_SOURCE_DIR}/packaging/licenses.py"
        "${lapd_package_dir}" --cargo "${LAPD_CARGO}" --features "${lapd_license_features}"
        ${lapd_cargo_target}
    DEPENDS packaging/licenses.py Cargo.toml Cargo.lock
    BYPRODUCTS "${lapd_rust_notices}"
    COMMENT "Collecting the licences of what is linked"
    VERBATIM)
add_custom_target(lapd_collect_licenses ALL DEPENDS "${lapd_third_party}")
add_dependencies(lapd_collect_licenses lapd_cargo)
install(FILES "${lapd_third_party}" DESTINATION "${CMAKE_INSTALL_DOCDIR}"
        COMPONENT lapd_licenses)
install(FILES "${lapd_rust_notices}" DESTINATION "${CMAKE_INSTALL_DOCDIR}"
        COMPONENT lapd_licenses OPTIONAL)

# ---- Both kinds of packages ----

set(CPACK_GENERATOR TGZ DEB)
set(CPACK_PACKAGE_NAME lapd)
set(CPACK_PACKAGE_VENDOR "The lapd authors")
# The repository has no address yet: who makes packages for others gives one.
set(CPACK_PACKAGE_CONTACT "The lapd authors <nobody@example.invalid>" CACHE STRING
    "Name and address of who makes the packages")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_RESOURCE_FILE_LICENSE "${CMAKE_CURRENT_SOURCE_DIR}/LICENSE-MIT")
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)
string(TOLOWER "${CMAKE_SYSTEM_NAME}" lapd_system)
set(CPACK_PACKAGE_FILE_NAME "lapd-${PROJECT_VERSION}-${lapd_system}-${CMAKE_SYSTEM_PROCESSOR}")

# ---- Debian ----

# The names follow Debian's rules: the library's package is named by the soname.
set(lapd_deb_library "liblapd${lapd_abi}")
set(CPACK_COMPONENTS_ALL lapd_library lapd_development lapd_tools)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SOURCE lapd)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
# dpkg-shlibdeps reads what each file needs. The library itself is in no installed package.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS "${lapd_lib_dir}")

# Debian's lines have 80 columns at most.
set(lapd_deb_description
"lapd turns a segmented 3D image (CT, MRI, micro-CT) into a tetrahedral mesh of
all its labels at once. Neighbouring tissues share the facets of their
interface. Every run checks its own mesh.")

set(CPACK_DEBIAN_LAPD_LIBRARY_PACKAGE_NAME "${lapd_deb_library}")
set(CPACK_DEBIAN_LAPD_LIBRARY_PACKAGE_SECTION libs)
# What is built against one version runs with later ones of the same soname.
set(CPACK_DEBIAN_LAPD_LIBRARY_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY ">=")
set(CPACK_COMPONENT_LAPD_LIBRARY_DESCRIPTION
"${lapd_deb_description}
.
This package has the shared library.")

set(CPACK_DEBIAN_LAPD_DEVELOPMENT_PACKAGE_NAME liblapd-dev)
set(CPACK_DEBIAN_LAPD_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_LAPD_DEVELOPMENT_PACKAGE_DEPENDS
    "${lapd_deb_library} (= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE}), libc6-dev")
set(CPACK_COMPONENT_LAPD_DEVELOPMENT_DESCRIPTION
"${lapd_deb_description}
.
This package has the headers for C and C++, the static library, the CMake
package and the file for pkg-config.")

set(CPACK_DEBIAN_LAPD_TOOLS_PACKAGE_NAME lapd-tools)
set(CPACK_DEBIAN_LAPD_TOOLS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_LAPD_TOOLS_PACKAGE_DEPENDS
    "${lapd_deb_library} (>= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")
set(CPACK_COMPONENT_LAPD_TOOLS_DESCRIPTION
"${lapd_deb_description}
.
This package has the program mesh_image: an image file in, a mesh file and a
report out.")

# Files that Debian wants under the name of each package. cmake --install leaves them out, because
# they are excluded from all; cpack takes the components one by one, and gets them.
foreach(component library development tools)
    string(TOUPPER "${component}" name)
    set(package "${CPACK_DEBIAN_LAPD_${name}_PACKAGE_NAME}")
    install(FILES packaging/debian/copyright DESTINATION "share/doc/${package}"
            COMPONENT lapd_${component} EXCLUDE_FROM_ALL)
    if(NOT component STREQUAL "tools")
        install(FILES "${lapd_third_party}" DESTINATION "share/doc/${package}"
                COMPONENT lapd_${component} EXCLUDE_FROM_ALL)
        install(FILES "${lapd_rust_notices}" DESTINATION "share/doc/${package}"
                COMPONENT lapd_${component} EXCLUDE_FROM_ALL OPTIONAL)
    endif()
endforeach()

include(CPack)
