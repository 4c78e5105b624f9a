#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh FOLDER: eslint on the sources of the dashboard's page. Its packages are kept in FOLDER.
here=$(cd "$(dirname "$0")" && pwd) || exit 1
# shellcheck source=../../support/npm.sh
. "$here/../../support/npm.sh"
web=$here/../../../dashboard/web
[ -e "$web/node_modules/.citylearn-lock" ] || skip "the page's packages are not installed (target page)"
npm_packages "$here" "$1"
cp "$here/eslint.config.mjs" .
cd "$web" && exec "$1/node_modules/.bin/eslint" -c "$1/eslint.config.mjs" --max-warnings 0 src tests ./*.config.ts
