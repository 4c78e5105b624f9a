add_executable(learners_test ${CMAKE_CURRENT_LIST_DIR}/learners_test.cc)
target_link_libraries(learners_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>" citylearn_env
  citylearn_warnings GTest::gtest_main)
citylearn_tests(learners_test)
