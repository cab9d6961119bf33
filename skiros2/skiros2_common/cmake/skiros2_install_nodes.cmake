# skiros2_install_nodes(nodes/a nodes/b ...)
#
# Installs Python programs so that `rosrun` and `roslaunch` find them, in the devel and in the install space. In both,
# the first line names the very interpreter that catkin was configured with (-DPYTHON_EXECUTABLE=...), because the
# first `python3` on a user's PATH may be one that has neither ROS nor the libraries that a node needs.
# (catkin_install_python writes only "env python3" into the install space.)
#
# Call it after catkin_package(). Packages that find_package(catkin ... COMPONENTS skiros2_skill) may use it too.
function(skiros2_install_nodes)
  foreach(node ${ARGN})
    set(source "${CMAKE_CURRENT_SOURCE_DIR}/${node}")
    if(NOT EXISTS "${source}")
      message(FATAL_ERROR "${PROJECT_NAME}: there is no ${source} to install")
    endif()
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${source}")
    get_filename_component(name "${node}" NAME)
    file(READ "${source}" text)
    string(REGEX REPLACE "^#![^\n]*" "#!${PYTHON_EXECUTABLE}" text "${text}")
    set(script "${CMAKE_CURRENT_BINARY_DIR}/nodes/${name}")
    file(WRITE "${script}" "${text}")
    catkin_install_python(PROGRAMS "${script}" DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  endforeach()
endfunction()

# skiros2_also_in(package DIRECTORIES launch ... PROGRAMS nodes/a ...)
#
# Lets `rosrun`, `roslaunch` and `$(find ...)` find folders and programs, which skiros2_install_nodes has installed, in
# another package too, in the devel and in the install space.
function(skiros2_also_in package)
  cmake_parse_arguments(also "" "" "DIRECTORIES;PROGRAMS" ${ARGN})
  install(DIRECTORY ${also_DIRECTORIES} DESTINATION ${CATKIN_GLOBAL_SHARE_DESTINATION}/${package})
  foreach(folder ${also_DIRECTORIES})
    set(share "${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_SHARE_DESTINATION}/${package}")
    file(MAKE_DIRECTORY "${share}")
    file(CREATE_LINK "${CMAKE_CURRENT_SOURCE_DIR}/${folder}" "${share}/${folder}" SYMBOLIC)
  endforeach()
  foreach(program ${also_PROGRAMS})
    get_filename_component(name "${program}" NAME)
    catkin_install_python(PROGRAMS "${CMAKE_CURRENT_BINARY_DIR}/nodes/${name}"
      DESTINATION ${CATKIN_GLOBAL_LIBEXEC_DESTINATION}/${package})
  endforeach()
endfunction()
