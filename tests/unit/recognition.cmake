add_executable(recognition_test
  ${CMAKE_CURRENT_LIST_DIR}/recognition_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/seqslam_test.cc)
target_link_libraries(recognition_test PRIVATE citylearn_encoder citylearn_warnings GTest::gtest_main ZLIB::ZLIB)
target_compile_definitions(recognition_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(recognition_test)
