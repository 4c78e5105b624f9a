// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/server.h"

#include <openssl/err.h>
#include <openssl/ssl.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <thread>

#include "core/files/files.h"
#include "core/util/error.h"
#include "dashboard/http/server_context.h"

namespace citylearn {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

std::unique_ptr<asio::ssl::context> open_tls(const ServerOptions& options) {
  const std::string &certificate = options.tls_certificate, &key = options.tls_key;
  if (certificate.empty() && key.empty()) return nullptr;
  if (certificate.empty() || key.empty()) throw Error("both are needed", "--tls-cert, --tls-key", "give both");
  refuse_special_file(certificate);
  refuse_special_file(key);
  auto context = std::make_unique<asio::ssl::context>(asio::ssl::context::tls_server);
  error_code wrong;
  context->set_options(asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 |
                       asio::ssl::context::no_tlsv1_1 | asio::ssl::context::single_dh_use);
  // So that idle clients keep no buffers.
  SSL_CTX_set_mode(context->native_handle(), SSL_MODE_RELEASE_BUFFERS);
  context->use_certificate_chain_file(certificate, wrong);
  if (wrong)
    throw Error("is not a readable certificate: " + wrong.message(), "--tls-cert " + certificate, "a PEM file");
  context->use_private_key_file(key, asio::ssl::context::pem, wrong);
  if (wrong)
    throw Error("is not a readable key of that certificate: " + wrong.message(), "--tls-key " + key,
                "a PEM file without a password");
  return context;
}

const char kBusy[] =
    "HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\nContent-Length: 43\r\nRetry-After: 5\r\n"
    "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n{\"error\": \"too many "
    "connections are busy\"}\n";

}  // namespace

struct Server::Impl {
  Impl(const ServerOptions& options, ClientHub& hub, Handlers handlers)
      : context(options, hub, std::move(handlers)), acceptor(context.io), ticker(context.io) {}

  void open();
  asio::awaitable<void> accept();
  asio::awaitable<void> tick();

  ServerContext context;
  tcp::acceptor acceptor;
  asio::steady_timer ticker;
  tcp::endpoint endpoint;
  std::string url, login;
  std::thread thread;
};

void Server::Impl::open() {
  const ServerOptions& options = context.options;
  Access::Options access{options.listen, options.port, options.token_file, options.allow_hosts, false};
  context.tls = open_tls(options);
  access.tls = context.tls != nullptr;
  error_code wrong;
  const auto address = asio::ip::make_address(options.listen, wrong);
  if (!wrong) {
    const std::string where = "--listen " + options.listen + " --port " + std::to_string(options.port);
    const auto check = [&] {
      if (wrong == asio::error::address_in_use)
        throw Error("the port is in use", where, "is another dashboard running? --port 0 picks a free one");
      if (wrong) throw Error("cannot listen there: " + wrong.message(), where);
    };
    endpoint = tcp::endpoint(address, options.port);
    acceptor.open(endpoint.protocol(), wrong);
    check();
    acceptor.set_option(tcp::acceptor::reuse_address(true));
    acceptor.bind(endpoint, wrong);
    check();
    endpoint = acceptor.local_endpoint();
    access.port = endpoint.port();
    context.access = std::make_unique<Access>(access);
    login = context.access->login_path();
    std::string host = address.is_unspecified() ? "localhost" : address.to_string();
    if (host.find(':') != std::string::npos) host = "[" + host + "]";
    url = (access.tls ? "https://" : "http://") + host + ":" + std::to_string(access.port);
    if (!access.tls && !address.is_loopback())
      spdlog::warn("the token is sent unencrypted: give --tls-cert and --tls-key where others can intercept it");
    acceptor.listen(asio::socket_base::max_listen_connections, wrong);
    check();
  } else {
    context.access = std::make_unique<Access>(access);  // reports what is wrong with the address
  }
}

asio::awaitable<void> Server::Impl::accept() {
  for (;;) {
    tcp::socket socket(context.io);
    error_code error;
    co_await acceptor.async_accept(socket, asio::redirect_error(asio::use_awaitable, error));
    if (error == asio::error::operation_aborted) co_return;
    if (error) {
      // No more files may be open: new clients wait until a connection ends.
      asio::steady_timer pause(context.io, std::chrono::milliseconds(100));
      co_await pause.async_wait(asio::redirect_error(asio::use_awaitable, error));
      continue;
    }
    const tcp::endpoint client = socket.remote_endpoint(error);
    if (error) continue;  // gone already
    socket.set_option(tcp::no_delay(true), error);
    if (!context.connections.admit(client.address())) {
      ++context.refused;
      ++context.answers[503];
      socket.non_blocking(true, error);
      if (!context.tls) socket.write_some(asio::buffer(kBusy, sizeof kBusy - 1), error);
      continue;
    }
    ++context.accepted;
    serve(context, std::move(socket));
  }
}

asio::awaitable<void> Server::Impl::tick() {
  const ServerOptions& options = context.options;
  const auto shortest = std::min({options.request_time, options.ping, options.patience});
  const auto period = std::clamp<std::chrono::milliseconds>(shortest / 8, std::chrono::milliseconds(5),
                                                            std::chrono::milliseconds(1000));
  for (error_code error; !error;) {
    ticker.expires_after(period);
    co_await ticker.async_wait(asio::redirect_error(asio::use_awaitable, error));
    context.connections.tick(Connection::Time::clock::now());
  }
}

Server::Server(const ServerOptions& options, ClientHub& hub, Handlers handlers)
    : impl_(std::make_unique<Impl>(options, hub, std::move(handlers))) {
  Impl& impl = *impl_;
  impl.open();
  asio::co_spawn(
      impl.context.io, [&impl] { return impl.accept(); }, asio::detached);
  asio::co_spawn(
      impl.context.io, [&impl] { return impl.tick(); }, asio::detached);
  impl.thread = std::thread([&impl] { impl.context.io.run(); });
}

Server::~Server() {
  impl_->context.io.stop();
  impl_->thread.join();
  impl_->context.workers.stop();
  impl_->context.workers.join();
}

std::uint16_t Server::port() const { return impl_->endpoint.port(); }

std::string Server::url() const { return impl_->url; }

std::string Server::link() const { return impl_->url + impl_->login; }

}  // namespace citylearn
