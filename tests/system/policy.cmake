add_executable(inprocess_run system/inprocess_run.cc)
target_link_libraries(inprocess_run PRIVATE
  "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_policy>" citylearn_warnings)

add_executable(policy_system_test system/policy_test.cc)
target_compile_definitions(policy_system_test PRIVATE CITYLEARN_INPROCESS_RUN="$<TARGET_FILE:inprocess_run>")
target_link_libraries(policy_system_test PRIVATE citylearn_core citylearn_warnings nlohmann_json::nlohmann_json GTest::gtest_main)
add_dependencies(policy_system_test env_service policy_service inprocess_run)
citylearn_tests(policy_system_test PROPERTIES TIMEOUT 600 RUN_SERIAL ON)
