# The Debian packages (tools/scripts/package.sh), for the Debian that they were built on: a plugin must meet the same compiler
# and Eigen as the program. libviable: what plugins and own loops need: library, headers, CMake files, examples, robots.
# viable: program, plugins, experiments, templates. python3-viable: the Python package, where it is built.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME viable)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "viable developers <developers@viable.invalid>")  # Debian wants an address; there is none yet
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "joint limits up to jerk for torque-controlled robot arms")
set(CPACK_PACKAGE_DESCRIPTION
"viable takes the torque of any controller and changes it as little as needed
to keep joint position, velocity, acceleration and jerk limits at 1 kHz; a
robust inner loop makes the real arm follow. Controllers, safety filters,
robust loops, command sources and plants are plugins, named in an experiment
file and loaded at run time. Every limit that a law misses is counted.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_COMPONENTS_ALL library Unspecified)  # the second: what install() names no component for
set(CPACK_COMPONENT_UNSPECIFIED_DESCRIPTION "${CPACK_PACKAGE_DESCRIPTION}")
set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_NAME viable)
set(CPACK_DEBIAN_UNSPECIFIED_FILE_NAME DEB-DEFAULT)  # viable_0.1.0_amd64.deb
set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_DEPENDS "libviable (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libviable)
set(CPACK_DEBIAN_LIBRARY_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_LIBRARY_DESCRIPTION "The library behind viable: guards for control loops of one's own, and what plugins
are built with. Headers, CMake files, examples and robots are included.")
if(TARGET viable_python_module)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-viable)
  set(CPACK_DEBIAN_PYTHON_FILE_NAME DEB-DEFAULT)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  math(EXPR next "${VIABLE_PYTHON_MINOR} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "viable (= ${PROJECT_VERSION}), python3-numpy, \
python3 (>= 3.${VIABLE_PYTHON_MINOR}~), python3 (<< 3.${next})")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "python3-pandas, python3-matplotlib")
  set(CPACK_COMPONENT_PYTHON_DESCRIPTION "This is viable for Python: guards for learned policies, one arm or thousands
at once, runs of experiments as functions and their logs as numpy arrays.")
  install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-viable COMPONENT python)
  install(DIRECTORY tools/python/examples DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-viable COMPONENT python)
  install(FILES tools/python/README.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-viable COMPONENT python)
endif()
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_LIBRARY_OUTPUT_DIRECTORY})  # libviable itself
# Who links to libviable depends on its package; the library is made known to the dynamic linker.
file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/package/shlibs @ONLY
  CONTENT "libviable @PROJECT_VERSION_MAJOR@.@PROJECT_VERSION_MINOR@ libviable (>= @PROJECT_VERSION@)\n")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA ${CMAKE_BINARY_DIR}/package/shlibs ${CMAKE_CURRENT_LIST_DIR}/triggers)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_RECOMMENDS "cmake (>= 3.25), g++, libeigen3-dev (>= 3.4)")  # plugins and loops of one's own
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SUGGESTS "libgtest-dev")  # and their tests
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
include(CPack)
install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/viable)
install(FILES ${CMAKE_CURRENT_LIST_DIR}/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libviable COMPONENT library)
foreach(pair viable:Unspecified libviable:library)
  string(REPLACE ":" ";" pair ${pair})
  list(GET pair 0 package)
  list(GET pair 1 component)
  install(FILES ${CMAKE_CURRENT_LIST_DIR}/${package}.lintian-overrides DESTINATION ${CMAKE_INSTALL_DATADIR}/lintian/overrides
    RENAME ${package} COMPONENT ${component})
endforeach()

add_custom_target(viable_package
  COMMAND ${CMAKE_CPACK_COMMAND} -G DEB --config ${CMAKE_BINARY_DIR}/CPackConfig.cmake -B ${CMAKE_BINARY_DIR}
  DEPENDS viable_app
  WORKING_DIRECTORY ${CMAKE_BINARY_DIR} VERBATIM)
if(TARGET viable_python_module)
  add_dependencies(viable_package viable_python_module)
endif()
