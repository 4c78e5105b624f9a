// SPDX-License-Identifier: Apache-2.0
#include "core/wire/channels.h"

#include <algorithm>

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxWriters = 4096;  // beyond, the one that was used longest ago is deleted

}  // namespace

Topic Channels::topic(const Address& address) const {
  return address.id.empty() ? *all_ : topic_at(*all_, address.session, address.id);
}

Channels::Writer& Channels::writer(const Address& address) {
  auto found = writers_.find(address);
  if (found == writers_.end()) {
    if (writers_.size() >= kMaxWriters)
      writers_.erase(std::min_element(writers_.begin(), writers_.end(),
                                      [](const auto& a, const auto& b) { return a.second.used < b.second.used; }));
    found = writers_.emplace(address, Writer{middleware_->create_publisher(topic(address)), 0}).first;
  }
  found->second.used = Clock::now();
  return found->second;
}

void Channels::delete_idle_writers(Clock::time_point now) {
  if (addressing_ != Addressing::kReceiver) return;
  std::erase_if(writers_, [&](const auto& entry) {
    return entry.first != Address{} && !entry.second.kept && now - entry.second.used > kWriterLifetime;
  });
}

void Channels::wait_for_acknowledgments(Clock::time_point deadline) {
  for (const auto& [address, writer] : writers_) writer.publisher->wait_for_acknowledgments(deadline);
}

void Channels::create_reader(const Address& address) {
  std::unique_ptr<Subscription>& reader = readers_[address];
  if (!reader) reader = middleware_->create_subscription(topic(address));
}

void Channels::delete_reader(const Address& address) { readers_.erase(address); }

bool Channels::take(Bytes& sample) {
  auto reader = readers_.upper_bound(last_);
  for (std::size_t i = 0; i < readers_.size(); ++i, ++reader) {
    if (reader == readers_.end()) reader = readers_.begin();
    if (!reader->second->take(sample)) continue;
    last_ = reader->first;
    return true;
  }
  return false;
}

void Channels::release_topics(const Address& address) {
  writers_.erase(address);
  delete_reader(address);
}

}  // namespace citylearn
