add_executable(tsan_reports_test ${CMAKE_CURRENT_LIST_DIR}/tsan_reports_test.cc)
target_link_libraries(tsan_reports_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
target_compile_definitions(tsan_reports_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(tsan_reports_test)
