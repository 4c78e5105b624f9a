# A library, so that a learner of another repository is held to the same: docs/tutorial-learner.md.
add_library(citylearn_learner_contract_tests STATIC ${CMAKE_CURRENT_LIST_DIR}/learner_contract.cc)
target_link_libraries(citylearn_learner_contract_tests
  PUBLIC "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learning>" GTest::gtest_main
  PRIVATE citylearn_warnings)
add_library(citylearn_learner_contract INTERFACE)
target_link_libraries(citylearn_learner_contract
  INTERFACE "$<LINK_LIBRARY:WHOLE_ARCHIVE,citylearn_learner_contract_tests>")
file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/nothing.cc "")
add_executable(learner_contract_test ${CMAKE_CURRENT_BINARY_DIR}/nothing.cc)
target_link_libraries(learner_contract_test PRIVATE citylearn_learner_contract)
citylearn_tests(learner_contract_test)
