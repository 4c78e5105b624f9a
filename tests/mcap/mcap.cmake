# Recordings as others read them.
add_executable(mcap_sample ${CMAKE_CURRENT_LIST_DIR}/sample.cc)
target_link_libraries(mcap_sample PRIVATE citylearn_recording citylearn_warnings nlohmann_json::nlohmann_json)
add_test(NAME mcap_foreign_readers
  COMMAND sh ${CMAKE_CURRENT_LIST_DIR}/run.sh $<TARGET_FILE:mcap_sample> ${CMAKE_CURRENT_BINARY_DIR}/mcap)
set_tests_properties(mcap_foreign_readers PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 300)
