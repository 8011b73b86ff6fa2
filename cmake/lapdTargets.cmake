# Makes lapd::lapd and lapd::lapd_static from lapd_include_dir, lapd_shared_path, lapd_static_path,
# lapd_implib_path (Windows), lapd_soname and lapd_native_libs. A library without a path has no
# target.

if(lapd_shared_path AND NOT TARGET lapd::lapd)
    add_library(lapd::lapd SHARED IMPORTED GLOBAL)
    set_target_properties(lapd::lapd PROPERTIES
        IMPORTED_LOCATION "${lapd_shared_path}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}")
    if(lapd_soname)
        set_target_properties(lapd::lapd PROPERTIES IMPORTED_SONAME "${lapd_soname}")
    endif()
    if(lapd_implib_path)
        set_target_properties(lapd::lapd PROPERTIES IMPORTED_IMPLIB "${lapd_implib_path}")
    endif()
endif()

if(lapd_static_path AND NOT TARGET lapd::lapd_static)
    add_library(lapd::lapd_static STATIC IMPORTED GLOBAL)
    set_target_properties(lapd::lapd_static PROPERTIES
        IMPORTED_LOCATION "${lapd_static_path}"
        INTERFACE_INCLUDE_DIRECTORIES "${lapd_include_dir}"
        INTERFACE_LINK_LIBRARIES "${lapd_native_libs}")
endif()
