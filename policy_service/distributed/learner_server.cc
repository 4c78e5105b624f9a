// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/learner_server.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/exchange/timing.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxVersions = 4;

msg::LearnerInfo info_of(const Trainer& trainer) {
  msg::LearnerInfo info;
  trainer.describe(info);
  return info;
}

TrajectoryShape shape_of(const Trainer& trainer) {
  const msg::LearnerInfo info = info_of(trainer);
  const TrainedAgent agent = trainer.agent();
  const TrajectoryShape shape{static_cast<int>(info.steps()), static_cast<int>(info.feature_dimension()),
                              agent.network->state_size(), static_cast<int>(info.frames()), agent.task.map()};
  shape.require_fits();
  return shape;
}

}  // namespace

LearnerServer::LearnerServer(Node& node, const EnvClient& client, Trainer& trainer, const LearnerServerOptions& options)
    : node_(node),
      client_(client),
      heartbeat_(node),
      trainer_(trainer),
      options_(options),
      // There is room for the next update, and for one more to be taken in meanwhile.
      queue_(shape_of(trainer), 2 * trainer.batch()),
      rejections_(node),
      server_(
          [this](const ObjectKey& key) {
            const auto found = key.hash == node_.incarnation() ? versions_.find(key.item) : versions_.end();
            return found == versions_.end() ? nullptr : found->second.object;
          },
          node.traffic.rejected, 0ms) {  // an actor that lacks something asks again soon
  node_.create_writer<msg::LearnerInfo>();
  node_.create_writer<msg::ParametersChunk>();
  node_.create_reader<msg::ActorStatus>();
  node_.create_reader<msg::Trajectory>();
  node_.create_reader<msg::ParametersRequest>();
  info_.training() = true;
  info_.traversal() = options_.learned.traversal.c_str();
  info_.traversal_hash() = options_.learned.hash;
  info_.window() = static_cast<std::uint32_t>(options_.window);
  info_.run_id() = options_.run_id;
  next_assignments_ = Clock::now() + kActorSettle;
  send_parameters();
}

int LearnerServer::actors() const {
  return static_cast<int>(
      std::count_if(actors_.begin(), actors_.end(), [](const auto& entry) { return entry.second.present; }));
}

bool LearnerServer::released() const {
  return std::none_of(actors_.begin(), actors_.end(),
                      [](const auto& entry) { return entry.second.present && !entry.second.serves.empty(); });
}

double LearnerServer::waited() const {
  double seconds = 0;
  for (const auto& [id, actor] : actors_) seconds += actor.waited + actor.waited_before;
  return seconds;
}

void LearnerServer::handle() {
  while (node_.take(status_)) on_status(status_);
  while (node_.take(trajectory_)) on_trajectory(trajectory_);
  while (node_.take(request_)) on_request(request_);
  count_actors();
  for (const std::string& actor : to_acknowledge_) acknowledge(actor);
  to_acknowledge_.clear();
  if (Clock::now() >= next_assignments_) assign();
  if (Clock::now() >= next_info_) send_info();
}

void LearnerServer::count_actors() {
  std::set<std::string> elsewhere;
  for (auto& [id, actor] : actors_) {
    if (actor.presence.here(Clock::now())) {
      if (!actor.elsewhere.empty()) elsewhere.insert("'" + actor.elsewhere + "'");
    } else if (std::exchange(actor.present, false)) {
      spdlog::warn("actor '{}' went silent", id);
    }
  }
  node_.alarm("actors", actors() > 0 || elsewhere.empty() ? ""
                                                          : "all work for learner " + joined(elsewhere) +
                                                                ": start others, or end one of the learners");
  // An actor without env_services needs no room.
  queue_.share_among(static_cast<int>(std::count_if(actors_.begin(), actors_.end(), [](const auto& entry) {
    return entry.second.present && !entry.second.serves.empty();
  })));
}

/// Divides the env_services of the training traversal among the actors.
void LearnerServer::assign() {
  const Clock::time_point now = Clock::now();
  next_assignments_ = now + kAssignInterval;
  if (!info_.training()) return;
  std::vector<Assignments::Env> envs;
  for (const auto& [id, env] : client_.envs())
    if (env->traversal() == options_.learned.traversal && env->usable())
      envs.push_back({id, env->incarnation(), env->busy});
  std::vector<Assignments::Actor> actors;
  for (const auto& [id, actor] : actors_)
    if (actor.present && actor.available) actors.push_back({id, actor.serves});
  for (const Assignments::Order& order : assignments_.divide(envs, actors, now)) {
    assignment_.actor() = order.actor.c_str();
    assignment_.actor_incarnation() = actors_.at(order.actor).presence.incarnation();
    assignment_.environment() = order.env.c_str();
    assignment_.environment_incarnation() = order.incarnation;
    assignment_.serve() = order.serve;
    node_.publish(assignment_);
  }
}

void LearnerServer::on_status(const msg::ActorStatus& status) {
  const std::string id = status.header().sender().c_str();
  Actor& actor = actors_[id];
  const bool first = actor.presence.incarnation() == 0 || !actor.elsewhere.empty();
  const Incumbent::Heard heard = actor.presence.hear(status.header().incarnation(), Clock::now());
  if (heard == Incumbent::Heard::kOther) {
    ++node_.traffic.repeated;
    return;
  }
  const bool fresh = heard == Incumbent::Heard::kSuccessor;
  if (fresh) actor.waited_before += std::exchange(actor.waited, 0);
  actor.elsewhere = status.learner() == node_.options().id ? "" : status.learner().c_str();
  if (!actor.elsewhere.empty()) {
    actor.present = false;
    return;
  }
  if (!actor.present || fresh) spdlog::info("actor '{}' {}", id, first ? "joins" : "is back");
  actor.present = true;
  actor.available = status.available();
  actor.serves = std::set<std::uint64_t>(status.environments().begin(), status.environments().end());
  if (status.learner_incarnation() == node_.incarnation()) actor.waited = status.waited();
  queue_.register_actor(id, actor.presence.incarnation());
  to_acknowledge_.insert(id);
}

void LearnerServer::on_trajectory(msg::Trajectory& trajectory) {
  const std::string id = trajectory.header().sender().c_str();
  if (trajectory.learner() != node_.options().id || trajectory.log().stream() != node_.incarnation()) {
    ++node_.traffic.repeated;
    return;
  }
  if (const auto known = actors_.find(id); known != actors_.end()) {
    // An actor that was restarted sends it again, after its status.
    if (known->second.presence.incarnation() != trajectory.header().incarnation()) {
      ++node_.traffic.repeated;
      return;
    }
    known->second.presence.hear(trajectory.header().incarnation(), Clock::now());
  }
  try {
    if (queue_.take(trajectory, version()) != TrajectoryQueue::Taken::kTaken) ++node_.traffic.repeated;
    to_acknowledge_.insert(id);
  } catch (const Error& error) {
    const std::string wrong = error.what();
    rejections_.add(trajectory.header(), "a trajectory (" + wrong.substr(0, wrong.find(": ")) + ")", wrong);
  }
}

void LearnerServer::acknowledge(const std::string& actor) {
  const auto found = actors_.find(actor);
  if (found == actors_.end()) return;  // its status will come
  const TrajectoryQueue::Window window = queue_.window(actor);
  acknowledgement_.writer() = actor.c_str();
  acknowledgement_.writer_incarnation() = found->second.presence.incarnation();
  acknowledgement_.stream() = node_.incarnation();
  acknowledgement_.number() = window.number;
  acknowledgement_.limit() = window.limit;
  node_.publish(acknowledgement_);
}

bool LearnerServer::ready() {
  return queue_.ready(trainer_.batch(), version(), static_cast<std::uint32_t>(trainer_.progress().lesson),
                      options_.max_lag);
}

UpdateFigures LearnerServer::learn() {
  trainer_.describe(info_);
  policy_lag_ = queue_.assemble(trainer_.batch(), version(), static_cast<int>(info_.lesson_frames()), rollout_);
  trainer_.prepare(rollout_);
  Rollout* const rollout = &rollout_;
  const UpdateFigures figures = heartbeat_.run([&] { return trainer_.learn({&rollout, 1}, queue_.finished()); });
  send_parameters();
  for (const auto& [id, actor] : actors_)
    if (actor.present) acknowledge(id);  // there is room again
  return figures;
}

void LearnerServer::end() {
  info_.training() = false;
  send_info();
}

void LearnerServer::send_info() {
  trainer_.describe(info_);
  const ObjectBytes& newest = *versions_.rbegin()->second.object;
  info_.version() = newest.key.item;
  info_.total_bytes() = newest.bytes.size();
  info_.hash() = newest.checksum;
  node_.publish(info_);
  node_.metrics().set_queue("trajectories", queue_.size(), queue_.capacity());
  next_info_ = Clock::now() + kHeartbeat;
}

/// Sends the newest parameters to all actors. Those that miss some, or come late, ask.
void LearnerServer::send_parameters() {
  const Clock::time_point now = Clock::now();
  std::erase_if(versions_, [&](const auto& entry) { return now - entry.second.asked > kOldParameters; });
  while (versions_.size() >= kMaxVersions) versions_.erase(std::prev(versions_.end()));
  trainer_.describe(info_);
  const auto newest = std::make_shared<ObjectBytes>(
      parameters_object(node_.incarnation(), version(), info_.agent().c_str(), trainer_.network_parameters()));
  versions_.try_emplace(version(), Version{newest, {}});
  send_info();
  if (actors() == 0) return;
  parameters_.receiver() = "";  // all
  for (std::uint32_t chunk = 0; chunk < newest->chunks(); ++chunk) {
    newest->fill(chunk, parameters_);
    node_.publish(parameters_);
  }
}

void LearnerServer::on_request(const msg::ParametersRequest& request) {
  for (const std::uint64_t version : request.items())
    if (const auto found = versions_.find(version); found != versions_.end()) found->second.asked = Clock::now();
  server_.answer(request, parameters_, [this] { node_.publish(parameters_); });
}

}  // namespace citylearn
