#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh SAMPLE FOLDER: the program SAMPLE writes a recording, readers of others read it. Packages are kept in FOLDER.
here=$(cd "$(dirname "$0")" && pwd) || exit 1
# shellcheck source=../support/npm.sh
. "$here/../support/npm.sh"
npm_packages "$here" "$2"
cp "$here/read.mjs" .
rm -f sample.mcap && "$1" sample.mcap && exec node read.mjs sample.mcap
