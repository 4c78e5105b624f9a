// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/transport.h"

#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <optional>

namespace citylearn {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;

struct Transport::Impl {
  Impl(tcp::socket connected, asio::ssl::context* context) : socket(std::move(connected)) {
    if (context) tls.emplace(socket, *context);
  }
  tcp::socket socket;
  std::optional<asio::ssl::stream<tcp::socket&>> tls;
};

Transport::Transport(tcp::socket socket, asio::ssl::context* tls)
    : impl_(std::make_unique<Impl>(std::move(socket), tls)) {}
Transport::~Transport() = default;
Transport::Transport(Transport&&) noexcept = default;
Transport& Transport::operator=(Transport&&) noexcept = default;

tcp::socket& Transport::socket() { return impl_->socket; }

void Transport::read(const std::vector<asio::mutable_buffer>& buffers, Done done) {
  impl_->tls ? impl_->tls->async_read_some(buffers, std::move(done))
             : impl_->socket.async_read_some(buffers, std::move(done));
}

void Transport::write(const std::vector<asio::const_buffer>& buffers, Done done) {
  impl_->tls ? impl_->tls->async_write_some(buffers, std::move(done))
             : impl_->socket.async_write_some(buffers, std::move(done));
}

void Transport::handshake(std::function<void(Error)> done) {
  if (impl_->tls)
    impl_->tls->async_handshake(asio::ssl::stream_base::server, std::move(done));
  else
    asio::post(impl_->socket.get_executor(), [done = std::move(done)] { done({}); });
}

void Transport::shut_down(std::function<void(Error)> done) {
  if (impl_->tls)
    impl_->tls->async_shutdown(std::move(done));
  else
    beast::websocket::async_teardown(beast::role_type::server, impl_->socket, std::move(done));
}

}  // namespace citylearn
