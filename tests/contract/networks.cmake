add_executable(networks_test ${CMAKE_CURRENT_LIST_DIR}/networks_test.cc)
target_link_libraries(networks_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>" citylearn_env
                      citylearn_warnings GTest::gtest_main)
citylearn_tests(networks_test)
