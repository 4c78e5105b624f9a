# A learner in C, over Cyclone DDS and the C types that its own compiler makes of idl/: nothing of ours is included or linked.
enable_language(C)
find_program(IDLC idlc REQUIRED)
set(foreign_generated ${CMAKE_CURRENT_BINARY_DIR}/foreign_idl)
file(MAKE_DIRECTORY ${foreign_generated})
set(foreign_sources)
foreach(name common observation action episode task_settings traversal)
  add_custom_command(
    OUTPUT ${foreign_generated}/${name}.c ${foreign_generated}/${name}.h
    COMMAND ${IDLC} -I ${CMAKE_SOURCE_DIR}/idl -o ${foreign_generated} ${CMAKE_SOURCE_DIR}/idl/${name}.idl
    DEPENDS ${CMAKE_SOURCE_DIR}/idl/${name}.idl ${CMAKE_SOURCE_DIR}/idl/common.idl
    COMMENT "Generating C types from idl/${name}.idl"
    VERBATIM)
  list(APPEND foreign_sources ${foreign_generated}/${name}.c)
endforeach()
add_library(foreign_types STATIC ${foreign_sources})
target_include_directories(foreign_types SYSTEM PUBLIC ${foreign_generated})
target_link_libraries(foreign_types PUBLIC CycloneDDS::ddsc)

add_executable(foreign_learner ${CMAKE_CURRENT_LIST_DIR}/main.c ${CMAKE_CURRENT_LIST_DIR}/session.c)
target_link_libraries(foreign_learner PRIVATE foreign_types citylearn_warnings m)

add_executable(foreign_test ${CMAKE_CURRENT_LIST_DIR}/foreign_test.cc)
target_compile_definitions(foreign_test PRIVATE FOREIGN_LEARNER="$<TARGET_FILE:foreign_learner>")
target_link_libraries(foreign_test PRIVATE citylearn_core citylearn_warnings nlohmann_json::nlohmann_json GTest::gtest_main)
add_dependencies(foreign_test foreign_learner env_service policy_service)
citylearn_tests(foreign_test PROPERTIES TIMEOUT 300 RUN_SERIAL ON)
