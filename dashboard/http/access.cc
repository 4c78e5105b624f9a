// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/access.h"

#include <fcntl.h>
#include <openssl/crypto.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cerrno>
#include <cstring>

#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

constexpr std::size_t kMinTokenLength = 16, kMaxTokenLength = 1024;

std::string random_text(std::size_t bytes) {
  unsigned char random[32];
  if (RAND_bytes(random, static_cast<int>(bytes)) != 1) throw Error("no random numbers for a secret", "OpenSSL");
  return hexadecimal({random, bytes});
}

/// Compares digests, so that the time it takes does not reveal even the length.
bool same_secret(std::string_view a, std::string_view b) {
  const std::string first = sha256(a), second = sha256(b);
  return CRYPTO_memcmp(first.data(), second.data(), first.size()) == 0;
}

std::string create_token(const std::string& path) {
  std::string token = random_text(32);
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (file < 0) throw Error(std::string("cannot create it: ") + std::strerror(errno), "--token-file " + path);
  const std::string line = token + "\n";
  const bool written = ::write(file, line.data(), line.size()) == static_cast<ssize_t>(line.size()) && fsync(file) == 0;
  ::close(file);
  if (!written) {
    ::unlink(path.c_str());
    throw Error("cannot write it", "--token-file " + path, "is there space?");
  }
  return token;
}

std::string read_token(const std::string& path) {
  const std::string where = "--token-file " + path;
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0 && errno == ENOENT) return create_token(path);
  if (file < 0) throw Error(std::string("cannot read it: ") + std::strerror(errno), where);
  struct stat facts {};
  std::string token(kMaxTokenLength + 2, '\0');
  const bool known = ::fstat(file, &facts) == 0;
  const ssize_t count = ::read(file, token.data(), token.size());
  ::close(file);
  if (!known || count < 0 || !S_ISREG(facts.st_mode)) throw Error("is not a readable file", where);
  if ((facts.st_mode & 077) != 0) throw Error("others may read it", where, "chmod 600 " + path);
  token.resize(static_cast<std::size_t>(count));
  while (!token.empty() && (token.back() == '\n' || token.back() == '\r')) token.pop_back();
  const bool plain = std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < '\x7F'; });
  if (!plain || token.size() < kMinTokenLength || token.size() > kMaxTokenLength)
    throw Error("holds no valid token", where, "one line of 16 to 1024 letters and digits; delete it to get a new one");
  return token;
}

/// "localhost" of "localhost:8080", "::1" of "[::1]:8080"; empty for what is neither.
std::string name_of(std::string_view host) {
  std::string_view port;
  std::string name;
  if (!host.empty() && host[0] == '[') {
    const std::size_t end = host.find(']');
    if (end == std::string_view::npos) return "";
    name = host.substr(1, end - 1);
    port = host.substr(end + 1);
  } else {
    const std::size_t colon = host.find(':');
    name = host.substr(0, colon);
    if (colon != std::string_view::npos) port = host.substr(colon);
  }
  if (!port.empty() && (port[0] != ':' || port.find_first_not_of("0123456789", 1) != std::string_view::npos)) return "";
  return lower(name);
}

}  // namespace

Access::Access(Options options) : options_(std::move(options)) {
  boost::system::error_code wrong;
  const auto address = boost::asio::ip::make_address(options_.address, wrong);
  if (wrong)
    throw Error("'" + options_.address + "' is not an address", "--listen", "a number, as 127.0.0.1, 0.0.0.0 or ::1");
  loopback_ = address.is_loopback();
  any_ = address.is_unspecified();
  if (!loopback_ && options_.token_file.empty())
    throw Error("others could look", "--listen " + options_.address,
                "add --token-file FILE; it is made where it is not there");
  std::set<std::string> allowed;
  for (const std::string& name : options_.allow) allowed.insert(lower(name));
  options_.allow = std::move(allowed);
  if (options_.token_file.empty()) return;
  token_ = read_token(options_.token_file);
  code_ = random_text(16);
  // Cookies do not know ports: two dashboards on one host would take each other's.
  cookie_name_ = "citylearn_" + std::to_string(options_.port);
  // Made from the token, so that it outlives this process, ends with the token, and does not tell it.
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int length = 0;
  static const std::string purpose = "citylearn dashboard cookie";
  HMAC(EVP_sha256(), token_.data(), static_cast<int>(token_.size()),
       reinterpret_cast<const unsigned char*>(purpose.data()), purpose.size(), digest, &length);
  cookie_value_ = hexadecimal({digest, length});
}

bool Access::ours(std::string_view host) const {
  const std::string name = name_of(host);
  if (name.empty()) return false;
  if (name == "localhost" || name == options_.address || options_.allow.count(name)) return true;
  boost::system::error_code wrong;
  const auto address = boost::asio::ip::make_address(name, wrong);
  if (wrong) return false;
  // Only names can be bound to another address behind a browser's back. [::1] and 127.0.0.2 reach us or nothing.
  return any_ || address.is_loopback();
}

std::optional<std::string> Access::foreign(const Request& request) const {
  if (!ours(request.host))
    return "Host '" + std::string(request.host) + "' is not a name of this dashboard (--allow-host NAME adds one)";
  if (request.origin.empty()) return std::nullopt;
  // A proxy in front of us may speak HTTPS for us.
  const std::string origin = lower(std::string(request.origin)), host = lower(std::string(request.host));
  if (origin == "https://" + host || (!options_.tls && origin == "http://" + host)) return std::nullopt;
  return "Origin '" + std::string(request.origin) + "' is not this dashboard's page";
}

bool Access::allows(const Request& request) const {
  if (token_.empty()) return true;
  constexpr std::string_view kScheme = "bearer ";
  if (lower(std::string(request.authorization.substr(0, kScheme.size()))) == kScheme)
    return same_secret(request.authorization.substr(kScheme.size()), token_);
  for (std::string_view rest = request.cookie; !rest.empty();) {
    const std::size_t end = rest.find(';');
    std::string_view pair = rest.substr(0, end);
    rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
    while (!pair.empty() && pair.front() == ' ') pair.remove_prefix(1);
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos || pair.substr(0, equals) != cookie_name_) continue;
    if (same_secret(pair.substr(equals + 1), cookie_value_)) return true;
  }
  return false;
}

bool Access::redeem(std::string_view code) {
  if (code_.empty() || !same_secret(code, code_)) return false;
  code_.clear();
  return true;
}

std::string Access::login_path() const { return token_.empty() ? "/" : "/login?once=" + code_; }

std::string Access::cookie() const {
  return cookie_name_ + "=" + cookie_value_ + "; Path=/; HttpOnly; SameSite=Strict" + (options_.tls ? "; Secure" : "");
}

}  // namespace citylearn
