# SPDX-License-Identifier: Apache-2.0
# cmake --install BUILD --prefix DIR: the programs and their one command citylearn, the dashboard's page, the units of systemd.
# With --component dev: what plug-ins of other repositories are built with. Components are packages (Package.cmake).
include(GNUInstallDirs)
set(CMAKE_INSTALL_DEFAULT_COMPONENT_NAME services)
install(TARGETS dashboard RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT dashboard)
install(TARGETS env_service encoder_service policy_service
  citylearn_data citylearn_doctor citylearn_export citylearn_paper citylearn_record citylearn_replay
  citylearn_robot citylearn_ros2 citylearn_teach citylearn_vpr RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
set(tools ${CMAKE_INSTALL_DATADIR}/citylearn/tools)
install(PROGRAMS ${CMAKE_SOURCE_DIR}/tools/citylearn/citylearn DESTINATION ${CMAKE_INSTALL_BINDIR})
install(FILES ${CMAKE_SOURCE_DIR}/tools/citylearn/commands.sh ${CMAKE_SOURCE_DIR}/tools/citylearn/demo.sh
  ${CMAKE_SOURCE_DIR}/tools/citylearn/robot.sh
  DESTINATION ${tools}/citylearn)
# Where npm is missing there is no page, and the dashboard says so.
install(DIRECTORY ${CMAKE_BINARY_DIR}/dashboard/page/ DESTINATION ${CMAKE_INSTALL_DATADIR}/citylearn/page
  COMPONENT dashboard OPTIONAL)
install(FILES ${CMAKE_SOURCE_DIR}/tools/lab/charts.py DESTINATION ${tools}/lab)
install(FILES ${CMAKE_SOURCE_DIR}/tools/vpr/recognition_page.py DESTINATION ${tools}/vpr)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/tools/paper/report DESTINATION ${tools}/paper PATTERN __pycache__ EXCLUDE)
file(GLOB units ${CMAKE_SOURCE_DIR}/compose/systemd/*.service ${CMAKE_SOURCE_DIR}/compose/systemd/*.target)
list(FILTER units EXCLUDE REGEX citylearn-dashboard)
install(FILES ${units} DESTINATION lib/systemd/system)
install(FILES ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn-dashboard.service DESTINATION lib/systemd/system COMPONENT dashboard)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn-.service.d DESTINATION lib/systemd/system)
install(FILES ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn.sysusers DESTINATION lib/sysusers.d RENAME citylearn.conf)
install(FILES ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn.env DESTINATION ${CMAKE_INSTALL_DATADIR}/citylearn)

# Libraries, and the headers that plug-ins may include (Plugins.cmake).
set(include include/citylearn)
install(TARGETS ${exported} EXPORT citylearn ARCHIVE DESTINATION lib/citylearn COMPONENT dev EXCLUDE_FROM_ALL)
install(EXPORT citylearn FILE citylearn-targets.cmake DESTINATION lib/cmake/citylearn COMPONENT dev EXCLUDE_FROM_ALL)
set(root "\${CMAKE_CURRENT_LIST_DIR}/../../../${include}")
configure_file(cmake/citylearn-config.cmake.in installed/citylearn-config.cmake @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/installed/citylearn-config.cmake DESTINATION lib/cmake/citylearn COMPONENT dev EXCLUDE_FROM_ALL)
list(FILTER headers EXCLUDE REGEX "\\.idl$")
foreach(header ${headers} core/plugin/plugin_stamp.cc cmake/PluginTarget.cmake tests/contract/learner_contract.cc
        tests/contract/random_rollout.h tests/support/text.h)
  cmake_path(ABSOLUTE_PATH header BASE_DIRECTORY ${CMAKE_SOURCE_DIR} OUTPUT_VARIABLE file)
  cmake_path(RELATIVE_PATH file BASE_DIRECTORY ${CMAKE_SOURCE_DIR} OUTPUT_VARIABLE folder)
  cmake_path(GET folder PARENT_PATH folder)
  install(FILES ${file} DESTINATION ${include}/${folder} COMPONENT dev EXCLUDE_FROM_ALL)
endforeach()
foreach(folder core idl)
  install(DIRECTORY ${CMAKE_BINARY_DIR}/generated/${folder} DESTINATION ${include} COMPONENT dev EXCLUDE_FROM_ALL
    FILES_MATCHING PATTERN "*.h")
endforeach()
