#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds a program in Rust: cargo.sh SOURCE FOLDER. Its crates come by cargo's own configuration, the first time from a
# registry, later from cargo's cache. Exits with 77 and a reason where cargo or the crates are missing.
set -eu
skip() {
  echo "skipped: $1"
  exit 77
}
command -v cargo >/dev/null || skip "cargo is not installed"
mkdir -p "$2/src"
for file in "$1/Cargo.toml" "$1"/src/*; do
  copy=$2${file#"$1"}
  cmp -s "$file" "$copy" || cp "$file" "$copy"
done
cd "$2"
cargo fetch --offline >/dev/null 2>&1 || CARGO_NET_RETRY=0 CARGO_HTTP_TIMEOUT=20 cargo fetch >fetch.log 2>&1 ||
  skip "the crates cannot be fetched: $(tail -1 fetch.log)"
CARGO_TARGET_DIR=target cargo build --release --offline --color never 2>build.log && exit
cat build.log
grep -qE 'requires rustc|requires a newer|newer version of Cargo' build.log && skip "this cargo is too old"
exit 1
