// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cctype>
#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "core/dds/middleware.h"
#include "core/util/error.h"
#include "tests/support/wait.h"

namespace citylearn::testing {

/// A browser of the poorest kind, on a raw socket: it can also say what no browser says. Everything has a deadline.
class WebClient {
 public:
  using Headers = std::map<std::string, std::string>;  // names in lower case
  struct Response {
    int status = 0;
    Headers headers;
    std::string body;
  };
  /// A WebSocket frame of the server.
  struct Frame {
    int opcode = 0;
    std::string payload;
  };
  static constexpr std::chrono::milliseconds kTimeout{20'000 * kSlowness};

  explicit WebClient(std::uint16_t port, bool tls = false, const char* from = "127.0.0.1", int receive_buffer = 0)
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)), port_(port) {
    if (receive_buffer > 0) ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in address = at(from, 0);
    const int at_once = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &at_once, sizeof at_once);
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      throw Error("cannot bind", from);
    address = at("127.0.0.1", port);
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      throw Error("cannot connect", "port " + std::to_string(port));
    if (!tls) return;
    context_ = SSL_CTX_new(TLS_client_method());
    tls_ = SSL_new(context_);
    SSL_set_fd(tls_, socket_);
    if (SSL_connect(tls_) != 1) throw Error("no TLS", "port " + std::to_string(port));
  }
  ~WebClient() {
    if (tls_) SSL_free(tls_);
    if (context_) SSL_CTX_free(context_);
    ::close(socket_);
  }
  WebClient(const WebClient&) = delete;
  WebClient& operator=(const WebClient&) = delete;

  /// Returns false when the server no longer listens to us.
  bool send(std::string_view bytes) {
    while (!bytes.empty()) {
      ssize_t count = 0;
      if (tls_) {
        count = SSL_write(tls_, bytes.data(), static_cast<int>(bytes.size()));
      } else {
        pollfd ready{socket_, POLLOUT, 0};
        if (::poll(&ready, 1, static_cast<int>(kTimeout.count())) != 1) throw Error("the server takes nothing");
        count = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      }
      if (count <= 0) return false;
      bytes.remove_prefix(static_cast<std::size_t>(count));
    }
    return true;
  }

  Response request(const std::string& method, const std::string& target, Headers headers = {},
                   const std::string& body = "") {
    if (!headers.count("host")) headers["host"] = "localhost:" + std::to_string(port_);
    if (!body.empty()) headers["content-length"] = std::to_string(body.size());
    std::string text = method + " " + target + " HTTP/1.1\r\n";
    for (const auto& [name, value] : headers) text += name + ": " + value + "\r\n";
    send(text + "\r\n" + body);
    return read(method == "HEAD");
  }
  Response get(const std::string& target, Headers headers = {}) { return request("GET", target, std::move(headers)); }

  /// The next response; status 0 when the connection ended instead.
  Response read(bool without_body = false) {
    Response response;
    std::size_t end = 0;
    while ((end = buffer_.find("\r\n\r\n")) == std::string::npos)
      if (!receive(kTimeout)) return response;
    const std::string head = buffer_.substr(0, end + 2);
    buffer_.erase(0, end + 4);
    response.status = std::stoi(head.substr(9, 3));
    for (std::size_t line = head.find("\r\n") + 2; line < head.size();) {
      const std::size_t next = head.find("\r\n", line), colon = head.find(": ", line);
      std::string name = head.substr(line, colon - line);
      for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      response.headers[name] = head.substr(colon + 2, next - colon - 2);
      line = next + 2;
    }
    const auto length = response.headers.find("content-length");
    if (without_body || length == response.headers.end()) return response;
    const std::size_t size = std::stoul(length->second);
    while (buffer_.size() < size)
      if (!receive(kTimeout)) return Response();
    response.body = buffer_.substr(0, size);
    buffer_.erase(0, size);
    return response;
  }

  Response upgrade(Headers headers = {}, const std::string& target = "/api/live") {
    headers["upgrade"] = "websocket";
    headers["connection"] = "Upgrade";
    headers["sec-websocket-key"] = "dGhlIHNhbXBsZSBub25jZQ==";
    headers["sec-websocket-version"] = "13";
    return get(target, std::move(headers));
  }

  /// A whole masked frame: text unless told.
  bool say(std::string_view text, int opcode = 1) {
    std::string frame(1, static_cast<char>(0x80 | opcode));
    if (text.size() < 126) {
      frame += static_cast<char>(0x80 | text.size());
    } else {
      frame += static_cast<char>(0x80 | 127);
      for (int byte = 7; byte >= 0; --byte) frame += static_cast<char>(text.size() >> (8 * byte) & 0xFF);
    }
    const char mask[] = {0x12, 0x34, 0x56, 0x78};
    frame.append(mask, 4);
    for (std::size_t i = 0; i < text.size(); ++i) frame += static_cast<char>(text[i] ^ mask[i % 4]);
    return send(frame);
  }

  /// The next frame that is no ping (those are answered, unless `mute`); nothing when none came in time or it ended.
  std::optional<Frame> take(std::chrono::milliseconds patience = kTimeout, bool mute = false) {
    const Clock::time_point deadline = Clock::now() + patience;
    for (;;) {
      if (auto frame = complete()) {
        if (frame->opcode != 9) return frame;
        ++pings;
        if (!mute) say(frame->payload, 10);
        continue;
      }
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
      if (left.count() <= 0 || !receive(left)) return std::nullopt;
    }
  }

  /// The server has closed its end, within `patience`; what it says before is thrown away.
  bool ended(std::chrono::milliseconds patience = kTimeout) {
    const Clock::time_point deadline = Clock::now() + patience;
    while (!ended_) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
      if (left.count() <= 0) return false;
      receive(left);
      buffer_.clear();
    }
    return true;
  }

  int pings = 0;

 private:
  /// Status 0 when the connection ended before the last chunk.
  static sockaddr_in at(const char* host, std::uint16_t port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    ::inet_pton(AF_INET, host, &address.sin_addr);
    return address;
  }

  bool receive(std::chrono::milliseconds patience) {
    if (ended_) return false;
    char bytes[16 << 10];
    ssize_t count = 0;
    if (!tls_ || SSL_pending(tls_) == 0) {
      pollfd ready{socket_, POLLIN, 0};
      if (::poll(&ready, 1, static_cast<int>(patience.count())) != 1) return false;
    }
    count = tls_ ? SSL_read(tls_, bytes, sizeof bytes) : ::recv(socket_, bytes, sizeof bytes, 0);
    if (count <= 0) {
      ended_ = true;
      return false;
    }
    buffer_.append(bytes, static_cast<std::size_t>(count));
    return true;
  }

  std::optional<Frame> complete() {
    if (buffer_.size() < 2) return std::nullopt;
    const auto byte = [&](std::size_t i) { return static_cast<std::size_t>(static_cast<unsigned char>(buffer_[i])); };
    std::size_t length = byte(1), head = 2;
    const std::size_t more = length == 126 ? 2 : length == 127 ? 8 : 0;
    if (buffer_.size() < head + more) return std::nullopt;
    if (more > 0) length = 0;
    for (; head < 2 + more; ++head) length = length << 8 | byte(head);
    if (buffer_.size() < head + length) return std::nullopt;
    Frame frame{static_cast<int>(byte(0) & 15), buffer_.substr(head, length)};
    buffer_.erase(0, head + length);
    return frame;
  }

  int socket_;
  std::uint16_t port_;
  SSL_CTX* context_ = nullptr;
  SSL* tls_ = nullptr;
  std::string buffer_;
  bool ended_ = false;
};

}  // namespace citylearn::testing
