add_executable(encoders_test ${CMAKE_CURRENT_LIST_DIR}/encoders_test.cc ${CMAKE_CURRENT_LIST_DIR}/reduction_test.cc
                             ${CMAKE_SOURCE_DIR}/tests/contract/encoders_test.cc)
target_link_libraries(encoders_test PRIVATE
  "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_encoder>" citylearn_warnings OpenCV::imgcodecs OpenCV::imgproc GTest::gtest_main)
target_compile_definitions(encoders_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(encoders_test)
