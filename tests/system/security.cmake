add_executable(security_peer ${CMAKE_CURRENT_LIST_DIR}/security_peer.cc)
target_link_libraries(security_peer PRIVATE citylearn_core citylearn_warnings)
add_library(unlawful MODULE ${CMAKE_CURRENT_LIST_DIR}/unlawful.cc)
target_link_libraries(unlawful PRIVATE citylearn_warnings CycloneDDS::ddsc ${CMAKE_DL_LIBS})
add_executable(security_system_test ${CMAKE_CURRENT_LIST_DIR}/security_test.cc)
target_link_libraries(security_system_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
target_compile_definitions(security_system_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}"
  SECURITY_PEER="$<TARGET_FILE:security_peer>" UNLAWFUL="$<TARGET_FILE:unlawful>")
add_dependencies(security_system_test security_peer unlawful env_service policy_service)
set(kept_out *Intruders.*:*KeptOut*)
citylearn_tests(security_system_test TEST_FILTER -${kept_out} PROPERTIES TIMEOUT 300 RUN_SERIAL ON)
# Which leak of OpenSSL's memory is whose (lsan.supp) takes whole stacks to tell, which are slow.
citylearn_tests(security_system_test TEST_FILTER ${kept_out} TEST_LIST security_system_test_kept_out
  PROPERTIES TIMEOUT 300 RUN_SERIAL ON ENVIRONMENT_MODIFICATION ASAN_OPTIONS=string_append::fast_unwind_on_malloc=0)
