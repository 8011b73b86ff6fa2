# Makes lapd::lapd and lapd::lapd_static from lapd_include_dir, lapd_shared_path, lapd_static_path,
# lapd_soname and lapd_native_libs.

if(NOT TARGET lapd::lapd)
    add_library(lapd::lapd SHARED IMPORTED GLOBAL)
    set_target_properties(lapd::lapd PROPERTIES
        IMPORTED_LOCATION "${lapd_shared_path}"
        IMPORTED_SONAME "${lapd_soname}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}")
endif()

if(NOT TARGET lapd::lapd_static)
    add_library(lapd::lapd_static STATIC IMPORTED GLOBAL)
    set_target_properties(lapd::lapd_static PROPERTIES
        IMPORTED_LOCATION "${lapd_static_path}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}"
        INTERFACE_LINK_LIBRARIES "${lapd_native_libs}")
endif()
