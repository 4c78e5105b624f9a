add_executable(selection_test ${CMAKE_CURRENT_LIST_DIR}/selection_test.cc ${CMAKE_CURRENT_LIST_DIR}/source_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/memory_test.cc ${CMAKE_CURRENT_LIST_DIR}/plain_images_test.cc)
target_link_libraries(selection_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings
  OpenCV::core OpenCV::imgcodecs OpenCV::videoio GTest::gtest_main)
target_compile_definitions(selection_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(selection_test)
