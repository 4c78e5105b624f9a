add_executable(web_server_test ${CMAKE_CURRENT_LIST_DIR}/client_hub_test.cc ${CMAKE_CURRENT_LIST_DIR}/web_server_test.cc)
target_link_libraries(web_server_test PRIVATE citylearn_web_server citylearn_warnings Boost::headers GTest::gtest_main)
citylearn_tests(web_server_test)
