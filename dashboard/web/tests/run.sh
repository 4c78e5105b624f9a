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
    build=$(dirname "$(dirname "$2")")
    for program in dashboard/dashboard env_service/env_service encoder_service/encoder_service policy_service/policy_service; do
      [ -x "$build/$program" ] || { echo "$build/$program is not built"; exit 1; }
    done
    # A DDS domain that no other test has (tests/support/processes/domain.h); it is taken as long as file 9 is open.
    CITYLEARN_DOMAIN=110
    while exec 9>>"/tmp/citylearn-test-domain-$CITYLEARN_DOMAIN" && ! flock -n 9; do
      CITYLEARN_DOMAIN=$((CITYLEARN_DOMAIN + 1))
      [ $CITYLEARN_DOMAIN -lt 200 ] || { echo 'no DDS domain is free for a test'; exit 1; }
    done
    export CITYLEARN_DOMAIN
    exec npm run --silent test:e2e ;;
  *) echo "unknown part '$1'"; exit 1 ;;
esac
