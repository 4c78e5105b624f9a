add_executable(env_system_test
  ${CMAKE_CURRENT_LIST_DIR}/env_protocol_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/env_process_test.cc)
target_link_libraries(env_system_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings GTest::gtest_main)
add_dependencies(env_system_test env_service)
citylearn_tests(env_system_test PROPERTIES TIMEOUT 120 PROCESSORS 2)
