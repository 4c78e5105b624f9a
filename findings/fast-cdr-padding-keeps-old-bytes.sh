#!/usr/bin/env bash
# Fast CDR 1.0.26 (Debian 12) skips the padding before an aligned field and leaves the bytes that the buffer held before:
# they go onto the wire, and one message has several hashes. Cyclone DDS and Rust's cdr-encoding write zeros. Encode
# into zeroed memory.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
apt-get download -qq libfastcdr1=1.0.26-1 libfastcdr-dev=1.0.26-1 2>/dev/null
for package in ./*.deb; do dpkg -x "$package" .; done
cat >padding.cc <<'END'
#include <fastcdr/Cdr.h>
#include <cstdio>
#include <cstring>
int main() {
  using namespace eprosima::fastcdr;
  for (int before : {0x00, 0xAA}) {
    char bytes[8];
    std::memset(bytes, before, sizeof bytes);
    FastBuffer buffer(bytes, sizeof bytes);
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr << std::uint8_t{1} << std::uint32_t{2};
    for (const char byte : bytes) std::printf("%02x", byte & 0xFF);
    std::printf(" ");
  }
}
END
g++ -Iusr/include padding.cc -o padding usr/lib/*/libfastcdr.so.1.0.26
seen=$(LD_LIBRARY_PATH=$(echo usr/lib/*) ./padding)
echo "Fast CDR $(dpkg-deb -f libfastcdr1_*.deb Version): octet 1, unsigned long 2 over 00 and over aa: $seen"
[ "$seen" = "0100000002000000 01aaaaaa02000000 " ]
