add_executable(data_tool_test ${CMAKE_CURRENT_LIST_DIR}/nordland_test.cc ${CMAKE_CURRENT_LIST_DIR}/inspection_test.cc)
target_link_libraries(data_tool_test PRIVATE citylearn_inspection "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>"
  citylearn_warnings nlohmann_json::nlohmann_json OpenCV::core OpenCV::imgcodecs OpenCV::videoio GTest::gtest_main)
target_compile_definitions(data_tool_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(data_tool_test)
