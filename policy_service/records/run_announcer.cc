// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/run_announcer.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/exchange/timing.h"

namespace citylearn {

RunAnnouncer::RunAnnouncer(Node& node, const Run& run) : node_(node), first_(run.updates + 1) {
  node_.create_writer<msg::TrainingStat>();
  node_.create_reader<msg::TrainingStatRequest>();
  info_.agent() = run.agent.c_str();
  info_.learner() = run.learner.c_str();
  info_.seed() = run.seed;
  info_.run_id() = run.run_id;
  info_.updates() = run.updates;
  if (run.manifest.size() <= msg::MAX_CHUNK)
    info_.manifest().assign(run.manifest.begin(), run.manifest.end());
  else
    spdlog::warn("the manifest has {} bytes and is not announced (at most {})", run.manifest.size(), msg::MAX_CHUNK);
  send_info();
}

void RunAnnouncer::add(msg::TrainingStat& stat) {
  stat.run_id() = info_.run_id();
  node_.publish(stat);
  node_.metrics().set(stat);
  info_.updates() = stat.update();
  Bytes bytes;
  encode(stat, bytes);  // all are of one size, as their headers name one sender
  size_ = bytes.size();
  stats_.insert(stats_.end(), bytes.begin(), bytes.end());
}

void RunAnnouncer::handle() {
  while (node_.take(request_)) {
    if (request_.policy() != node_.options().id || request_.policy_incarnation() != node_.incarnation() ||
        request_.run_id() != info_.run_id())
      continue;
    const std::uint64_t kept = size_ > 0 ? stats_.size() / size_ : 0;
    const std::uint64_t first = std::max<std::uint64_t>(request_.first(), first_);
    for (std::uint64_t update = first; update - first < msg::MAX_STATS_ASKED; ++update) {
      if (update > request_.last() || update - first_ >= kept) break;
      decode(std::span<const std::byte>(stats_).subspan((update - first_) * size_, size_), stat_);
      node_.publish(stat_);
      ++node_.traffic.resent;
    }
  }
  if (Clock::now() >= next_info_) send_info();
}

void RunAnnouncer::end() {
  info_.ended() = true;
  send_info();
}

void RunAnnouncer::send_info() {
  node_.publish(info_);
  next_info_ = Clock::now() + kHeartbeat;
}

}  // namespace citylearn
