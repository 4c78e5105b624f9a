#include "env_service/traversal.h"

#include <openssl/evp.h>

#include <array>
#include <bit>
#include <memory>

#include "core/error.h"

static_assert(std::endian::native == std::endian::little, "hashes are over little-endian numbers");

namespace citylearn {
namespace {

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

}  // namespace

std::uint64_t Traversal::hash() const {
  Sha256 sha;
  sha.add(dataset);
  sha.add(static_cast<std::uint64_t>(frames));
  sha.add(static_cast<std::uint64_t>(dimension));
  sha.add(features);
  sha.add(positions);
  if (images)
    for (int frame = 0; frame < frames; ++frame) sha.add(images->fingerprint(frame));
  return sha.first_8_bytes();
}

}  // namespace citylearn
