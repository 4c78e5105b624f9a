add_executable(parts_test ${CMAKE_CURRENT_LIST_DIR}/parts_test.cc ${CMAKE_CURRENT_LIST_DIR}/parts_images_test.cc)
target_link_libraries(parts_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
  OpenCV::core OpenCV::imgproc OpenCV::imgcodecs OpenCV::videoio GTest::gtest_main)
target_compile_definitions(parts_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(parts_test)
