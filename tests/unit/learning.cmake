add_executable(learning_test
  ${CMAKE_CURRENT_LIST_DIR}/checkpoint_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/gradient_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/roles_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/trainer_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/vtrace_test.cc)
target_link_libraries(learning_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>" citylearn_env citylearn_warnings
                      GTest::gtest_main)
citylearn_tests(learning_test)
