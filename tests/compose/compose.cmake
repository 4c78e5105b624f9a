# compose/: its files as far as a machine without an engine can tell, and each topology run in network namespaces.
# Debian's own Python, which has python3-yaml; each test says why it skips (77) where something is missing.
find_program(CITYLEARN_PYTHON python3 PATHS /usr/bin NO_DEFAULT_PATH)
if(NOT CITYLEARN_PYTHON)
  message(STATUS "compose/ is not tested: /usr/bin/python3 is missing (packages python3 and python3-yaml)")
  return()
endif()
if(CMAKE_CXX_FLAGS MATCHES "-fsanitize")
  message(STATUS "compose/ is not tested under sanitizers: its services have the files' environment alone, not theirs")
  return()
endif()
set(prefix ${CMAKE_CURRENT_BINARY_DIR}/compose/prefix)
add_test(NAME compose_install COMMAND ${CMAKE_COMMAND} --install ${CMAKE_BINARY_DIR} --prefix ${prefix})
set_tests_properties(compose_install PROPERTIES FIXTURES_SETUP compose_prefix)
foreach(part files engine single_node scale_out multi_host secure slurm)
  add_test(NAME compose_${part}
    COMMAND ${CITYLEARN_PYTHON} -B ${CMAKE_SOURCE_DIR}/tests/compose/${part}_test.py ${prefix})
  set_tests_properties(compose_${part} PROPERTIES
    SKIP_RETURN_CODE 77 TIMEOUT 300 RUN_SERIAL ON FIXTURES_REQUIRED compose_prefix)
endforeach()
