# Takes the place of catkin's function of this name, which starts Python with setuptools twice for each package: a third of
# the time of the whole build. The result is the same: relays in the devel space, the package in the install space.
# setup.py has to be the one that all packages here have: every package below src/.
function(catkin_python_setup)
  if(NOT _CATKIN_CURRENT_PACKAGE)
    catkin_package_xml()
  endif()
  file(GLOB initialisers CONFIGURE_DEPENDS RELATIVE "${CMAKE_CURRENT_SOURCE_DIR}/src" "${CMAKE_CURRENT_SOURCE_DIR}/src/*/__init__.py")
  set(PACKAGE_PYTHONPATH "${CMAKE_CURRENT_SOURCE_DIR}/src") # the template's
  foreach(initialiser ${initialisers})
    configure_file("${catkin_EXTRAS_DIR}/templates/__init__.py.in"
      "${CATKIN_DEVEL_PREFIX}/${PYTHON_INSTALL_DIR}/${initialiser}" @ONLY)
    get_filename_component(package "${initialiser}" DIRECTORY)
    install(DIRECTORY "src/${package}" DESTINATION "${PYTHON_INSTALL_DIR}" PATTERN __pycache__ EXCLUDE)
  endforeach()
endfunction()
