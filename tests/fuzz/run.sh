#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzzers and runs one, or each in turn: tests/fuzz/run.sh [TARGET] [SECONDS]. See README.md.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

fail() { printf 'fuzz: %s\n' "$*" >&2; exit 1; }

files=$(cd tests/fuzz/seeds && printf '%s\n' *)
types=$(sed -n 's,^CITYLEARN_TOPIC(.*"\([a-z_]*\)".*,message_\1,p' core/wire/messages.cc | sort)
target=${1:-all} seconds=${2:-600}
case $target in
  all) targets="$files $types" ;;
  message) targets=$types ;;
  *) targets=$target
     grep -qx -- "$target" <<<"$files"$'\n'"$types" || fail "unknown target '$target' (known: all $(xargs <<<"$files message $types"))" ;;
esac
[[ $seconds =~ ^[1-9][0-9]*$ ]] || fail "'$seconds' is not a number of seconds"
command -v clang++ >/dev/null || fail "needs clang++ with libFuzzer (on Debian: apt-get install clang libclang-rt-14-dev llvm)"

mapfile -t programs < <(tr ' ' '\n' <<<"$targets" | sed 's/^message_.*/fuzz_message\nfuzz_message_seeds/; t; s/^/fuzz_/' | sort -u)
cmake --preset fuzz >/dev/null
cmake --build build/fuzz --parallel "${CITYLEARN_JOBS:-$(nproc)}" --target "${programs[@]}" >&2

# Targets that read files write them here; in memory where there is such a disk.
scratch=$(mktemp -d "$([ -w /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")/citylearn-fuzz-XXXXXX")
trap 'rm -rf "$scratch"' EXIT
export TMPDIR=$scratch
# OpenCV and the C library are not instrumented, so a container's bounds are unknown to them.
export ASAN_OPTIONS=detect_container_overflow=0:allocator_may_return_null=1:detect_leaks=1
export UBSAN_OPTIONS=print_stacktrace=1 OPENCV_LOG_LEVEL=SILENT

[[ " ${programs[*]} " != *message* ]] || build/fuzz/tests/fuzz_message_seeds build/fuzz/seeds
for one in $targets; do
  corpus=build/fuzz/corpus/$one findings=build/fuzz/findings/$one
  mkdir -p "$corpus" "$findings"
  dictionary=()
  [ ! -f "tests/fuzz/$one.dict" ] || dictionary=("-dict=tests/fuzz/$one.dict")
  program=$one seeds=tests/fuzz/seeds/$one again="build/fuzz/tests/fuzz_$one FILE"
  if [ "${one#message_}" != "$one" ]; then
    export CITYLEARN_FUZZ_MESSAGE=${one#message_}
    program=message seeds=build/fuzz/seeds/$one again="CITYLEARN_FUZZ_MESSAGE=${one#message_} build/fuzz/tests/fuzz_message FILE"
  fi
  echo "== $one, $seconds s"
  build/fuzz/tests/fuzz_"$program" -max_total_time="$seconds" -rss_limit_mb=2048 -timeout=20 -max_len=20000 \
    -print_final_stats=1 -artifact_prefix="$findings/" "${dictionary[@]}" "$corpus" "$seeds" ||
    fail "$one has a finding; its input is in $findings ($again shows it again)"
done
