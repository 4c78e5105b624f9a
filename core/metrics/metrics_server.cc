// SPDX-License-Identifier: Apache-2.0
#include "core/metrics/metrics_server.h"

#include <spdlog/spdlog.h>

#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <charconv>
#include <optional>
#include <thread>

#include "core/metrics/metrics.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::chrono::seconds kDeadline{1};  // for a request to arrive and its answer to leave
constexpr std::uint32_t kMaxRequestBytes = 4096;

/// Returns nothing for what is not [ADDRESS:]PORT.
std::optional<tcp::endpoint> endpoint_of(const std::string& text) {
  const std::size_t colon = text.find(':'), begin = colon == std::string::npos ? 0 : colon + 1;
  error_code wrong;
  const auto address = asio::ip::make_address_v4(begin == 0 ? "127.0.0.1" : text.substr(0, colon), wrong);
  std::uint16_t port = 0;
  const auto [end, error] = std::from_chars(text.data() + begin, text.data() + text.size(), port);
  if (wrong || error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return tcp::endpoint(address, port);
}

auto with(error_code& error) { return asio::redirect_error(asio::use_awaitable, error); }

}  // namespace

struct MetricsServer::Impl {
  explicit Impl(const Metrics& served) : metrics(served) {}

  http::response<http::string_body> answer(const http::request<http::empty_body>& request) const {
    http::response<http::string_body> reply(http::status::ok, 11);
    reply.set(http::field::content_type, "text/plain; charset=utf-8");
    reply.set(http::field::cache_control, "no-store");
    const auto path = request.target();
    if (request.method() != http::verb::get && request.method() != http::verb::head) {
      reply.result(http::status::method_not_allowed);
      reply.body() = "use GET\n";
    } else if (path == "/metrics") {
      reply.set(http::field::content_type, "text/plain; version=0.0.4; charset=utf-8");
      reply.body() = metrics.text();
    } else if (path == "/healthz" || path == "/livez") {
      const std::string problem = metrics.problem(path == "/healthz");
      if (!problem.empty()) reply.result(http::status::service_unavailable);
      reply.body() = (problem.empty() ? "ok" : problem) + "\n";
    } else {
      reply.result(http::status::not_found);
      reply.body() = "use /metrics, /healthz or /livez\n";
    }
    reply.keep_alive(false);
    reply.prepare_payload();
    if (request.method() == http::verb::head) reply.body().clear();
    return reply;
  }

  asio::awaitable<void> serve(tcp::socket socket) {
    boost::beast::tcp_stream stream(std::move(socket));
    stream.expires_after(kDeadline);
    boost::beast::flat_buffer buffer(2 * kMaxRequestBytes);
    http::request_parser<http::empty_body> parser;
    parser.header_limit(kMaxRequestBytes);
    error_code error;
    co_await http::async_read_header(stream, buffer, parser, with(error));
    if (!error) {
      const auto reply = answer(parser.get());
      http::response_serializer<http::string_body> serializer(reply);
      co_await http::async_write(stream, serializer, with(error));
      stream.socket().shutdown(tcp::socket::shutdown_send, error);
    }
    if (open-- == kConnections) room.cancel();
  }

  asio::awaitable<void> accept() {
    while (true) {
      tcp::socket socket(io);
      error_code error;
      co_await acceptor.async_accept(socket, with(error));
      if (error) {  // no more files may be open: later there may be
        room.expires_after(kDeadline);
        co_await room.async_wait(with(error));
        continue;
      }
      ++open;
      asio::co_spawn(io, serve(std::move(socket)), asio::detached);
      while (open >= kConnections) {
        room.expires_after(kDeadline);
        co_await room.async_wait(with(error));
      }
    }
  }

  const Metrics& metrics;
  asio::io_context io{1};
  tcp::acceptor acceptor{io};
  asio::steady_timer room{io};
  int open = 0;  // connections
  std::jthread thread;
};

std::string metrics_address_problem(const std::string& text) {
  if (text.empty() || endpoint_of(text)) return "";
  return "'" + text + "' is not [ADDRESS:]PORT, an IPv4 address and a port up to 65535, as 9464 or 0.0.0.0:9464";
}

MetricsServer::MetricsServer(const Metrics& metrics, const std::string& address)
    : impl_(std::make_unique<Impl>(metrics)) {
  const std::optional<tcp::endpoint> endpoint = endpoint_of(address);
  if (!endpoint) throw Error(metrics_address_problem(address), "--metrics");
  try {
    impl_->acceptor = tcp::acceptor(impl_->io, *endpoint);
  } catch (const boost::system::system_error& error) {
    throw Error("cannot listen: " + error.code().message(), "--metrics " + address,
                "choose a free port and an address of this host");
  }
  spdlog::info("metrics: http://{}:{}/metrics", endpoint->address().to_string(),
               impl_->acceptor.local_endpoint().port());
  asio::co_spawn(impl_->io, impl_->accept(), asio::detached);
  impl_->thread = std::jthread([this] { impl_->io.run(); });
}

MetricsServer::~MetricsServer() {
  impl_->io.stop();
  impl_->thread.join();
}

}  // namespace citylearn
