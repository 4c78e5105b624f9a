// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/message_stream.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>

#include "core/exchange/timing.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/ipv4.h"

namespace citylearn {
namespace {

constexpr std::array<char, 4> kMark = {'C', 'L', 'R', 'K'};
constexpr std::size_t kHead = kMark.size() + 4;
constexpr std::size_t kMaxMessageBytes = std::size_t{64} << 20;  // of a message

sockaddr_in socket_address(const RankAddress& address) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(static_cast<std::uint16_t>(address.port));
  ::inet_pton(AF_INET, address.host.c_str(), &result.sin_addr);
  return result;
}

template <class Call>
int with_address(const RankAddress& address, int socket, const Call& call) {
  const sockaddr_in to = socket_address(address);
  return call(socket, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}

sockaddr_in name_of(int socket) {
  sockaddr_in name{};
  socklen_t size = sizeof name;
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&name), &size);
  return name;
}

void set_option(int socket, int level, int option) {
  const int on = 1;
  ::setsockopt(socket, level, option, &on, sizeof on);
}

}  // namespace

RankAddress parse_rank_address(const std::string& text, const std::string& where) {
  const std::size_t colon = text.rfind(':');
  RankAddress address;
  if (colon != text.npos && colon > 0) {
    const char *begin = text.data() + colon + 1, *end = text.data() + text.size();
    const auto [rest, problem] = std::from_chars(begin, end, address.port);
    if (problem != std::errc() || rest != end) address.port = 0;
  }
  if (address.port < 1 || address.port > 65535) throw Error("'" + text + "' is not HOST:PORT", where);
  const std::string host = text.substr(0, colon);
  const Ipv4Lookup found = find_ipv4(host);
  if (found.addresses.empty()) throw Error("'" + host + "' is unknown: " + found.problem, where);
  address.host = found.addresses.front();
  return address;
}

std::string local_host_towards(const RankAddress& to) {
  const OwnedSocket socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (with_address(to, socket.get(), ::connect) != 0)
    throw Error("cannot be reached from here: " + std::string(std::strerror(errno)), to.text());
  return dotted(name_of(socket.get()).sin_addr);
}

OwnedSocket::~OwnedSocket() {
  if (socket_ >= 0) ::close(socket_);
}

OwnedSocket listen_at(RankAddress& address) {
  OwnedSocket socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  set_option(socket.get(), SOL_SOCKET, SO_REUSEADDR);
  if (with_address(address, socket.get(), ::bind) != 0 || ::listen(socket.get(), 128) != 0) return OwnedSocket();
  address.port = ntohs(name_of(socket.get()).sin_port);
  return socket;
}

OwnedSocket connect_to(const RankAddress& address) {
  OwnedSocket socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (with_address(address, socket.get(), ::connect) != 0) {
    if (errno != EINPROGRESS) return OwnedSocket();
    pollfd ready{socket.get(), POLLOUT, 0};
    int problem = 0;
    socklen_t size = sizeof problem;
    if (::poll(&ready, 1, static_cast<int>(kRankConnect.count())) != 1 ||
        ::getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &problem, &size) != 0 || problem != 0)
      return OwnedSocket();
  }
  // A port that nobody listens at may be the one that this very socket was given.
  const sockaddr_in mine = name_of(socket.get()), theirs = socket_address(address);
  if (mine.sin_port == theirs.sin_port && mine.sin_addr.s_addr == theirs.sin_addr.s_addr) return OwnedSocket();
  set_option(socket.get(), IPPROTO_TCP, TCP_NODELAY);
  return socket;
}

OwnedSocket accept_from(const OwnedSocket& listener) {
  OwnedSocket socket(::accept4(listener.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (socket) set_option(socket.get(), IPPROTO_TCP, TCP_NODELAY);
  return socket;
}

void MessageStream::send(const nlohmann::json& message) {
  const std::string text = message.dump();
  const auto size = static_cast<std::uint32_t>(text.size());
  output_.append(kMark.data(), kMark.size());
  for (int shift = 24; shift >= 0; shift -= 8) output_ += static_cast<char>(size >> shift & 0xFF);
  output_ += text;
  flush();
}

void MessageStream::flush() {
  while (sending()) {
    const ssize_t count = ::send(socket_.get(), output_.data() + sent_, output_.size() - sent_, MSG_NOSIGNAL);
    if (count <= 0) {
      if (count < 0 && errno == EINTR) continue;
      if (count < 0 && errno != EAGAIN) output_.clear(), sent_ = 0;  // receive() sees that it is over
      return;
    }
    sent_ += static_cast<std::size_t>(count);
  }
  output_.clear();
  sent_ = 0;
}

bool MessageStream::receive(std::vector<nlohmann::json>& messages) {
  bool open = true;
  std::array<char, 65536> buffer;
  while (open) {
    const ssize_t count = ::recv(socket_.get(), buffer.data(), buffer.size(), 0);
    if (count > 0) {
      input_.append(buffer.data(), static_cast<std::size_t>(count));
    } else if (count == 0 || (errno != EAGAIN && errno != EINTR)) {
      open = false;
    } else if (errno == EAGAIN) {
      break;
    }
  }
  std::size_t begin = 0;
  while (!foreign_ && input_.size() - begin >= kMark.size()) {
    std::size_t size = 0;
    foreign_ = input_.compare(begin, kMark.size(), kMark.data(), kMark.size()) != 0;
    if (foreign_ || input_.size() - begin < kHead) break;
    for (std::size_t i = kMark.size(); i < kHead; ++i) size = size << 8 | static_cast<unsigned char>(input_[begin + i]);
    foreign_ = size > kMaxMessageBytes;
    if (foreign_ || input_.size() - begin < kHead + size) break;
    nlohmann::json message = parse_json_or_null(std::string_view(input_).substr(begin + kHead, size));
    foreign_ = !message.is_object();
    if (!foreign_) messages.push_back(std::move(message));
    begin += kHead + size;
  }
  input_.erase(0, begin);
  return open && !foreign_;
}

}  // namespace citylearn
