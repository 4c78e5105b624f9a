# SPDX-License-Identifier: Apache-2.0
# The dashboard's page: sources -> build/.../dashboard/page. Node and npm make it; without them, or without a network for the first
# `npm ci`, everything else is built all the same and the dashboard says what is missing.
set(CITYLEARN_PAGE ${CMAKE_BINARY_DIR}/dashboard/page)
find_program(NPM npm)
if(NOT NPM)
  message(STATUS "The dashboard's page is not built: npm is missing (packages nodejs and npm)")
  return()
endif()

set(web ${CMAKE_SOURCE_DIR}/dashboard/web)
file(GLOB_RECURSE page_sources CONFIGURE_DEPENDS ${web}/src/* ${web}/public/*)
add_custom_command(
  OUTPUT ${CMAKE_BINARY_DIR}/dashboard/page.stamp
  COMMAND ${CMAKE_COMMAND} -DNPM=${NPM} -DWEB=${web} -DPAGE=${CITYLEARN_PAGE}
          -DSTAMP=${CMAKE_BINARY_DIR}/dashboard/page.stamp -P ${web}/build_page.cmake
  DEPENDS ${page_sources} ${web}/index.html ${web}/package.json ${web}/package-lock.json ${web}/vite.config.ts
          ${web}/tsconfig.json ${CMAKE_SOURCE_DIR}/core/task/training_figures.inc
          ${web}/build_page.cmake
  COMMENT "Building the dashboard's page"
  VERBATIM)
add_custom_target(page ALL DEPENDS ${CMAKE_BINARY_DIR}/dashboard/page.stamp)
