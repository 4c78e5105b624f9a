add_executable(fleet_test system/fleet_test.cc)
target_link_libraries(fleet_test PRIVATE
  "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_policy>" citylearn_warnings GTest::gtest_main)
citylearn_tests(fleet_test PROPERTIES TIMEOUT 120)
