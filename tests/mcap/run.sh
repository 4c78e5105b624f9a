#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run.sh SAMPLE FOLDER: the program SAMPLE writes a recording, readers of others read it. Packages are kept in FOLDER. Exits with
# 77 where node, npm or the network for the first `npm ci` is missing.
here=$(cd "$(dirname "$0")" && pwd) || exit 1
skip() { echo "skipped: $*"; exit 77; }
command -v node >/dev/null || skip 'node is missing'
command -v npm >/dev/null || skip 'npm is missing'
mkdir -p "$2" && cd "$2" || exit 1
if ! cmp -s "$here/package-lock.json" node_modules/.citylearn-lock; then
  cp "$here/package.json" "$here/package-lock.json" .
  npm ci --no-audit --no-fund --loglevel=error --fetch-retries=1 || skip "the readers' packages cannot be had (npm ci in $2)"
  cp package-lock.json node_modules/.citylearn-lock
fi
cp "$here/read.mjs" .
rm -f sample.mcap && "$1" sample.mcap && exec node read.mjs sample.mcap
