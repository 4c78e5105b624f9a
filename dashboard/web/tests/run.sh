#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh unit|e2e PAGE: the page's tests; PAGE is the folder of the built page. Exits with 77 where something they need is missing.
cd "$(dirname "$0")/.." || exit 1
skip() { echo "skipped: $*"; exit 77; }
command -v npm >/dev/null || skip 'npm is missing'
[ -e node_modules/.citylearn-lock ] || skip "the page's packages are not installed (target page)"
export CITYLEARN_PAGE="$2"
case $1 in
  unit) npm run --silent check && exec npm run --silent test ;;
  e2e)
    [ -x "${CITYLEARN_CHROMIUM:-/usr/bin/chromium}" ] || skip 'chromium is missing'
    [ -e "$2/index.html" ] || skip 'the page is not built (target page)'
    exec npm run --silent test:e2e ;;
  *) echo "unknown part '$1'"; exit 1 ;;
esac
