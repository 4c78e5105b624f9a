// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace citylearn {

/// Controls access to the dashboard: by its token, the cookie derived from it, and the host names it accepts. Secrets
/// are compared in constant time. Used by one thread at a time.
class Access {
 public:
  struct Options {
    std::string address;          ///< listened on: "127.0.0.1", "0.0.0.0", "::1"
    std::uint16_t port = 0;       ///< listened on
    std::string token_file;       ///< empty: no token, allowed on loopback only
    std::set<std::string> allow;  ///< further host names, without port: "gpu7.example.org"
    bool tls = false;
  };
  /// The headers of a request that identify its sender. Empty = absent.
  struct Request {
    std::string_view host;           ///< "localhost:8080"
    std::string_view origin;         ///< "http://localhost:8080"
    std::string_view authorization;  ///< "Bearer TOKEN"
    std::string_view cookie;         ///< "a=b; c=d"
  };

  /// Reads the token, or creates it (mode 0600) if the file is missing. Throws Error for an address that others can
  /// reach without a token file, for a token file that others may read, and for an invalid token.
  explicit Access(Options options);

  /// Returns why a request must be refused whatever its secrets: a foreign Host or Origin. Returns nothing for others.
  std::optional<std::string> foreign(const Request& request) const;
  /// Returns whether the request has the token or the cookie, or none is needed.
  bool allows(const Request& request) const;
  /// Returns whether `code` is the one of login_path(), and invalidates it. Each works once.
  bool redeem(std::string_view code);

  /// Returns "/login?once=CODE", or "/" when no token is needed.
  std::string login_path() const;
  /// Returns the value of Set-Cookie for an authorised client.
  std::string cookie() const;
  bool needs_token() const { return !token_.empty(); }

 private:
  bool ours(std::string_view host) const;

  Options options_;
  std::string token_, code_;  // empty: none
  std::string cookie_name_, cookie_value_;
  bool loopback_ = false, any_ = false;
};

}  // namespace citylearn
