# What breaks, and goes on: kills, full disks, leftovers, lies. Suites named Long... run in `./run test --long` alone.
add_executable(faults_test system/faults_test.cc)
target_compile_definitions(faults_test PRIVATE CITYLEARN_DASHBOARD="$<TARGET_FILE:dashboard>")
target_link_libraries(faults_test PRIVATE citylearn_dashboard citylearn_warnings nlohmann_json::nlohmann_json GTest::gtest_main)
add_dependencies(faults_test env_service encoder_service policy_service dashboard)
citylearn_tests(faults_test TEST_FILTER -Long* PROPERTIES TIMEOUT 600 RUN_SERIAL ON)
citylearn_tests(faults_test TEST_FILTER Long* TEST_LIST faults_test_long PROPERTIES LABELS long TIMEOUT 3600 RUN_SERIAL ON)

add_executable(soak_test system/soak_test.cc)
target_compile_definitions(soak_test PRIVATE CITYLEARN_RECORDER_PROCESS="$<TARGET_FILE:recorder_process>")
target_link_libraries(soak_test PRIVATE citylearn_dashboard citylearn_warnings GTest::gtest_main)
add_dependencies(soak_test env_service policy_service recorder_process)
citylearn_tests(soak_test PROPERTIES LABELS long TIMEOUT 3600 RUN_SERIAL ON)

add_executable(supervise_test system/supervise_test.cc)
target_compile_definitions(supervise_test PRIVATE
  CITYLEARN_SOURCE_DIR="${CMAKE_SOURCE_DIR}" CITYLEARN_BUILD_DIR="${CMAKE_BINARY_DIR}")
target_link_libraries(supervise_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
add_dependencies(supervise_test env_service encoder_service policy_service dashboard)
citylearn_tests(supervise_test PROPERTIES TIMEOUT 300 RUN_SERIAL ON)

add_executable(full_disk_test system/full_disk_test.cc)
target_compile_definitions(full_disk_test PRIVATE CITYLEARN_RECORDER_PROCESS="$<TARGET_FILE:recorder_process>")
target_link_libraries(full_disk_test PRIVATE citylearn_dashboard citylearn_learning citylearn_warnings GTest::gtest_main)
add_dependencies(full_disk_test env_service policy_service recorder_process)
citylearn_tests(full_disk_test PROPERTIES TIMEOUT 300 RUN_SERIAL ON)

add_executable(leftovers_test system/leftovers_test.cc)
target_compile_definitions(leftovers_test PRIVATE CITYLEARN_DASHBOARD="$<TARGET_FILE:dashboard>")
target_link_libraries(leftovers_test PRIVATE citylearn_dashboard citylearn_warnings GTest::gtest_main)
add_dependencies(leftovers_test env_service encoder_service policy_service dashboard)
citylearn_tests(leftovers_test TEST_FILTER -Long* PROPERTIES TIMEOUT 300 RUN_SERIAL ON)
citylearn_tests(leftovers_test TEST_FILTER Long* TEST_LIST leftovers_test_long PROPERTIES LABELS long TIMEOUT 300 RUN_SERIAL ON)

add_executable(hostile_test system/hostile_test.cc)
target_link_libraries(hostile_test PRIVATE citylearn_core citylearn_warnings GTest::gtest_main)
add_dependencies(hostile_test env_service policy_service)
citylearn_tests(hostile_test TEST_FILTER -Long* PROPERTIES TIMEOUT 300 RUN_SERIAL ON)
citylearn_tests(hostile_test TEST_FILTER Long* TEST_LIST hostile_test_long PROPERTIES LABELS long TIMEOUT 300 RUN_SERIAL ON)

add_executable(growing_file_test unit/growing_file_test.cc)
target_link_libraries(growing_file_test PRIVATE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_policy>" citylearn_warnings GTest::gtest_main)
citylearn_tests(growing_file_test)
