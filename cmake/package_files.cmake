# SPDX-License-Identifier: Apache-2.0
# cpack runs this between installing into folders and packing them: what has another place in a package than in an installation.
file(MAKE_DIRECTORY ${CPACK_TEMPORARY_DIRECTORY}/services/etc/citylearn)
file(RENAME ${CPACK_TEMPORARY_DIRECTORY}/services/usr/share/citylearn/citylearn.env
  ${CPACK_TEMPORARY_DIRECTORY}/services/etc/citylearn/citylearn.env)
string(TIMESTAMP now "%a, %d %b %Y %H:%M:%S +0000" UTC)
foreach(component ${CPACK_COMPONENTS_ALL})
  set(folder ${CPACK_TEMPORARY_DIRECTORY}/${component}/usr/share/doc/citylearn-${component})
  file(WRITE ${folder}/copyright "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: CityLearn-DDS

Files: *
Copyright: 2026 CityLearn-DDS contributors
License: Apache-2.0
 On Debian systems, the full text is in /usr/share/common-licenses/Apache-2.0.
")
  file(WRITE ${folder}/changelog "citylearn (${CPACK_DEBIAN_PACKAGE_VERSION}) ${CPACK_CITYLEARN_RELEASE}; urgency=medium

  * CHANGELOG.md of the sources says what changed.

 -- ${CPACK_PACKAGE_CONTACT}  ${now}
")
  execute_process(COMMAND gzip -9n ${folder}/changelog COMMAND_ERROR_IS_FATAL ANY)
endforeach()
