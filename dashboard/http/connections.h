// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/address.hpp>
#include <chrono>
#include <list>
#include <map>

namespace citylearn {

/// One client's connection as the doorkeeper sees it. Used by the server's thread alone.
class Connection {
 public:
  using Time = std::chrono::steady_clock::time_point;
  virtual ~Connection() = default;
  /// Ends it now, whatever it is doing.
  virtual void close() = 0;
  /// Called now and then.
  virtual void tick(Time now) = 0;

  boost::asio::ip::address address;
  bool idle = true;                 ///< nothing is asked of us: it may be closed for a newcomer
  Time since = Time::clock::now();  ///< of `idle`
  Time deadline = Time::max();      ///< closed when it has passed
};

/// Who is connected, and who may come in: so many in all and of one address. Where that is reached the one that has
/// been idle longest makes room, so that those who connect and say nothing cannot lock out the others.
class Connections {
 public:
  Connections(std::size_t most, std::size_t most_each) : most_(most), most_each_(most_each) {}
  /// Room for one of `address`; false when all are busy.
  bool admit(const boost::asio::ip::address& address);
  void add(Connection& connection);
  /// Does nothing for one that is not there.
  void remove(Connection& connection);
  /// Closes those whose deadline has passed, and lets the others tick.
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
