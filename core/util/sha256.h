// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

struct evp_md_ctx_st;

namespace citylearn {

/// Returns two hexadecimal digits a byte, in lower case.
std::string hexadecimal(std::span<const unsigned char> bytes);

/// Returns the SHA-256 of `bytes` in hexadecimal, 64 characters.
std::string sha256(std::string_view bytes);

/// SHA-256 of fields, one after the other; numbers are little-endian. Throws Error when OpenSSL lacks it.
class Sha256 {
 public:
  Sha256();
  void add(const void* bytes, std::size_t size);
  void add(std::uint64_t number) { add(&number, sizeof number); }
  /// Adds the length first, so that two fields never read as one.
  void add(const std::string& text);
  void add(const std::vector<float>& numbers);
  /// Ends the hash.
  std::uint64_t first_8_bytes();

 private:
  std::unique_ptr<evp_md_ctx_st, void (*)(evp_md_ctx_st*)> context_;
};

}  // namespace citylearn
