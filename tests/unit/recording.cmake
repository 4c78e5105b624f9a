add_executable(recording_test unit/mcap_test.cc unit/replayer_test.cc unit/trajectory_replay_test.cc)
target_link_libraries(recording_test PRIVATE citylearn_record_tools citylearn_dashboard citylearn_warnings ZLIB::ZLIB
  GTest::gtest_main)
citylearn_tests(recording_test)
