// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <map>
#include <memory>

#include "dashboard/http/access.h"
#include "dashboard/http/connections.h"
#include "dashboard/http/page.h"
#include "dashboard/http/server.h"

namespace citylearn {

/// State that all connections of a server share. Used by the server's thread alone unless a comment says otherwise.
struct ServerContext {
  ServerContext(const ServerOptions& given, ClientHub& live, Server::Handlers functions)
      : options(given),
        hub(live),
        handlers(std::move(functions)),
        page(given.page),
        connections(given.connections, given.connections_each) {}

  const ServerOptions options;
  ClientHub& hub;                   // any thread
  const Server::Handlers handlers;  // any thread
  const Page page;
  std::unique_ptr<Access> access;
  Connections connections;
  std::atomic<std::size_t> calls{0};  // API calls that wait or run

  // Counts for /metrics.
  std::map<int, std::uint64_t> answers;  // by status
  std::uint64_t accepted = 0;
  std::uint64_t refused = 0;    // connections, as all were busy
  std::uint64_t malformed = 0;  // WebSocket connections closed for malformed frames or messages
  std::uint64_t timed_out = 0;  // WebSocket clients that neither took nor sent anything
  std::uint64_t guesses = 0;    // wrong tokens and login links
  std::uint64_t frame_bytes = 0;

  std::unique_ptr<boost::asio::ssl::context> tls;  // null: plain HTTP
  // Last, so that they are destroyed first: what still waits in them uses all of the above.
  boost::asio::io_context io{1};
  boost::asio::thread_pool workers{static_cast<std::size_t>(options.workers)};
};

/// Serves a connection that was admitted, in the background, until it ends.
void serve(ServerContext& context, boost::asio::ip::tcp::socket socket);

}  // namespace citylearn
