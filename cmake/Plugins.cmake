# SPDX-License-Identifier: Apache-2.0
# Plug-ins loaded at run time (docs/how-to/load-a-plugin.md).
set(CITYLEARN_PLUGINS "" CACHE STRING "Plug-ins of your own: NAME.cc, or a folder whose CMakeLists.txt calls citylearn_plugin; a;b;c")

# One hash of all headers that a plug-in and a program must agree on; only a changed hash compiles anything anew.
file(GLOB_RECURSE headers CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/core/*.h ${CMAKE_SOURCE_DIR}/core/*.inc ${CMAKE_SOURCE_DIR}/policy_service/network/*.h
  ${CMAKE_SOURCE_DIR}/policy_service/rollout/*.h ${CMAKE_SOURCE_DIR}/policy_service/learning/*.h
  ${CMAKE_SOURCE_DIR}/encoder_service/encoding/*.h ${CMAKE_SOURCE_DIR}/env_service/dataset_io/*.h
  ${CMAKE_SOURCE_DIR}/env_service/traversal/*.h ${CMAKE_SOURCE_DIR}/env_service/files/*.h ${CMAKE_SOURCE_DIR}/env_service/geometry/*.h
  ${CMAKE_SOURCE_DIR}/env_service/images/*.h ${CMAKE_SOURCE_DIR}/idl/*.idl)
list(JOIN headers "," inputs)
set(interface ${CMAKE_BINARY_DIR}/generated/core/plugin/plugin_interface.h)
add_custom_command(
  OUTPUT ${interface}
  COMMAND ${CMAKE_COMMAND} -DOUTPUT=${interface} -DINPUTS=${inputs} "-DALSO=Eigen ${Eigen3_VERSION}" -P ${CMAKE_SOURCE_DIR}/cmake/interface_hash.cmake
  DEPENDS ${headers} ${CMAKE_SOURCE_DIR}/cmake/interface_hash.cmake
  COMMENT "Hashing what plug-ins are built against"
  VERBATIM)
add_custom_target(citylearn_interface DEPENDS ${interface})

# citylearn_takes_plugins(PROGRAM): its registries are seen by plug-ins.
function(citylearn_takes_plugins program)
  target_link_options(${program} PRIVATE "LINKER:--dynamic-list=${CMAKE_SOURCE_DIR}/cmake/plugins.list")
  set_property(TARGET ${program} APPEND PROPERTY LINK_DEPENDS ${CMAKE_SOURCE_DIR}/cmake/plugins.list)
endfunction()

# What every kind of plug-in includes beyond the headers of citylearn_learning: encoders and datasets take OpenCV's pictures.
add_library(citylearn_plugin_headers INTERFACE)
target_include_directories(citylearn_plugin_headers SYSTEM INTERFACE ${OpenCV_INCLUDE_DIR})
include(cmake/PluginTarget.cmake)

foreach(plugin ${CITYLEARN_PLUGINS})
  get_filename_component(plugin ${plugin} ABSOLUTE BASE_DIR ${CMAKE_SOURCE_DIR})
  get_filename_component(name ${plugin} NAME_WE)
  if(IS_DIRECTORY ${plugin})
    add_subdirectory(${plugin} ${CMAKE_BINARY_DIR}/plugins/${name}.build)
  elseif(EXISTS ${plugin})
    citylearn_plugin(${name} ${plugin})
  else()
    message(FATAL_ERROR "CITYLEARN_PLUGINS: there is no ${plugin}")
  endif()
endforeach()
