# The simulation of docs/scaling.md, and what it is calibrated by.
if(CITYLEARN_BENCH)
  add_executable(scale_test ${CMAKE_CURRENT_LIST_DIR}/scale_test.cc)
  target_link_libraries(scale_test PRIVATE citylearn_scale citylearn_warnings GTest::gtest_main)
  target_compile_definitions(scale_test PRIVATE CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  citylearn_tests(scale_test)
endif()
