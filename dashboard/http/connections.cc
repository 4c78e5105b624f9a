// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/connections.h"

#include <algorithm>
#include <vector>

namespace citylearn {

bool Connections::admit(const boost::asio::ip::address& address) {
  const auto count = by_address_.find(address);
  const bool too_many_each = count != by_address_.end() && count->second >= most_each_;
  if (!too_many_each && all_.size() < most_) return true;
  Connection* longest = nullptr;
  for (Connection* connection : all_) {
    if (!connection->idle || (too_many_each && connection->address != address)) continue;
    if (!longest || connection->since < longest->since) longest = connection;
  }
  if (!longest) return false;
  ++made_room_;
  longest->close();
  return true;
}

void Connections::add(Connection& connection) {
  all_.push_back(&connection);
  ++by_address_[connection.address];
}

void Connections::remove(Connection& connection) {
  const auto found = std::find(all_.begin(), all_.end(), &connection);
  if (found == all_.end()) return;
  all_.erase(found);
  const auto count = by_address_.find(connection.address);
  if (--count->second == 0) by_address_.erase(count);
}

void Connections::tick(Connection::Time now) {
  const std::vector<Connection*> all(all_.begin(), all_.end());  // closing one takes it from the list
  for (Connection* connection : all)
    if (connection->deadline < now)
      connection->close();
    else
      connection->tick(now);
}

}  // namespace citylearn
