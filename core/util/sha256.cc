// SPDX-License-Identifier: Apache-2.0
#include "core/util/sha256.h"

#include <openssl/evp.h>
#include <openssl/sha.h>

#include <array>
#include <bit>

#include "core/util/error.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "hashes are over little-endian numbers");

void check(int status) {
  if (status != 1) throw Error("OpenSSL has no SHA-256", "", "check the OpenSSL configuration");
}

}  // namespace

std::string hexadecimal(std::span<const unsigned char> bytes) {
  std::string text;
  for (const unsigned char byte : bytes)
    for (const int digit : {byte >> 4, byte & 15}) text += "0123456789abcdef"[digit];
  return text;
}

std::string sha256(std::string_view bytes) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), digest);
  return hexadecimal(digest);
}

Sha256::Sha256() : context_(EVP_MD_CTX_new(), EVP_MD_CTX_free) {
  check(EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr));
}

void Sha256::add(const void* bytes, std::size_t size) { check(EVP_DigestUpdate(context_.get(), bytes, size)); }

void Sha256::add(const std::string& text) {
  add(std::uint64_t{text.size()});
  add(text.data(), text.size());
}

void Sha256::add(const std::vector<float>& numbers) {
  add(std::uint64_t{numbers.size()});
  add(numbers.data(), numbers.size() * sizeof(float));
}

std::uint64_t Sha256::first_8_bytes() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  check(EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr));
  std::uint64_t number = 0;
  for (std::size_t i = 0; i < 8; ++i) number = number << 8 | digest[i];
  return number;
}

}  // namespace citylearn
