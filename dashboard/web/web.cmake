# SPDX-License-Identifier: Apache-2.0
# Tests of the page. Each skips itself (77) where npm, its packages or chromium are missing.
set(web ${CMAKE_SOURCE_DIR}/dashboard/web)
foreach(part unit e2e)
  add_test(NAME dashboard_page_${part} COMMAND sh ${web}/tests/run.sh ${part} ${CMAKE_BINARY_DIR}/dashboard/page)
  set_tests_properties(dashboard_page_${part} PROPERTIES SKIP_RETURN_CODE 77 TIMEOUT 1200 RESOURCE_LOCK page PROCESSORS 2)
endforeach()
set_tests_properties(dashboard_page_e2e PROPERTIES RUN_SERIAL ON)  # a browser and services: it waits for what is seen in time
