// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/learner_server.h"

#include <spdlog/spdlog.h>

#include <algorithm>

namespace citylearn {
namespace {

constexpr auto kInfoAgain = std::chrono::seconds(1);
constexpr auto kAskedLately = std::chrono::seconds(1);
constexpr std::size_t kMostHeld = 4;

TrajectoryShape shape_of(const msg::LearnerInfo& info, int state_size) {
  const TrajectoryShape shape{static_cast<int>(info.steps()), static_cast<int>(info.feature_dimension()), state_size,
                              static_cast<int>(info.frames())};
  shape.require_fits();
  return shape;
}

msg::LearnerInfo info_of(const Trainer& trainer) {
  msg::LearnerInfo info;
  trainer.describe(info);
  return info;
}

}  // namespace

LearnerLink::LearnerLink(Node& node, Trainer& trainer, const LearnerLinkOptions& options)
    : node_(node),
      heart_(node),
      trainer_(trainer),
      options_(options),
      // Room for the update that comes next, and for one more to be taken in meanwhile.
      queue_(shape_of(info_of(trainer), trainer.agent().network->state_size()), 2 * trainer.batch()),
      rejections_(node) {
  node_.create_writer<msg::LearnerInfo>();
  node_.create_writer<msg::PolicyParameters>();
  node_.create_writer<msg::TrajectoryAcknowledgement>();
  node_.create_reader<msg::ActorStatus>();
  node_.create_reader<msg::Trajectory>();
  node_.create_reader<msg::ParametersRequest>();
  info_.training() = true;
  info_.traversal() = options_.traversal.c_str();
  info_.traversal_hash() = options_.traversal_hash;
  info_.window() = static_cast<std::uint32_t>(options_.window);
  info_.run_id() = options_.job;
  send_parameters();
}

int LearnerLink::actors() const {
  return static_cast<int>(
      std::count_if(actors_.begin(), actors_.end(), [](const auto& entry) { return entry.second.here; }));
}

bool LearnerLink::released() const {
  return std::none_of(actors_.begin(), actors_.end(),
                      [](const auto& entry) { return entry.second.here && entry.second.serves; });
}

double LearnerLink::waited() const {
  double seconds = 0;
  for (const auto& [id, actor] : actors_) seconds += actor.waited + actor.waited_before;
  return seconds;
}

void LearnerLink::handle() {
  while (node_.take(status_)) on_status(status_);
  while (node_.take(trajectory_)) on_trajectory(trajectory_);
  while (node_.take(request_)) on_request(request_);
  count_actors();
  for (const std::string& actor : to_acknowledge_) acknowledge(actor);
  to_acknowledge_.clear();
  if (Clock::now() >= next_info_) send_info();
}

void LearnerLink::count_actors() {
  for (auto& [id, actor] : actors_) {
    if (!actor.here || actor.presence.here(Clock::now())) continue;
    spdlog::warn("actor '{}' went silent", id);
    actor.here = false;
  }
  // Who serves nothing needs no room.
  queue_.share_among(static_cast<int>(std::count_if(
      actors_.begin(), actors_.end(), [](const auto& entry) { return entry.second.here && entry.second.serves; })));
}

void LearnerLink::on_status(const msg::ActorStatus& status) {
  const std::string id = status.header().sender().c_str();
  Actor& actor = actors_[id];
  if (status.header().incarnation() < actor.incarnation) {  // of a process that is dead
    ++node_.traffic.repeated;
    return;
  }
  if (status.header().incarnation() > actor.incarnation) actor.waited_before += std::exchange(actor.waited, 0);
  if (!actor.here || actor.incarnation != status.header().incarnation())
    spdlog::info("actor '{}' {}", id, actor.incarnation == 0 ? "joins" : "is back");
  actor.incarnation = status.header().incarnation();
  actor.here = true;
  actor.presence.heard(Clock::now());
  actor.serves = status.environments().size() > 0;
  if (status.learner_incarnation() == node_.incarnation()) actor.waited = status.waited();
  queue_.meet(id, actor.incarnation);
  to_acknowledge_.insert(id);
}

void LearnerLink::on_trajectory(msg::Trajectory& trajectory) {
  const std::string id = trajectory.header().sender().c_str();
  if (trajectory.learner() != node_.options().id || trajectory.learner_incarnation() != node_.incarnation()) {
    ++node_.traffic.repeated;
    return;
  }
  if (const auto known = actors_.find(id); known != actors_.end()) known->second.presence.heard(Clock::now());
  try {
    if (queue_.take(trajectory, version()) != TrajectoryQueue::Taken::kTaken) ++node_.traffic.repeated;
    to_acknowledge_.insert(id);
  } catch (const Error& error) {
    const std::string wrong = error.what();
    rejections_.add(trajectory.header(), "a trajectory (" + wrong.substr(0, wrong.find(": ")) + ")", wrong);
  }
}

void LearnerLink::acknowledge(const std::string& actor) {
  const auto found = actors_.find(actor);
  if (found == actors_.end()) return;  // its status will come
  const TrajectoryQueue::Window window = queue_.window(actor);
  acknowledgement_.actor() = actor.c_str();
  acknowledgement_.actor_incarnation() = found->second.incarnation;
  acknowledgement_.number() = window.number;
  acknowledgement_.limit() = window.limit;
  node_.publish(acknowledgement_);
}

bool LearnerLink::ready() {
  return queue_.ready(trainer_.batch(), version(), static_cast<std::uint32_t>(trainer_.progress().lesson),
                      options_.most_lag);
}

UpdateFigures LearnerLink::learn() {
  trainer_.describe(info_);
  lag_ = queue_.assemble(trainer_.batch(), version(), static_cast<int>(info_.lesson_frames()), rollout_);
  Rollout* const rollout = &rollout_;
  const UpdateFigures figures = heart_.beside([&] { return trainer_.learn({&rollout, 1}, queue_.finished()); });
  send_parameters();
  for (const auto& [id, actor] : actors_)
    if (actor.here) acknowledge(id);  // there is room again
  return figures;
}

void LearnerLink::end() {
  info_.training() = false;
  send_info();
}

void LearnerLink::send_info() {
  trainer_.describe(info_);
  const ParameterChunks& newest = held_.rbegin()->second.chunks;
  info_.version() = newest.version();
  info_.total_bytes() = newest.total_bytes();
  info_.hash() = newest.hash();
  info_.chunks() = newest.chunks();
  node_.publish(info_);
  next_info_ = Clock::now() + kInfoAgain;
}

/// The newest, whole, to all who are there. Whoever misses some or comes late asks.
void LearnerLink::send_parameters() {
  const Clock::time_point now = Clock::now();
  std::erase_if(held_, [&](const auto& entry) { return now - entry.second.asked > kAskedLately; });
  while (held_.size() >= kMostHeld) held_.erase(std::prev(held_.end()));
  const auto& newest = held_.try_emplace(version(), Held{{version(), trainer_.network_parameters()}, {}}).first->second;
  send_info();
  if (actors() == 0) return;
  parameters_.agent() = info_.agent();
  for (std::uint32_t chunk = 0; chunk < newest.chunks.chunks(); ++chunk) {
    newest.chunks.fill(chunk, parameters_);
    node_.publish(parameters_);
  }
}

void LearnerLink::on_request(const msg::ParametersRequest& request) {
  if (request.learner() != node_.options().id) return;
  const auto found = held_.find(request.version());
  if (found == held_.end()) {
    ++node_.traffic.repeated;
    return;
  }
  found->second.asked = Clock::now();
  parameters_.agent() = info_.agent();
  for (const std::uint32_t chunk : request.chunks()) {
    if (chunk >= found->second.chunks.chunks()) {
      ++node_.traffic.rejected;
      continue;
    }
    found->second.chunks.fill(chunk, parameters_);
    node_.publish(parameters_);
  }
}

}  // namespace citylearn
