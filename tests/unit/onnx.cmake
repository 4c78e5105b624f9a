add_executable(onnx_test
  ${CMAKE_CURRENT_LIST_DIR}/onnx_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/netvlad_test.cc)
target_link_libraries(onnx_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_encoder>" citylearn_warnings
  nlohmann_json::nlohmann_json OpenCV::imgproc OpenCV::dnn GTest::gtest_main)
target_compile_definitions(onnx_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(onnx_test)
