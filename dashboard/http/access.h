// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace citylearn {

/// Who may ask the dashboard: its token and what follows from it, and the names under which it may be called.
/// Secrets are compared in constant time. Used by one thread at a time.
class Access {
 public:
  struct Options {
    std::string address;          ///< listened on: "127.0.0.1", "0.0.0.0", "::1"
    std::uint16_t port = 0;       ///< listened on
    std::string token_file;       ///< empty: no token, possible on loopback alone
    std::set<std::string> allow;  ///< further names in Host, without port: "gpu7.example.org"
    bool tls = false;
  };
  /// What a request says of who sends it. Empty = absent.
  struct Request {
    std::string_view host;           ///< "localhost:8080"
    std::string_view origin;         ///< "http://localhost:8080"
    std::string_view authorization;  ///< "Bearer TOKEN"
    std::string_view cookie;         ///< "a=b; c=d"
  };

  /// Reads the token (or makes it, mode 0600, where the file is not there). Throws Error for an address that others
  /// reach without a token file, for a token file that others may read, and for a token that is no token.
  explicit Access(Options options);

  /// Why a request must be refused whatever secrets it knows: a Host or an Origin that is not ours. Nothing: go on.
  std::optional<std::string> stranger(const Request& request) const;
  /// It knows the token, or has the cookie, or none is needed.
  bool knows(const Request& request) const;
  /// Uses up `code` and tells whether it was the one of login_path(). Each works once.
  bool redeem(std::string_view code);

  /// "/login?once=CODE"; "/" where no token is needed.
  std::string login_path() const;
  /// Value of Set-Cookie for who may have it.
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
