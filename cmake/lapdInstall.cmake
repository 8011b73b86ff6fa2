# What is installed. The components are the packages of cmake/lapdPackages.cmake; lapd_licenses
# belongs to trees that are installed or packed as a whole.

install(FILES include/lapd.h include/lapd.hpp DESTINATION "${CMAKE_INSTALL_INCLUDEDIR}"
        COMPONENT lapd_development)
# Debian wants libraries without the right to be executed. CMake knows where that is so.
set(lapd_shared_kind PROGRAMS)
if(LAPD_PACKAGES AND CMAKE_INSTALL_SO_NO_EXE)
    set(lapd_shared_kind FILES)
endif()
install(${lapd_shared_kind} "${lapd_lib_dir}/${lapd_shared}"
        DESTINATION "${lapd_shared_destination}" COMPONENT lapd_library)
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

# cmake --install --strip, and cpack, strip what CMake knows as targets. Libraries that cargo made
# are no targets, so they are stripped here. The static library also holds bitcode of LLVM for
# linking by Rust, which no C linker reads: four fifths of what is left without lines for debuggers.
# On Windows the static library stays as it is: binutils refuse some of its parts.
function(lapd_strip_installed component destination name command)
    set(path "${destination}/${name}")
    if(NOT IS_ABSOLUTE "${destination}")
        set(path "\${CMAKE_INSTALL_PREFIX}/${path}")
    endif()
    list(JOIN command "\" \"" command)
    install(CODE "
if(CMAKE_INSTALL_DO_STRIP)
    execute_process(COMMAND \"${command}\" \"\$ENV{DESTDIR}${path}\" RESULT_VARIABLE result)
    if(NOT result EQUAL 0)
        message(FATAL_ERROR \"lapd: ${name} could not be stripped; install without --strip\")
    endif()
endif()
" COMPONENT ${component})
endfunction()
if(CMAKE_STRIP AND NOT MSVC)
    set(lapd_strip_shared "${CMAKE_STRIP}")
    set(lapd_strip_static "${CMAKE_STRIP}" -S)
    if(APPLE)
        list(APPEND lapd_strip_shared -x)
    elseif(CMAKE_OBJCOPY)
        set(lapd_strip_static "${CMAKE_OBJCOPY}" --strip-debug --remove-section=.llvmbc
            --remove-section=.llvmcmd)
    endif()
    lapd_strip_installed(lapd_library "${lapd_shared_destination}" "${lapd_shared}"
        "${lapd_strip_shared}")
    if(NOT WIN32)
        lapd_strip_installed(lapd_development "${CMAKE_INSTALL_LIBDIR}" "${lapd_static}"
            "${lapd_strip_static}")
    endif()
endif()

if(LAPD_BUILD_TOOLS)
    # mesh_image finds the library from its own place, so that the tree can be moved. In /usr the
    # system finds it. Whoever sets CMAKE_INSTALL_RPATH knows better.
    if(NOT DEFINED CMAKE_INSTALL_RPATH AND NOT CMAKE_INSTALL_PREFIX MATCHES "^/(usr/?)?$")
        file(RELATIVE_PATH lapd_rpath "${CMAKE_INSTALL_FULL_BINDIR}"
            "${CMAKE_INSTALL_FULL_LIBDIR}")
        set(lapd_origin "\$ORIGIN")
        if(APPLE)
            set(lapd_origin "@loader_path")
        endif()
        set_target_properties(lapd_mesh_image PROPERTIES
            INSTALL_RPATH "${lapd_origin}/${lapd_rpath}")
    endif()
    install(TARGETS lapd_mesh_image DESTINATION "${CMAKE_INSTALL_BINDIR}" COMPONENT lapd_tools)
endif()
