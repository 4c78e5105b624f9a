add_executable(paper_test ${CMAKE_CURRENT_LIST_DIR}/paper_beyond_test.cc ${CMAKE_CURRENT_LIST_DIR}/paper_test.cc)
target_link_libraries(paper_test PRIVATE citylearn_paper_parts citylearn_warnings GTest::gtest_main)
citylearn_tests(paper_test)
