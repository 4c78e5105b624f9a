# SPDX-License-Identifier: Apache-2.0
# citylearn_delay_loads(PROGRAM ARCHIVE LIBRARY...): PROGRAM loads these shared libraries when ARCHIVE's code first calls them.
# OpenCV's imgcodecs alone brings 130 others, .1 s of each start. citylearn_data is linked with all of them as usual: packages
# and images take from it what the programs need.
function(citylearn_delay_loads program archive)
  if(NOT CMAKE_SYSTEM_PROCESSOR STREQUAL x86_64)
    return()  # the stubs are in its instructions
  endif()
  set(stubs ${CMAKE_CURRENT_BINARY_DIR}/${program}_stubs.cc)
  set(script ${CMAKE_SOURCE_DIR}/cmake/delay_load.py)
  add_custom_command(
    OUTPUT ${stubs}
    COMMAND ${PYTHON3} -B ${script} ${CMAKE_NM} ${CMAKE_READELF} $<TARGET_FILE:${archive}> ${ARGN} > ${stubs}
    DEPENDS ${archive} ${script}
    COMMENT "Making stubs for the libraries that ${program} loads late"
    VERBATIM)
  target_sources(${program} PRIVATE ${stubs})
  target_link_options(${program} PRIVATE LINKER:--as-needed)
endfunction()
