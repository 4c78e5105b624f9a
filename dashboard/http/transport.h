// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/async_result.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/role.hpp>
#include <functional>
#include <memory>
#include <vector>

namespace boost::asio::ssl {
class context;
}

namespace citylearn {

/// A TCP connection with or without TLS, as an AsyncStream of Beast. Both are one type, and handlers are erased, so
/// that Beast's templates are instantiated once. Used by the thread of its socket.
class Transport {
 public:
  using executor_type = boost::asio::ip::tcp::socket::executor_type;
  using Error = boost::system::error_code;
  using Done = std::function<void(Error, std::size_t)>;

  /// `tls` may be null; otherwise it must outlive the transport.
  Transport(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls);
  ~Transport();
  Transport(Transport&&) noexcept;
  Transport& operator=(Transport&&) noexcept;

  boost::asio::ip::tcp::socket& socket();
  executor_type get_executor() { return socket().get_executor(); }

  template <class Buffers, class Token>
  auto async_read_some(const Buffers& buffers, Token&& token) {
    const auto begin = [this](auto handler, const std::vector<boost::asio::mutable_buffer>& parts) {
      read(parts, erased(std::move(handler)));
    };
    return boost::asio::async_initiate<Token, void(Error, std::size_t)>(begin, token,
                                                                        list<boost::asio::mutable_buffer>(buffers));
  }
  template <class Buffers, class Token>
  auto async_write_some(const Buffers& buffers, Token&& token) {
    const auto begin = [this](auto handler, const std::vector<boost::asio::const_buffer>& parts) {
      write(parts, erased(std::move(handler)));
    };
    return boost::asio::async_initiate<Token, void(Error, std::size_t)>(begin, token,
                                                                        list<boost::asio::const_buffer>(buffers));
  }
  /// Accepts TLS; succeeds at once without it.
  template <class Token>
  auto async_handshake(Token&& token) {
    const auto begin = [this](auto handler) { handshake(erased_error(std::move(handler))); };
    return boost::asio::async_initiate<Token, void(Error)>(begin, token);
  }

  // What websocket::stream expects of its next layer.
  friend void beast_close_socket(Transport& transport) {
    Error none;
    transport.socket().close(none);
  }
  friend void teardown(boost::beast::role_type, Transport& transport, Error& error) { transport.socket().close(error); }
  template <class Handler>
  friend void async_teardown(boost::beast::role_type, Transport& transport, Handler&& handler) {
    transport.shut_down(erased_error(std::forward<Handler>(handler)));
  }

 private:
  struct Impl;

  // std::function copies, handlers only move.
  template <class Handler>
  static Done erased(Handler handler) {
    return [shared = std::make_shared<Handler>(std::move(handler))](Error error, std::size_t bytes) {
      (*shared)(error, bytes);
    };
  }
  template <class Handler>
  static std::function<void(Error)> erased_error(Handler&& handler) {
    return [shared = std::make_shared<std::decay_t<Handler>>(std::forward<Handler>(handler))](Error error) {
      (*shared)(error);
    };
  }
  template <class Buffer, class Buffers>
  static std::vector<Buffer> list(const Buffers& buffers) {
    return {boost::asio::buffer_sequence_begin(buffers), boost::asio::buffer_sequence_end(buffers)};
  }
  void read(const std::vector<boost::asio::mutable_buffer>& buffers, Done done);
  void write(const std::vector<boost::asio::const_buffer>& buffers, Done done);
  void handshake(std::function<void(Error)> done);
  void shut_down(std::function<void(Error)> done);

  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
