#include "tools/paper/sha256.h"

#include <openssl/sha.h>
#include <spdlog/fmt/fmt.h>

namespace citylearn::paper {

std::string sha256(std::string_view bytes) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), digest);
  std::string text;
  for (const unsigned char byte : digest) text += fmt::format("{:02x}", byte);
  return text;
}

}  // namespace citylearn::paper
