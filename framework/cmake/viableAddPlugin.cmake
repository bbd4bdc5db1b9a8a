include(GNUInstallDirs)

# viable_add_plugin(NAME KIND command|controller|filter|robust_loop|plant SOURCES file... [LIBRARIES library...])
#
# Builds viable_<KIND>_<NAME>.so, a plugin library that `viable` finds by its name, linked to LIBRARIES. The objects also
# stand as the target viable_<KIND>_<NAME>_objects, so that a test can link the class itself. The global property
# VIABLE_PLUGIN_TARGETS lists all libraries, for those that need every plugin built.
function(viable_add_plugin name)
  cmake_parse_arguments(arg "" "KIND" "SOURCES;LIBRARIES" ${ARGN})
  if(NOT arg_KIND MATCHES "^(command|controller|filter|robust_loop|plant)$")
    message(FATAL_ERROR "viable_add_plugin(${name}): KIND must be command, controller, filter, "
                        "robust_loop or plant, not '${arg_KIND}'")
  endif()
  if(NOT arg_SOURCES OR arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "viable_add_plugin(${name}): give SOURCES file... and at most LIBRARIES library... "
                        "(not understood: '${arg_UNPARSED_ARGUMENTS}')")
  endif()
  if(NOT name MATCHES "^[a-z][a-z0-9_]*$")
    message(FATAL_ERROR "viable_add_plugin(${name}): the name must be snake_case")
  endif()
  set(target viable_${arg_KIND}_${name})
  add_library(${target}_objects OBJECT ${arg_SOURCES})
  set_target_properties(${target}_objects PROPERTIES POSITION_INDEPENDENT_CODE ON
    CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  target_link_libraries(${target}_objects PUBLIC viable::viable ${arg_LIBRARIES})
  target_include_directories(${target}_objects PUBLIC ${CMAKE_CURRENT_SOURCE_DIR})

  add_library(${target} MODULE)
  target_link_libraries(${target} PRIVATE ${target}_objects)
  set_target_properties(${target} PROPERTIES PREFIX "" OUTPUT_NAME ${target}
    LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin/plugins)
  target_link_options(${target} PRIVATE -Wl,--no-undefined)
  if(CMAKE_CXX_FLAGS MATCHES "-fsanitize")  # the sanitizer's runtime comes with the program
    target_link_options(${target} PRIVATE -Wl,-z,undefs)
  endif()
  set_property(GLOBAL APPEND PROPERTY VIABLE_PLUGIN_TARGETS ${target})
  install(TARGETS ${target} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/viable/plugins)
endfunction()

# viable_add_plugin_test(NAME KIND kind [SOURCES file...] [PARAMETERS "name: value"...])
#
# Tests of a plugin made by viable_add_plugin, for ctest: the rules that every plugin of its kind keeps (NAME_contract_test,
# which runs the installed program viable_contract), and SOURCES, a GoogleTest with the plugin's own class linked in
# (NAME_test; see viable/testing/PluginBench.h). PARAMETERS gives values to those that have no default, for two joints.
function(viable_add_plugin_test name)
  cmake_parse_arguments(arg "" "KIND" "SOURCES;PARAMETERS" ${ARGN})
  set(plugin viable_${arg_KIND}_${name})
  if(NOT TARGET ${plugin})
    message(FATAL_ERROR "viable_add_plugin_test(${name}): there is no ${arg_KIND} plugin of that name; "
                        "call viable_add_plugin(${name} KIND ...) first")
  endif()
  if(NOT EXISTS "${VIABLE_CONTRACT}")
    message(FATAL_ERROR "viable_add_plugin_test(${name}): ${VIABLE_CONTRACT} is missing: "
                        "viable was built without GoogleTest, which holds the rules of all plugins")
  endif()
  add_test(NAME ${name}_contract_test
    COMMAND ${VIABLE_CONTRACT} $<TARGET_FILE_DIR:${plugin}> ${arg_KIND} ${name} ${arg_PARAMETERS})
  set_tests_properties(${name}_contract_test PROPERTIES FAIL_REGULAR_EXPRESSION "Running 0 tests")
  if(arg_SOURCES)
    find_package(GTest REQUIRED)
    include(GoogleTest)
    add_executable(${name}_test ${arg_SOURCES})
    target_link_libraries(${name}_test PRIVATE ${plugin}_objects GTest::gtest GTest::gtest_main)
    gtest_discover_tests(${name}_test DISCOVERY_MODE PRE_TEST)
  endif()
endfunction()
