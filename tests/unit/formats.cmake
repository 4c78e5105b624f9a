add_executable(dataset_formats_test
  ${CMAKE_CURRENT_LIST_DIR}/dataset_formats_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/dataset_formats_test_brisbane.cc
  ${CMAKE_CURRENT_LIST_DIR}/dataset_formats_test_cities.cc)
target_link_libraries(dataset_formats_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
  nlohmann_json::nlohmann_json OpenCV::core OpenCV::imgproc OpenCV::imgcodecs OpenCV::videoio GTest::gtest_main)
target_compile_definitions(dataset_formats_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(dataset_formats_test)
