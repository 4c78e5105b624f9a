// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/run_announcer.h"

#include <spdlog/spdlog.h>

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

constexpr int kResendBatch = 64;  // figures between two checks for messages: a quarter of what a writer keeps

}  // namespace

RunAnnouncer::RunAnnouncer(Node& node, const Run& run) : node_(node), log_({.keeps_all = true}) {
  node_.create_writer<msg::TrainingStat>();
  node_.create_reader<msg::TrainingAcknowledgement>();
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
  stat.log() = log_.position(log_.add(), info_.run_id());
  node_.publish(stat);
  log_.next(Clock::now());  // it went out
  node_.metrics().set(stat);
  info_.updates() = stat.update();
  Bytes bytes;
  encode(stat, bytes);  // all are of one size, as their headers name one sender
  size_ = bytes.size();
  stats_.insert(stats_.end(), bytes.begin(), bytes.end());
}

void RunAnnouncer::on_acknowledgement() {
  if (acknowledgement_.writer() != node_.options().id || acknowledgement_.writer_incarnation() != node_.incarnation() ||
      acknowledgement_.stream() != info_.run_id())
    return;
  const LogSender::Acknowledged result = log_.acknowledge(acknowledgement_, Clock::now());
  if (result == LogSender::Acknowledged::kRepeated) ++node_.traffic.repeated;
  if (result == LogSender::Acknowledged::kImpossible)
    rejections_.add(acknowledgement_.header(), "an acknowledgement of updates that were not made");
  if (result == LogSender::Acknowledged::kTooMany)
    rejections_.add(acknowledgement_.header(), "an acknowledgement of one reader of figures too many");
}

void RunAnnouncer::handle() {
  while (node_.take(acknowledgement_)) on_acknowledgement();
  for (int count = 0; count < kResendBatch; ++count) {
    const auto next = log_.next(Clock::now());
    if (!next) break;
    decode(std::span<const std::byte>(stats_).subspan((next->number - 1) * size_, size_), stat_);
    node_.publish(stat_);
    ++node_.traffic.resent;
  }
  if (Clock::now() >= next_info_) send_info();
}

void RunAnnouncer::end() {
  info_.ended() = true;
  log_.hurry(Clock::now());
  send_info();
}

void RunAnnouncer::send_info() {
  node_.publish(info_);
  next_info_ = Clock::now() + kHeartbeat;
}

}  // namespace citylearn
