# Each format is read by somebody else's reader: OpenCV's and the ONNX project's, perl's, protobuf's.
find_program(PERL perl REQUIRED)
add_executable(interchange_test
  ${CMAKE_CURRENT_LIST_DIR}/event_log_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/onnx_export_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/safetensors_test.cc)
target_compile_definitions(interchange_test PRIVATE CITYLEARN_PERL="${PERL}" CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
target_link_libraries(interchange_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_interchange>" citylearn_warnings
                      OpenCV::core OpenCV::dnn onnx protobuf::libprotobuf GTest::gtest_main)
add_dependencies(interchange_test policy_service)
citylearn_tests(interchange_test)
