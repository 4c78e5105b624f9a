# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=sh
# Sourced by tests that need packages of npm's. npm_packages FROM FOLDER: installs what FROM/package-lock.json names in FOLDER
# and goes there. Exits with 77 where node, npm or the network for the first `npm ci` is missing.
skip() { echo "skipped: $*"; exit 77; }
npm_packages() {
  command -v node >/dev/null || skip 'node is missing'
  command -v npm >/dev/null || skip 'npm is missing'
  mkdir -p "$2" && cd "$2" || exit 1
  if ! cmp -s "$1/package-lock.json" node_modules/.citylearn-lock; then
    cp "$1/package.json" "$1/package-lock.json" .
    npm ci --no-audit --no-fund --loglevel=error --fetch-retries=1 || skip "packages cannot be had (npm ci in $2)"
    cp package-lock.json node_modules/.citylearn-lock
  fi
}
