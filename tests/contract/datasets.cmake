add_executable(datasets_test ${CMAKE_CURRENT_LIST_DIR}/datasets_test.cc)
target_link_libraries(datasets_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
  GTest::gtest_main)
citylearn_tests(datasets_test)
