// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/evp.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/util/error.h"

namespace citylearn {

/// SHA-256 of fields, one after the other; numbers are little endian.
class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), EVP_MD_CTX_free) {
    check(EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr));
  }

  void add(const void* bytes, std::size_t size) { check(EVP_DigestUpdate(context_.get(), bytes, size)); }
  void add(std::uint64_t number) { add(&number, sizeof number); }
  /// Its length goes first, so that two fields never read as one.
  void add(const std::string& text) {
    add(std::uint64_t{text.size()});
    add(text.data(), text.size());
  }
  void add(const std::vector<float>& numbers) {
    add(std::uint64_t{numbers.size()});
    add(numbers.data(), numbers.size() * sizeof(float));
  }
  /// Ends it.
  std::uint64_t first_8_bytes() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    check(EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr));
    std::uint64_t number = 0;
    for (int i = 0; i < 8; ++i) number = number << 8 | digest[i];
    return number;
  }

 private:
  static void check(int status) {
    if (status != 1) throw Error("OpenSSL has no SHA-256", "hash of a traversal", "check the OpenSSL configuration");
  }
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace citylearn
