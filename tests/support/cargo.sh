#!/bin/sh
# Builds the learner over RustDDS: build.sh FOLDER. Its crates come by cargo's own configuration, the first time from a
# registry, later from cargo's cache. Exits with 77 and a reason where cargo or the crates are missing.
set -eu
source=$(dirname "$(realpath "$0")")
skip() {
  echo "skipped: $1"
  exit 77
}
command -v cargo >/dev/null || skip "cargo is not installed"
mkdir -p "$1/src"
for file in Cargo.toml src/main.rs src/messages.rs; do
  cmp -s "$source/$file" "$1/$file" || cp "$source/$file" "$1/$file"
done
cd "$1"
cargo fetch --offline >/dev/null 2>&1 || CARGO_NET_RETRY=0 CARGO_HTTP_TIMEOUT=20 cargo fetch >fetch.log 2>&1 ||
  skip "the crates cannot be fetched: $(tail -1 fetch.log)"
CARGO_TARGET_DIR=target cargo build --release --offline --color never 2>build.log && exit
cat build.log
grep -qE 'requires rustc|requires a newer|newer version of Cargo' build.log && skip "this cargo is too old"
exit 1
