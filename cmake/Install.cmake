# SPDX-License-Identifier: Apache-2.0
# cmake --install BUILD --prefix DIR: the programs and their one command citylearn, the dashboard's page, the units of systemd.
include(GNUInstallDirs)
set(programs env_service encoder_service policy_service dashboard
  citylearn_data citylearn_doctor citylearn_export citylearn_paper citylearn_record citylearn_replay citylearn_vpr)
foreach(program ${programs} citylearn_discovery_server)
  if(TARGET ${program})
    install(TARGETS ${program} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  endif()
endforeach()
set(tools ${CMAKE_INSTALL_DATADIR}/citylearn/tools)
install(PROGRAMS ${CMAKE_SOURCE_DIR}/tools/citylearn/citylearn DESTINATION ${CMAKE_INSTALL_BINDIR})
install(FILES ${CMAKE_SOURCE_DIR}/tools/citylearn/commands.sh ${CMAKE_SOURCE_DIR}/tools/citylearn/demo.sh
  DESTINATION ${tools}/citylearn)
install(FILES ${CMAKE_SOURCE_DIR}/tools/citylearn/completion/complete.sh DESTINATION ${tools}/citylearn/completion)
# Where shells look for completion: bash by the name of the command.
foreach(command citylearn ${programs})
  install(FILES ${CMAKE_SOURCE_DIR}/tools/citylearn/completion/citylearn.bash
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME ${command})
endforeach()
install(FILES ${CMAKE_SOURCE_DIR}/tools/citylearn/completion/_citylearn DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/site-functions)
# Where npm is missing there is no page, and the dashboard says so.
install(DIRECTORY ${CMAKE_BINARY_DIR}/dashboard/page/ DESTINATION ${CMAKE_INSTALL_DATADIR}/citylearn/page OPTIONAL)
install(FILES ${CMAKE_SOURCE_DIR}/tools/vpr/charts.py ${CMAKE_SOURCE_DIR}/tools/vpr/recognition_page.py
  DESTINATION ${tools}/vpr)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/tools/paper/report DESTINATION ${tools}/paper PATTERN __pycache__ EXCLUDE)
file(GLOB units ${CMAKE_SOURCE_DIR}/compose/systemd/*.service ${CMAKE_SOURCE_DIR}/compose/systemd/*.target)
install(FILES ${units} DESTINATION lib/systemd/system)
install(DIRECTORY ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn-.service.d DESTINATION lib/systemd/system)
install(FILES ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn.sysusers DESTINATION lib/sysusers.d RENAME citylearn.conf)
install(FILES ${CMAKE_SOURCE_DIR}/compose/systemd/citylearn.env DESTINATION ${CMAKE_INSTALL_DATADIR}/citylearn)
