add_executable(image_header_test ${CMAKE_CURRENT_LIST_DIR}/image_header_test.cc)
target_link_libraries(image_header_test PRIVATE citylearn_core citylearn_warnings OpenCV::core OpenCV::imgcodecs GTest::gtest_main)
citylearn_tests(image_header_test)
