# SPDX-License-Identifier: Apache-2.0
# cpack: Debian packages of the components that Install.cmake names. ./run package builds them with the preset `package`.
set(packages services dashboard dev)
# Builds between releases sort by their commit's date, before the release that they lead to.
set(version ${PROJECT_VERSION})
execute_process(COMMAND git log -1 --format=%cd.%h --date=format-local:%Y%m%d%H%M%S WORKING_DIRECTORY ${CMAKE_SOURCE_DIR}
                OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
execute_process(COMMAND git describe --exact-match --match v${PROJECT_VERSION} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR}
                RESULT_VARIABLE unreleased OUTPUT_QUIET ERROR_QUIET)
if(commit AND unreleased)
  string(APPEND version "~${commit}")
endif()
if(CITYLEARN_NATIVE)
  string(APPEND version "+native")  # for processors like this machine's alone
endif()

# The packages in the list NAME of ./run whose names match a pattern.
function(listed_in_run output name pattern)
  file(READ ${CMAKE_SOURCE_DIR}/run text)
  string(REGEX MATCH "\n${name}=\\(([^)]*)\\)" text "${text}")
  string(REGEX MATCHALL "${pattern}" found "${CMAKE_MATCH_1}")
  list(JOIN found ", " found)
  set(${output} ${found} PARENT_SCOPE)
endfunction()
listed_in_run(libraries BUILD_PACKAGES "[a-z0-9.+-]+-dev")
if(CITYLEARN_FASTDDS)
  string(APPEND libraries ", lib${fastdds}-dev")
endif()
listed_in_run(report REPORT_PACKAGES "python3-[a-z0-9]+")

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME citylearn)
set(CPACK_PACKAGE_VENDOR CityLearn-DDS)
set(CPACK_PACKAGE_CONTACT "CityLearn-DDS maintainers <maintainers@citylearn.invalid>")
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL ${packages})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_VERSION ${version})
set(CPACK_DEBIAN_PACKAGE_SOURCE citylearn)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
cmake_host_system_information(RESULT CPACK_CITYLEARN_RELEASE QUERY DISTRIB_VERSION_CODENAME)
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_SOURCE_DIR}/cmake/package_files.cmake)

set(scripts ${CMAKE_SOURCE_DIR}/compose/debian/postinst ${CMAKE_SOURCE_DIR}/compose/debian/prerm ${CMAKE_SOURCE_DIR}/compose/debian/postrm)
file(WRITE ${CMAKE_BINARY_DIR}/packages/conffiles "/etc/citylearn/citylearn.env\n")
set(CPACK_DEBIAN_SERVICES_PACKAGE_NAME citylearn-services)
set(CPACK_DEBIAN_SERVICES_DESCRIPTION "learning to navigate by place recognition, over DDS
Environments, encoders and agents as services that meet over DDS, on one
machine or many: env_service, encoder_service, policy_service, the command
citylearn with its tools, and units of systemd.")
set(CPACK_DEBIAN_SERVICES_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_SERVICES_PACKAGE_DEPENDS "systemd | systemd-standalone-sysusers")
file(GLOB heic_decoder /usr/lib/*/libheif/plugins/libheif-libde265.so)
if(heic_decoder)  # libheif loads it by name while a program runs, so the programs' own libraries do not tell
  string(APPEND CPACK_DEBIAN_SERVICES_PACKAGE_DEPENDS ", libheif-plugin-libde265")
endif()
set(CPACK_DEBIAN_SERVICES_PACKAGE_RECOMMENDS "systemd, python3, ${report}")
set(CPACK_DEBIAN_SERVICES_PACKAGE_SUGGESTS citylearn-dashboard)
set(CPACK_DEBIAN_SERVICES_PACKAGE_CONTROL_EXTRA ${scripts} ${CMAKE_BINARY_DIR}/packages/conffiles)
set(CPACK_DEBIAN_DASHBOARD_PACKAGE_NAME citylearn-dashboard)
set(CPACK_DEBIAN_DASHBOARD_DESCRIPTION "page that shows and records what CityLearn-DDS learns
Shows the runs of the services of citylearn-services while they learn, and
keeps their episodes.")
set(CPACK_DEBIAN_DASHBOARD_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_DASHBOARD_PACKAGE_DEPENDS "citylearn-services (= ${version})")
set(CPACK_DEBIAN_DASHBOARD_PACKAGE_CONTROL_EXTRA ${scripts})
set(CPACK_DEBIAN_DEV_PACKAGE_NAME citylearn-dev)
set(CPACK_DEBIAN_DEV_DESCRIPTION "libraries and headers to write plug-ins of CityLearn-DDS
find_package(citylearn) in CMake finds what a network, a learner, an encoder,
a dataset or a policy_service of one's own is built with.")
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "citylearn-services (= ${version}), ${libraries}")
set(CPACK_DEBIAN_DEV_PACKAGE_RECOMMENDS "cmake, g++, libgtest-dev")
include(CPack)
