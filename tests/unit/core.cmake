add_executable(core_test ${CMAKE_CURRENT_LIST_DIR}/error_test.cc ${CMAKE_CURRENT_LIST_DIR}/messages_test.cc ${CMAKE_CURRENT_LIST_DIR}/registry_test.cc ${CMAKE_CURRENT_LIST_DIR}/transfer_test.cc)
target_link_libraries(core_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
citylearn_tests(core_test)
