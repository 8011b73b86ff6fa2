# What is installed, by component: who wants a part of it names that.

install(FILES include/lapd.h include/lapd.hpp DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}"
        COMPONENT lapd_development)
install(PROGRAMS "${lapd_lib_dir}/${lapd_shared}" DESTINATION "${lapd_shared_destination}"
        COMPONENT lapd_library)
install(FILES "${lapd_lib_dir}/${lapd_static}" DESTINATION "${CMAKE_INSTALL_LIBDIR}"
        COMPONENT lapd_development)
if(lapd_implib)
    install(FILES "${lapd_lib_dir}/${lapd_implib}" DESTINATION "${CMAKE_INSTALL_LIBDIR}"
            COMPONENT lapd_development)
endif()
# The first link has the name that programs look for when they run, the other one is for linkers.
set(lapd_component lapd_library)
foreach(link IN LISTS lapd_shared_links)
    install(FILES "${lapd_lib_dir}/${link}" DESTINATION "${CMAKE_INSTALL_LIBDIR}"
            COMPONENT ${lapd_component})
    set(lapd_component lapd_development)
endforeach()
install(FILES "${lapd_package_dir}/lapd.pc" DESTINATION "${CMAKE_INSTALL_LIBDIR}/pkgconfig"
        COMPONENT lapd_development)
install(FILES "${lapd_package_dir}/lapdConfig.cmake"
        "${lapd_package_dir}/lapdConfigVersion.cmake" cmake/lapdTargets.cmake
        DESTINATION "${lapd_config_dir}" COMPONENT lapd_development)
install(FILES LICENSE-MIT LICENSE-APACHE DESTINATION "${CMAKE_INSTALL_DOCDIR}"
        COMPONENT lapd_licenses)
