// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace citylearn {

/// An IPv4 address with a port.
struct RankAddress {
  std::string host;  ///< in numbers
  int port = 0;

  std::string text() const { return host + ":" + std::to_string(port); }
  bool operator==(const RankAddress&) const = default;
};

/// Returns the address of "HOST:PORT", a name or numbers. Throws Error with `where` when it is something else.
RankAddress parse_rank_address(const std::string& text, const std::string& where);
/// Returns the address of this host from which messages to `to` go. Sends nothing.
std::string local_host_towards(const RankAddress& to);

/// A socket that is closed with its owner.
class OwnedSocket {
 public:
  explicit OwnedSocket(int socket = -1) : socket_(socket) {}
  ~OwnedSocket();
  OwnedSocket(OwnedSocket&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  OwnedSocket& operator=(OwnedSocket&& other) noexcept {
    std::swap(socket_, other.socket_);
    return *this;
  }
  explicit operator bool() const { return socket_ >= 0; }
  int get() const { return socket_; }

 private:
  int socket_;
};

/// Returns a socket that listens; none when the address is taken or not of this host. Port 0 becomes a free one.
OwnedSocket listen_at(RankAddress& address);
/// Returns a connection, or none within 300 ms.
OwnedSocket connect_to(const RankAddress& address);
/// Returns the next connection that waits at a listening socket, or none.
OwnedSocket accept_from(const OwnedSocket& listener);

/// JSON objects over a TCP connection, each after a mark and its length. It never blocks. Used by one thread.
class MessageStream {
 public:
  explicit MessageStream(OwnedSocket socket) : socket_(std::move(socket)) {}

  int descriptor() const { return socket_.get(); }
  void send(const nlohmann::json& message);
  bool sending() const { return sent_ < output_.size(); }  ///< whether something waits for room in the connection
  void flush();
  /// Appends the messages that have arrived. Returns false when the connection is over, or what came is none of ours.
  bool receive(std::vector<nlohmann::json>& messages);
  bool foreign() const { return foreign_; }  ///< whether something came that is none of ours

 private:
  OwnedSocket socket_;
  std::string input_, output_;
  std::size_t sent_ = 0;
  bool foreign_ = false;
};

}  // namespace citylearn
