add_executable(network_peer ${CMAKE_CURRENT_LIST_DIR}/network_peer.cc)
target_link_libraries(network_peer PRIVATE citylearn_core citylearn_warnings)
add_executable(network_test ${CMAKE_CURRENT_LIST_DIR}/network_test.cc)
target_link_libraries(network_test PRIVATE citylearn_core citylearn_warnings nlohmann_json::nlohmann_json GTest::gtest_main)
target_compile_definitions(network_test PRIVATE NETWORK_PEER="$<TARGET_FILE:network_peer>"
  CITYLEARN_DOCTOR="$<TARGET_FILE:citylearn_doctor>")
add_dependencies(network_test network_peer citylearn_doctor env_service policy_service)
citylearn_tests(network_test TEST_FILTER "-*Long*" PROPERTIES TIMEOUT 120 RUN_SERIAL ON)
# ./run test --long
citylearn_tests(network_test TEST_FILTER "*Long*" PROPERTIES TIMEOUT 300 RUN_SERIAL ON LABELS long)
