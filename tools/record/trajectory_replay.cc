// SPDX-License-Identifier: Apache-2.0
#include "tools/record/trajectory_replay.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

constexpr std::size_t kReadAhead = 32;  // trajectories that are not acknowledged yet

}  // namespace

TrajectoryReplay::TrajectoryReplay(Node& node, std::vector<std::string> files)
    : node_(node), files_(std::move(files)), outbox_(node) {
  for (const std::string& file : files_) McapReader check(file);
  node_.create_writer<msg::Trajectory>();
  node_.create_writer<msg::ActorStatus>();
  node_.create_reader<msg::LearnerInfo>();
  node_.create_reader<msg::TrajectoryAcknowledgement>();
  progress_ = next_status_ = due_ = Clock::now();
}

void TrajectoryReplay::on_info(const msg::LearnerInfo& info) {
  const Incumbent::Heard heard = learner_.hear(info.header().incarnation(), Clock::now());
  if (heard == Incumbent::Heard::kOther) return;
  if (heard == Incumbent::Heard::kSuccessor) {
    if (info_.header().incarnation() != 0)
      throw Error("restarted while the recording was played to it",
                  "learner '" + info.header().sender().to_string() + "'", "play it again");
    spdlog::info("plays to learner '{}'", info.header().sender().c_str());
    next_status_ = progress_ = Clock::now();
    outbox_.begin(info.header(), 0);
  }
  info_ = info;
  ended_ = !info.training();
}

void TrajectoryReplay::on_acknowledgement(const msg::TrajectoryAcknowledgement& a) {
  if (a.writer() != node_.options().id || a.writer_incarnation() != node_.incarnation() ||
      a.header().incarnation() != info_.header().incarnation())
    return;
  const std::uint64_t before = outbox_.acknowledged();
  if (outbox_.acknowledge(a) != LogSender::Acknowledged::kYes) return;
  // Without room it waits for others, or learns.
  if (outbox_.acknowledged() > before || a.limit() <= a.number()) progress_ = Clock::now();
}

void TrajectoryReplay::take_messages() {
  while (node_.take(heard_)) on_info(heard_);
  while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
}

void TrajectoryReplay::require_fits(const msg::Trajectory& trajectory) const {
  const auto require = [&](std::uint64_t has, std::uint64_t wanted, const std::string& what) {
    if (has != wanted)
      throw Error("has " + std::to_string(has) + " " + what + ", the learner wants " + std::to_string(wanted),
                  reader_->path());
  };
  require(trajectory.action().size(), info_.steps(), "steps a trajectory");
  require(trajectory.feature_dimension(), info_.feature_dimension(), "features");
}

/// Appends the next recorded trajectory. Returns false when there is none left.
bool TrajectoryReplay::fetch() {
  const Topic& topic = topic_of<msg::Trajectory>();
  while (reader_ || files_opened_ < files_.size()) {
    if (!reader_) reader_ = std::make_unique<McapReader>(files_[files_opened_++]);
    const std::optional<McapMessage> message = reader_->next();
    if (!message) {
      if (!reader_->missing().empty()) spdlog::warn("{}: {}", reader_->path(), reader_->missing());
      reader_.reset();
      continue;
    }
    if (message->channel->topic != topic.name || message->channel->type != topic.type) continue;
    msg::Trajectory trajectory;
    try {
      decode(message->data, trajectory);
    } catch (const Error& error) {
      spdlog::warn("{}: skipped: {}", reader_->path(), error.what());
      continue;
    }
    const msg::Header& header = trajectory.header();
    const msg::LogPosition& log = trajectory.log();
    if (!seen_.emplace(header.sender().c_str(), header.incarnation(), log.stream(), log.number()).second) continue;
    require_fits(trajectory);
    trajectory.learner() = info_.header().sender();
    trajectory.version() = std::min(trajectory.version(), info_.version());
    outbox_.add() = std::move(trajectory);
    return true;
  }
  return false;
}

void TrajectoryReplay::send_status() {
  next_status_ = Clock::now() + kHeartbeat;
  status_.learner() = info_.header().sender();
  status_.learner_incarnation() = info_.header().incarnation();
  status_.version() = info_.version();
  status_.unacknowledged() = static_cast<std::uint32_t>(outbox_.unacknowledged());
  node_.publish(status_);
}

bool TrajectoryReplay::poll() {
  take_messages();
  const Clock::time_point now = Clock::now();
  due_ = now + 2 * kStopCheckInterval;
  if (info_.header().incarnation() == 0) {
    node_.report(msg::WAITING, "waiting for a learner");
    return true;
  }
  if (ended_) return false;
  node_.report(msg::RUNNING, "plays trajectories to '" + info_.header().sender().to_string() + "'");
  if (now >= next_status_) send_status();
  while (outbox_.unacknowledged() < kReadAhead && fetch()) {
  }
  outbox_.send_due();
  if (outbox_.unacknowledged() == 0) {
    if (outbox_.last() == 0)
      throw Error("has no trajectories", files_.front(), "record a run of --role learner and --role actor");
    return false;
  }
  if (outbox_.sent() > outbox_.acknowledged() && now - progress_ > kReplayProgress)
    throw Error("accepts none of the trajectories", "learner '" + info_.header().sender().to_string() + "'",
                "its log says what is wrong with them; --agent must be as it was");
  return true;
}

}  // namespace citylearn
