add_executable(vpr_tool_test ${CMAKE_CURRENT_LIST_DIR}/vpr_tool_test.cc)
target_link_libraries(vpr_tool_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main nlohmann_json::nlohmann_json
  OpenCV::core OpenCV::imgproc OpenCV::imgcodecs)
target_compile_definitions(vpr_tool_test PRIVATE CITYLEARN_VPR="$<TARGET_FILE:citylearn_vpr>"
  CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
add_dependencies(vpr_tool_test citylearn_vpr)
citylearn_tests(vpr_tool_test)
