// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <string>

#include "dashboard/http/answer.h"
#include "dashboard/http/client_hub.h"

namespace citylearn {

struct ServerOptions {
  // Address and access.
  std::string listen = "127.0.0.1";   ///< address; any but loopback needs a token file
  std::uint16_t port = 8080;          ///< 0 picks a free one
  std::string token_file;             ///< created if missing; empty: everyone on this machine has access
  std::set<std::string> allow_hosts;  ///< further host names
  std::string tls_certificate;        ///< PEM, the chain; with tls_key everything is HTTPS
  std::string tls_key;                ///< PEM
  std::string page;                   ///< folder of the built page

  // Bounds (docs/reference/dashboard-api.md, "Access").
  std::size_t connections = 1024;
  std::size_t connections_each = 256;  ///< of one address
  std::uint32_t header_bytes = 32 << 10;
  std::size_t body_bytes = 64 << 10;
  std::size_t message_bytes = 64 << 10;  ///< of a WebSocket client's message
  std::chrono::milliseconds request_time{
      30'000};                                 ///< for a request to arrive, and for each part of the answer to leave
  std::chrono::milliseconds ping{10'000};      ///< between pings
  std::chrono::milliseconds patience{30'000};  ///< with a WebSocket client that neither takes nor sends anything
  int workers = 2;                             ///< threads that answer the API
  std::size_t waiting = 128;                   ///< API requests that wait for a worker
};

/// Serves page, API and live messages on one port (docs/reference/dashboard-api.md). One thread does all input and
/// output, `workers` others answer the API, so that neither a slow query nor a slow client delays others.
class Server {
 public:
  struct Handlers {
    std::function<Answer(const Query&)> api;  ///< by several threads at once; an exception becomes a 500
    std::function<std::string()> metrics;     ///< further lines for /metrics, likewise; may be empty
    /// Returns why the dashboard is not well, for /healthz (alarms count) and /livez; at once; may be empty.
    std::function<std::string(bool alarms)> problem{};
  };
  /// Listens when it returns. Throws Error when it cannot: the port is in use, a file cannot be read, a token is
  /// missing or readable by others. `hub` must outlive the server.
  Server(const ServerOptions& options, ClientHub& hub, Handlers handlers);
  /// Closes every connection; waits for running API calls.
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  std::uint16_t port() const;
  /// Returns "http://127.0.0.1:8080", or localhost when it listens on every address.
  std::string url() const;
  /// Returns the link to open: url() + "/", or the link that logs in once.
  std::string link() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
