add_executable(recording_system_test system/recording_test.cc)
target_compile_definitions(recording_system_test PRIVATE CITYLEARN_RECORDER_PROCESS="$<TARGET_FILE:recorder_process>"
  CITYLEARN_RECORD="$<TARGET_FILE:citylearn_record>" CITYLEARN_REPLAY="$<TARGET_FILE:citylearn_replay>"
  CITYLEARN_DASHBOARD="$<TARGET_FILE:dashboard>")
target_link_libraries(recording_system_test PRIVATE citylearn_dashboard citylearn_recording citylearn_warnings GTest::gtest_main)
add_dependencies(recording_system_test env_service policy_service recorder_process citylearn_record citylearn_replay dashboard)
citylearn_tests(recording_system_test PROPERTIES TIMEOUT 600 RUN_SERIAL ON)
