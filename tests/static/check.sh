#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Checks our sources without running them: check.sh format|scripts|tidy|tidy_all BUILD. `tidy` looks at the files that changed
# since the branch left its upstream, or in the last commit; `tidy_all` at every file. Exits with 77 where a tool is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

skip() { echo "skipped: $*"; exit 77; }
need() { command -v "$1" >/dev/null || skip "$1 is missing (package $1)"; }
folders=(core env_service encoder_service policy_service dashboard tools python tests bench)
sources() { find "${folders[@]}" -name node_modules -prune -o \( "$@" \) -print | sort; }

changed() {
  local base
  git rev-parse --verify -q 'HEAD^{commit}' >/dev/null 2>&1 || skip 'there is no history to compare with'
  base=$(git merge-base HEAD '@{upstream}' 2>/dev/null || git rev-parse HEAD)
  [ "$base" != "$(git rev-parse HEAD)" ] || base=$(git rev-parse -q --verify 'HEAD^' || echo "$base")
  { git diff --name-only --diff-filter=d "$base"; git ls-files --others --exclude-standard; } | sort -u
}

# database BUILD: writes BUILD/tests/tidy/compile_commands.json, one command for each file. Those that the build merges into one
# are listed each by itself.
database() {
  mkdir -p "$1/tests/tidy"
  python3 - "$1/compile_commands.json" >"$1/tests/tidy/compile_commands.json" <<'PYTHON'
import json, re, sys

commands = []
for entry in json.load(open(sys.argv[1])):
    merged = re.findall(r'#include "(.*)"', open(entry['file']).read()) if '/Unity/' in entry['file'] else [entry['file']]
    commands += [{**entry, 'file': file, 'command': entry['command'].replace(entry['file'], file)} for file in merged]
json.dump(commands, sys.stdout, indent=0)
PYTHON
}

tidy() {
  need clang-tidy-16  # clang 14, the default, cannot read coroutines
  local build=$1/tests/tidy; shift
  [ $# -gt 0 ] || { echo 'no source has changed'; return 0; }
  printf '%s\n' "$@"
  printf '%s\0' "$@" |
    xargs -0 -P "$(nproc)" -n 1 clang-tidy-16 --quiet -p "$build" --extra-arg=-Wno-unknown-warning-option --extra-arg=-Wno-ignored-optimization-argument \
      --extra-arg=-DBOOST_ASIO_HAS_CO_AWAIT --extra-arg=-DBOOST_ASIO_HAS_STD_COROUTINE 2> >(grep -v 'warnings\? ' >&2)
}

case $1 in
  format)
    # Releases differ in what they find well formatted.
    clang-format --version 2>/dev/null | grep -q 'version 14\.' || skip 'clang-format 14 is missing (package clang-format of Debian 12)'
    sources -name '*.cc' -o -name '*.h' -o -name '*.c' | xargs -d '\n' clang-format --dry-run -Werror ;;
  scripts)
    need shellcheck
    { grep -rlIEm1 --exclude-dir=node_modules '^#!.*[/ ](ba)?sh\b' run .ci compose "${folders[@]}"; } | xargs -d '\n' shellcheck -x -P SCRIPTDIR ;;
  tidy)
    # Those that the build compiles. A dozen takes a minute or two on two cores.
    list=$(changed)
    database "$2"
    mapfile -t files < <(grep -E '\.cc$' <<<"$list" | while read -r file; do
      ! grep -q "\"file\": \".*/$file\"" "$2/tests/tidy/compile_commands.json" || echo "$file"; done)
    [ ${#files[@]} -le 12 ] || echo "12 of ${#files[@]} changed files (tidy_all checks every one)"
    tidy "$2" "${files[@]:0:12}" ;;
  tidy_all)
    database "$2"
    mapfile -t files < <(sed -n 's/.*"file": "\(.*\)".*/\1/p' "$2/tests/tidy/compile_commands.json" | grep -E '\.cc$' | grep -v "^$2/" | sort -u)
    tidy "$2" "${files[@]}" ;;
  *) echo "check.sh: unknown check '$1'"; exit 1 ;;
esac
