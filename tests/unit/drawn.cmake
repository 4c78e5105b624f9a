add_executable(drawn_test ${CMAKE_CURRENT_LIST_DIR}/dataset_drawn_test.cc)
target_link_libraries(drawn_test PRIVATE
  "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
  OpenCV::core OpenCV::imgproc OpenCV::imgcodecs GTest::gtest_main)
citylearn_tests(drawn_test)
