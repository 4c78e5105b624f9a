add_executable(env_test
  ${CMAKE_CURRENT_LIST_DIR}/crossings_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/environment_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/environment_golden_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/episode_book_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/dataset_plain_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/dataset_synthetic_test.cc
  ${CMAKE_CURRENT_LIST_DIR}/traversal_test.cc)
target_link_libraries(env_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_env>" citylearn_warnings GTest::gtest_main)
target_compile_definitions(env_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
citylearn_tests(env_test)
