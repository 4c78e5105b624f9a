# SPDX-License-Identifier: Apache-2.0
# Most of the compiler's time goes into headers, so files are compiled several at once (CMake calls this a unity build). Names in
# anonymous namespaces must therefore differ within a library or test program.
option(CITYLEARN_MERGED "Compile several files at once: a whole build is faster, one after a small change slower" ON)

# citylearn_merged(TARGET [EXCEPT pattern...]): all files of the target but those whose path matches a pattern: large ones, that
# would keep other processors waiting, and the drawn city, whose pictures must stay the same to the last bit.
function(citylearn_merged target)
  cmake_parse_arguments(PARSE_ARGV 1 merged "" "" "EXCEPT")
  if(NOT CITYLEARN_MERGED)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  get_target_property(sources ${target} SOURCES)
  foreach(pattern ${merged_EXCEPT})
    set(except ${sources})
    list(FILTER except INCLUDE REGEX "${pattern}")
    set_source_files_properties(${except} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  endforeach()
endfunction()

# citylearn_cold(FILE...): command lines and the like, where optimizing takes the compiler time and gives the user nothing. No
# file that has numeric code: of an inline function that others have too, the linker may keep this file's slow copy.
function(citylearn_cold)
  set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS "$<$<CONFIG:Release>:-O1>")
endfunction()

# citylearn_tested(TARGET): the same for a whole test program, whose own code needs half the time of the compiler then. Products
# and sums are contracted as in the libraries: GCC does so from -O2 on, else with the second option.
function(citylearn_tested target)
  target_compile_options(${target} PRIVATE
    $<$<CONFIG:Release>:-O1> $<$<AND:$<CONFIG:Release>,$<CXX_COMPILER_ID:GNU>>:-fexpensive-optimizations>)
endfunction()
