add_executable(security_test ${CMAKE_CURRENT_LIST_DIR}/security_test.cc)
target_link_libraries(security_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
target_compile_definitions(security_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(security_test PROPERTIES TIMEOUT 120)
