add_executable(policy_test unit/policy_test.cc)
target_link_libraries(policy_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_policy>" citylearn_warnings GTest::gtest_main)
citylearn_tests(policy_test)

add_executable(floors_test unit/floors_test.cc)
target_compile_definitions(floors_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
target_link_libraries(floors_test PRIVATE citylearn_warnings GTest::gtest_main)
citylearn_tests(floors_test)
