citylearn_plugin(sample_plugin ${CMAKE_SOURCE_DIR}/tests/support/sample_plugin.cc)
citylearn_plugin(taken_plugin ${CMAKE_SOURCE_DIR}/tests/support/sample_plugin.cc)   # registers a name that exists
target_compile_definitions(taken_plugin PRIVATE SAMPLE_NAME="ppo")
citylearn_plugin(empty_plugin)                                                      # registers nothing

add_executable(plugins_test unit/plugins_test.cc unit/torch_ppo_test.cc)
target_link_libraries(plugins_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>" citylearn_env citylearn_warnings
                      GTest::gtest_main)
citylearn_takes_plugins(plugins_test)
target_compile_definitions(plugins_test PRIVATE
  SAMPLE_PLUGIN="$<TARGET_FILE:sample_plugin>" TAKEN_PLUGIN="$<TARGET_FILE:taken_plugin>" EMPTY_PLUGIN="$<TARGET_FILE:empty_plugin>")
add_dependencies(plugins_test sample_plugin taken_plugin empty_plugin policy_service)
if(TARGET torch_ppo)
  target_compile_definitions(plugins_test PRIVATE CITYLEARN_TORCH_PPO="$<TARGET_FILE:torch_ppo>")
  add_dependencies(plugins_test torch_ppo)
endif()
citylearn_tests(plugins_test)
