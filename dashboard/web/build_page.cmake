# SPDX-License-Identifier: Apache-2.0
# cmake -DNPM= -DWEB= -DPAGE= -DSTAMP= -P: installs what package-lock.json names where that has changed, then builds the page.
# Packages that cannot be had are no error: then there is no new page and no stamp, and the next build tries again.
file(REMOVE ${STAMP})
set(ENV{PLAYWRIGHT_SKIP_BROWSER_DOWNLOAD} 1)
file(SHA256 ${WEB}/package-lock.json wanted)
set(installed none)
if(EXISTS ${WEB}/node_modules/.citylearn-lock)
  file(READ ${WEB}/node_modules/.citylearn-lock installed)
endif()
if(NOT installed STREQUAL wanted)
  execute_process(COMMAND ${NPM} ci --no-audit --no-fund --loglevel=error --fetch-retries=1
    WORKING_DIRECTORY ${WEB} RESULT_VARIABLE failed OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(failed)
    string(REGEX MATCH "^[^\n]*(\n[^\n]*)?(\n[^\n]*)?" said "${said}")  # the rest is advice
    message("The dashboard's page is not built: 'npm ci' in ${WEB} failed (no network?). Everything else is.\n${said}")
    return()
  endif()
  file(WRITE ${WEB}/node_modules/.citylearn-lock ${wanted})
endif()

set(ENV{CITYLEARN_PAGE} ${PAGE})
execute_process(COMMAND ${NPM} run --silent build -- --logLevel=warn WORKING_DIRECTORY ${WEB} RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "The dashboard's page cannot be built: see above")
endif()
file(TOUCH ${STAMP})
