// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/address.hpp>
#include <chrono>
#include <list>
#include <map>

namespace citylearn {

/// A client's connection, as far as limits and deadlines need it. Used by the server's thread only.
class Connection {
 public:
  using Time = std::chrono::steady_clock::time_point;
  virtual ~Connection() = default;
  /// Closes it at once.
  virtual void close() = 0;
  /// Called periodically.
  virtual void tick(Time now) = 0;

  boost::asio::ip::address address;
  bool idle = true;                 ///< it waits for its client: it may be closed for a new one
  Time since = Time::clock::now();  ///< of `idle`, or when the client last took a part of an answer
  Time deadline = Time::max();      ///< then it is closed
};

/// Limits the connections in all and per address. At a limit the connection that has waited longest for its client is
/// closed for a new one, so that clients that send nothing, half a request, or take nothing cannot lock out others.
class Connections {
 public:
  Connections(std::size_t most, std::size_t most_each) : most_(most), most_each_(most_each) {}
  /// Makes room for a connection from `address`. Returns false when all are busy.
  bool admit(const boost::asio::ip::address& address);
  void add(Connection& connection);
  /// Does nothing for an unknown connection.
  void remove(Connection& connection);
  /// Closes those whose deadline has passed and ticks the others.
  void tick(Connection::Time now);
  std::size_t size() const { return all_.size(); }
  std::uint64_t made_room() const { return made_room_; }

 private:
  std::size_t most_, most_each_;
  std::list<Connection*> all_;  // the oldest first
  std::map<boost::asio::ip::address, std::size_t> by_address_;
  std::uint64_t made_room_ = 0;
};

}  // namespace citylearn
