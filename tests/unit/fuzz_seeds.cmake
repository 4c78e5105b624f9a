set(fuzz ${CMAKE_CURRENT_LIST_DIR}/../fuzz)
add_executable(fuzz_seeds_test ${CMAKE_CURRENT_LIST_DIR}/fuzz_seeds_test.cc
  ${fuzz}/dataset_folder.cc ${fuzz}/encoder_file.cc ${fuzz}/feature_store.cc ${fuzz}/features_csv.cc ${fuzz}/mcap_file.cc ${fuzz}/message.cc
  ${fuzz}/picture.cc ${fuzz}/text_table.cc ${fuzz}/web_request.cc)
target_link_libraries(fuzz_seeds_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_encoder
  citylearn_recording citylearn_web_server fastcdr citylearn_warnings ZLIB::ZLIB OpenCV::core OpenCV::imgcodecs GTest::gtest_main)
target_compile_definitions(fuzz_seeds_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(fuzz_seeds_test)
