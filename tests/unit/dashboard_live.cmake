add_executable(dashboard_live_test unit/live_test.cc)
target_compile_definitions(dashboard_live_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
target_link_libraries(dashboard_live_test PRIVATE citylearn_dashboard "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
                      OpenCV::core OpenCV::imgcodecs OpenCV::imgproc GTest::gtest_main)
citylearn_tests(dashboard_live_test)
