# SPDX-License-Identifier: Apache-2.0
# citylearn_plugin(NAME FILE...): plugins/NAME.so in the build folder, here and in other repositories after
# find_package(citylearn). It is linked to nothing of this project: the program that loads it has all that, once.
function(citylearn_plugin name)
  add_library(${name} MODULE ${ARGN} ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/../core/plugin/plugin_stamp.cc)
  set_target_properties(${name} PROPERTIES PREFIX "" CXX_EXTENSIONS OFF LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/plugins)
  target_compile_features(${name} PRIVATE cxx_std_20)
  target_include_directories(${name} SYSTEM PRIVATE
    $<TARGET_PROPERTY:citylearn_learning,INTERFACE_INCLUDE_DIRECTORIES>
    $<TARGET_PROPERTY:citylearn_plugin_headers,INTERFACE_INCLUDE_DIRECTORIES>)
  target_compile_definitions(${name} PRIVATE $<TARGET_PROPERTY:citylearn_learning,INTERFACE_COMPILE_DEFINITIONS>)
  target_compile_options(${name} PRIVATE $<TARGET_PROPERTY:citylearn_learning,INTERFACE_COMPILE_OPTIONS>)
  if(TARGET citylearn_interface)  # in this repository
    target_link_libraries(${name} PRIVATE citylearn_warnings)
    add_dependencies(${name} citylearn_interface citylearn_idl)
  endif()
endfunction()
