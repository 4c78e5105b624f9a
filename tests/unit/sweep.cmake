add_executable(sweep_test ${CMAKE_CURRENT_LIST_DIR}/sweep_test.cc)
target_link_libraries(sweep_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_policy>" citylearn_warnings
                      nlohmann_json::nlohmann_json GTest::gtest_main)
citylearn_tests(sweep_test)
