add_executable(node_test ${CMAKE_CURRENT_LIST_DIR}/node_test.cc)
target_link_libraries(node_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
citylearn_tests(node_test)
