add_executable(tutorial_test ${CMAKE_CURRENT_LIST_DIR}/tutorial_test.cc)
target_link_libraries(tutorial_test PRIVATE citylearn_core citylearn_warnings nlohmann_json::nlohmann_json GTest::gtest_main)
target_compile_definitions(tutorial_test PRIVATE
  CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}" CITYLEARN_BINARY_DIR="${CMAKE_BINARY_DIR}"
  CITYLEARN_CXX="${CMAKE_CXX_COMPILER}" CITYLEARN_CXX_FLAGS="${CMAKE_CXX_FLAGS} $<JOIN:$<TARGET_PROPERTY:citylearn_warnings,INTERFACE_COMPILE_OPTIONS>, >" CITYLEARN_CMAKE="${CMAKE_COMMAND}")
add_dependencies(tutorial_test env_service citylearn_policy_main citylearn_learner_contract_tests)
citylearn_tests(tutorial_test PROPERTIES TIMEOUT 600 RUN_SERIAL ON)
