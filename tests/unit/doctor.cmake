add_executable(doctor_test ${CMAKE_CURRENT_LIST_DIR}/doctor_test.cc)
target_link_libraries(doctor_test PRIVATE citylearn_doctor_tools citylearn_warnings GTest::gtest_main)
target_compile_definitions(doctor_test PRIVATE CITYLEARN_DOCTOR="$<TARGET_FILE:citylearn_doctor>")
add_dependencies(doctor_test citylearn_doctor)
citylearn_tests(doctor_test PROPERTIES TIMEOUT 60 RUN_SERIAL ON)  # one domain for all
