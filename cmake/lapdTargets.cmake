# Makes lapd::lapd and lapd::lapd_static from lapd_include_dir, lapd_shared_path, lapd_static_path and lapd_soname.

if(NOT TARGET lapd::lapd)
    add_library(lapd::lapd SHARED IMPORTED GLOBAL)
    set_target_properties(lapd::lapd PROPERTIES
        IMPORTED_LOCATION "${lapd_shared_path}"
        IMPORTED_SONAME "${lapd_soname}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}")
endif()

if(NOT TARGET lapd::lapd_static)
    add_library(lapd::lapd_static STATIC IMPORTED GLOBAL)
    # The system's libraries are those that `rustc --print native-static-libs` names.
    set_target_properties(lapd::lapd_static PROPERTIES
        IMPORTED_LOCATION "${lapd_static_path}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}"
        INTERFACE_LINK_LIBRARIES "gcc_s;util;rt;pthread;m;dl")
endif()
