// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/actor.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <memory>

#include "core/exchange/timing.h"
#include "core/util/machine.h"
#include "core/wire/rejections.h"
#include "core/wire/service.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/distributed/learner_session.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxLearners = 256;  // remembered

/// Returns an id that no other actor of the run has, on any host.
std::string own_id() {
  return ("actor-" + host_name().substr(0, 40) + "-" + std::to_string(process_number())).substr(0, 64);
}

Node::Options named(Node::Options options) {
  options.service = "policy_service";
  if (options.id.empty()) options.id = own_id();
  return options;
}

class Actor {
 public:
  explicit Actor(const ActorOptions& options);
  int execute();

 private:
  void spin();
  void on_info(const msg::LearnerInfo& info);
  void on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement);
  void on_parameters(const msg::ParametersChunk& chunk);
  bool of_learner(const msg::Header& header, const std::string& what);
  void on_assignment(const msg::Assignment& assignment);
  void serve_assigned();
  void let_go_of_released();
  void serve(EnvHandle& env);
  void drop(EnvHandle& env);
  void release(const std::string& id);
  void release_all();
  bool decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  void send_status();
  std::string why_idle() const;
  void report();
  void leave();

  ActorOptions options_;
  Node node_;
  EnvClient client_;
  Rejections rejections_;
  WorkerPool workers_{options_.threads};
  std::unique_ptr<LearnerSession> session_;
  std::map<std::string, std::uint64_t> assigned_;      // incarnations of env_services, by id
  std::map<std::string, Clock::time_point> released_;  // told to be idle, not let go yet: since when
  std::map<std::string, MessageOrder> orders_;         // of the learner's assignments, by id of the env_service
  std::uint64_t steps_ = 0;
  int slots_ = 0;
  bool answered_ = false;  // the learner has answered the last status
  bool warned_ = false;
  std::string logged_;  // why nothing is served
  double waited_ = 0;
  Incumbent learner_;
  std::map<std::uint64_t, std::uint64_t> acknowledged_;  // last trajectory, by incarnation of earlier learners
  Clock::time_point next_status_{}, next_report_{}, last_report_, last_turn_;
  std::vector<std::uint8_t> choice_;
  msg::LearnerInfo info_;
  msg::ActorStatus status_;
  msg::Assignment assignment_;
  msg::TrajectoryAcknowledgement acknowledgement_;
  msg::ParametersChunk chunk_;
};

Actor::Actor(const ActorOptions& options)
    : options_(options), node_(named(options.node)), client_(node_, {.attached_only = true}), rejections_(node_) {
  node_.create_writer<msg::ActorStatus>();
  node_.create_reader<msg::LearnerInfo>();
  node_.create_reader<msg::Assignment>();
  node_.create_reader<msg::TrajectoryAcknowledgement>();
  node_.create_reader<msg::ParametersChunk>();
  node_.create_reader_at<msg::ParametersChunk>("");  // for all actors
  client_.decide = [this](EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
    return decide(env, observation, choice);
  };
  client_.believe = [this](EnvHandle& env, msg::Belief& belief) { session_->believe(env, belief); };
  client_.joined = [this](EnvHandle& env) { drop(env); };  // a new incarnation: it is served once it is assigned
  last_report_ = last_turn_ = Clock::now();
}

// The learner.

/// Returns whether the learner sent it that this actor works for. Others are outdated or rejected.
bool Actor::of_learner(const msg::Header& header, const std::string& what) {
  if (header.incarnation() == learner_.incarnation() && header.sender() == session_->info().header().sender())
    return true;
  if (learner_.preceded(header.incarnation()))
    ++node_.traffic.repeated;
  else
    rejections_.add(header, what + " from another service than the learner");
  return false;
}

void Actor::on_info(const msg::LearnerInfo& info) {
  if (const std::string wrong = validation_error(info); !wrong.empty()) {
    rejections_.add(info.header(), "a learner " + wrong);
    return;
  }
  if ((!session_ || info.header().incarnation() != learner_.incarnation()) && !info.training()) return;  // has ended
  const Incumbent::Heard heard = learner_.hear(info.header().incarnation(), Clock::now());
  if (heard == Incumbent::Heard::kOther) {
    of_learner(info.header(), "an announcement");
    return;
  }
  if (heard == Incumbent::Heard::kIncumbent && !of_learner(info.header(), "an announcement")) return;
  if (heard == Incumbent::Heard::kIncumbent && !same_task(session_->info(), info)) {
    rejections_.add(info.header(), "an announcement that differs from what this learner said before");
    return;
  }
  if (heard == Incumbent::Heard::kIncumbent) {
    // Unacknowledged trajectories stay: the learner counts them, and drops those of an old lesson.
    if (session_->update(info))
      for (EnvHandle* env : session_->envs()) serve(*env);
    return;
  }
  spdlog::info("learner '{}'{}: {} on '{}', version {}", info.header().sender().c_str(), session_ ? " is back" : "",
               info.agent().c_str(), info.traversal().c_str(), info.version());
  // Trajectories for another incarnation are of no use to this one, which may continue from an older checkpoint.
  release_all();
  if (session_) {
    if (acknowledged_.size() >= kMaxLearners) acknowledged_.clear();
    acknowledged_[session_->info().header().incarnation()] = session_->outbox.acknowledged();
  }
  orders_.clear();
  session_ = std::make_unique<LearnerSession>(node_, info, workers_);
  session_->outbox.begin(info.header(), acknowledged_[info.header().incarnation()]);
  client_.require(session_->requirements());
  warned_ = false;
  next_status_ = Clock::now();
}

void Actor::on_parameters(const msg::ParametersChunk& chunk) {
  if (!session_ || !session_->prepared() || !of_learner(chunk.header(), "parameters")) return;
  // The learner's announcement comes first and counts: a forged version would be newer than all that it will ever send.
  if (chunk.item() > session_->info().version()) {
    ++node_.traffic.repeated;
    return;
  }
  if (!session_->parameters()->take(chunk)) rejections_.add(chunk.header(), "damaged parameters");
}

// The env_services.

void Actor::on_assignment(const msg::Assignment& assignment) {
  if (!session_ || assignment.actor() != node_.options().id || assignment.actor_incarnation() != node_.incarnation() ||
      !of_learner(assignment.header(), "an assignment"))
    return;
  const std::string id = assignment.environment().c_str();
  next_status_ = Clock::now();
  if (orders_.size() >= msg::MAX_SERVED && !orders_.contains(id)) orders_.clear();  // they matter for seconds only
  if (!orders_[id].in_order(assignment.header(), next_status_)) {                   // a newer one has come
    ++node_.traffic.repeated;
    return;
  }
  if (assignment.serve()) {
    if (!assigned_.contains(id)) spdlog::info("learner '{}' assigns env_service '{}'", session_->learner(), id);
    assigned_[id] = assignment.environment_incarnation();
    released_.erase(id);
    client_.attach(id);
    return;
  }
  const auto known = assigned_.find(id);
  if (known == assigned_.end() || known->second != assignment.environment_incarnation()) return;
  spdlog::info("releases env_service '{}', as learner '{}' asks", id, session_->learner());
  assigned_.erase(known);
  release(id);
}

/// Begins to serve what is assigned and has announced itself, and gives up what is gone.
void Actor::serve_assigned() {
  for (EnvHandle* env : session_->envs()) {
    if (!env->lost() && session_->serves(*env)) continue;
    spdlog::info("env_service '{}' {}", env->id,
                 env->lost()            ? "obeys another service"
                 : env->refusal.empty() ? "is gone"
                                        : "is not used");
    assigned_.erase(env->id);
    release(env->id);
  }
  for (const auto& [id, incarnation] : assigned_) {
    const auto found = client_.envs().find(id);
    if (found == client_.envs().end()) continue;
    EnvHandle& env = *found->second;
    if (env.incarnation() != incarnation || session_->acts_on(env) || !session_->serves(env)) continue;
    serve(env);
    spdlog::info("serving env_service '{}'", id);
    logged_.clear();
  }
}

/// Lets released env_services go once they are idle. Until then they are told so again and again: one that still obeyed
/// this actor would obey no other one while this one lives.
void Actor::let_go_of_released() {
  const Clock::time_point now = Clock::now();
  std::erase_if(released_, [&](const auto& entry) {
    const auto found = client_.envs().find(entry.first);
    if (found != client_.envs().end() && found->second->alive() && !found->second->lost() &&
        !found->second->in_force() && now - entry.second < kReleaseGiveUp)
      return false;
    client_.detach(entry.first);
    return true;
  });
}

/// Begins to serve an env_service, or begins anew.
void Actor::serve(EnvHandle& env) {
  client_.command(env, session_->begin(env, ++slots_));
  next_status_ = Clock::now();
}

/// Ends to serve an env_service.
void Actor::drop(EnvHandle& env) {
  if (!session_ || !session_->end(env)) return;
  env.release();
  next_status_ = Clock::now();
}

/// Ends to serve an env_service and tells it to wait, so that another actor may serve it at once.
void Actor::release(const std::string& id) {
  if (const auto env = client_.envs().find(id); env != client_.envs().end()) {
    drop(*env->second);
    msg::TaskSettings settings;
    settings.task_mode() = msg::IDLE;
    client_.command(*env->second, settings);
  }
  released_.try_emplace(id, Clock::now());
}

void Actor::release_all() {
  for (const auto& [id, incarnation] : std::exchange(assigned_, {})) release(id);
  next_status_ = Clock::now();
}

void Actor::send_status() {
  next_status_ = Clock::now() + kHeartbeat;
  status_.learner() = session_ ? session_->info().header().sender().c_str() : "";
  status_.learner_incarnation() = session_ ? session_->info().header().incarnation() : 0;
  const auto newest = session_ ? session_->newest_parameters() : nullptr;
  status_.version() = newest ? newest->version : 0;
  status_.available() = true;
  status_.environments().clear();
  if (session_)
    for (const EnvHandle* env : session_->envs()) status_.environments().push_back(env->incarnation());
  status_.unacknowledged() = session_ ? static_cast<std::uint32_t>(session_->outbox.unacknowledged()) : 0;
  status_.waiting() = session_ && session_->blocked();
  status_.waited() = waited_;
  answered_ = false;
  node_.publish(status_);
}

// Acting.

bool Actor::decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  if (!session_ || !session_->act(env, observation, choice)) return false;
  steps_ += choice.size();
  return true;
}

void Actor::on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement) {
  if (!session_ || acknowledgement.writer() != node_.options().id ||
      acknowledgement.writer_incarnation() != node_.incarnation() ||
      !of_learner(acknowledgement.header(), "an acknowledgement"))
    return;
  answered_ = true;
  const LogSender::Acknowledged result = session_->acknowledge(acknowledgement);
  if (result == LogSender::Acknowledged::kImpossible)
    rejections_.add(acknowledgement.header(), "an acknowledgement of trajectories that were never sent");
  if (result == LogSender::Acknowledged::kRepeated) ++node_.traffic.repeated;
}

// The loop.

void Actor::spin() {
  client_.spin(Clock::now() + kStopCheckInterval);
  while (node_.take(info_)) on_info(info_);
  while (node_.take(assignment_)) on_assignment(assignment_);
  while (node_.take(chunk_)) on_parameters(chunk_);
  while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  const Clock::time_point now = Clock::now();
  if (session_ && session_->blocked()) waited_ += std::chrono::duration<double>(now - last_turn_).count();
  last_turn_ = now;
  if (session_ && session_->info().training() && session_->prepare(client_)) {
    session_->request_missing_parameters();
    if (session_->newest_parameters()) serve_assigned();
    for (EnvHandle* env : session_->envs()) {
      if (!session_->resume(*env, choice_)) continue;
      steps_ += choice_.size();
      client_.answer(*env, choice_);
    }
    session_->outbox.send_due();
  }
  let_go_of_released();
  if (now >= next_status_) send_status();
  if (now >= next_report_) report();
}

/// Returns why this actor serves no env_service.
std::string Actor::why_idle() const {
  const LearnerSession& s = *session_;
  if (!s.info().training()) return "waiting for the next learner";
  if (assigned_.empty())
    return "waiting for an env_service from learner '" + s.learner() + "'; start more if all are taken";
  if (std::none_of(client_.envs().begin(), client_.envs().end(),
                   [&](const auto& entry) { return s.serves(*entry.second); }))
    return "waiting for env_service '" + assigned_.begin()->first + "'";
  if (!s.prepared()) return "waiting for the features of '" + std::string(s.info().traversal().c_str()) + "'";
  if (!s.newest_parameters()) return "waiting for parameters of learner '" + s.learner() + "'";
  return "waiting for env_service '" + assigned_.begin()->first + "' to begin";
}

void Actor::report() {
  const Clock::time_point now = Clock::now();
  const double rate = static_cast<double>(std::exchange(steps_, 0)) /
                      std::max(1e-3, std::chrono::duration<double>(now - last_report_).count());
  last_report_ = now;
  next_report_ = now + kHeartbeat;
  if (!session_) {
    node_.report(msg::WAITING, "waiting for a learner");
    return;
  }
  const std::string learner = session_->learner();
  const bool silent = !learner_.here(now);
  if (silent && !std::exchange(warned_, true))
    spdlog::warn("learner '{}' is silent: continuing up to {} unacknowledged segments, then waiting", learner,
                 session_->info().window());
  if (!silent && std::exchange(warned_, false)) spdlog::info("learner '{}' is heard again", learner);
  if (status_.waiting()) {
    node_.report(msg::WAITING,
                 fmt::format("waiting for learner '{}' to take {} trajectories{}; {:.0f} s so far", learner,
                             session_->outbox.unacknowledged(), silent ? ", which is silent" : "", waited_),
                 static_cast<float>(rate));
  } else if (session_->envs().empty()) {
    const std::string why = why_idle();
    if (std::exchange(logged_, why) != why) spdlog::info("{}", why);
    node_.report(msg::WAITING, why);
  } else {
    node_.report(msg::RUNNING,
                 fmt::format("acting on {} env_service{} for learner '{}', version {}", session_->envs().size(),
                             session_->envs().size() == 1 ? "" : "s", learner, status_.version()),
                 static_cast<float>(rate));
  }
}

/// Tells the learner that nothing is served any more, unless it is gone.
void Actor::leave() {
  send_status();
  const Clock::time_point deadline = Clock::now() + kLastStatusTimeout;
  while (!answered_ && Clock::now() < deadline) {
    client_.spin(std::min(deadline, Clock::now() + kStopCheckInterval));
    while (node_.take(info_)) continue;
    while (node_.take(assignment_)) continue;
    while (node_.take(chunk_)) continue;
    while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  }
}

int Actor::execute() {
  const FinalStatusGuard final_status(node_);
  spdlog::info("actor '{}' in session '{}' over {}", node_.options().id, node_.options().session,
               node_.middleware_name());
  Clock::time_point ended{};  // when the learner said so
  while (!stop_requested()) {
    spin();
    if (!session_ || session_->info().training()) {
      ended = {};
      continue;
    }
    if (ended == Clock::time_point{}) {
      ended = Clock::now();
      release_all();
      spdlog::info("learner '{}' has ended: sent {} trajectories, waited {:.1f} s for room", session_->learner(),
                   session_->outbox.last(), waited_);
    }
    if (Clock::now() < ended + kEndContestTimeout) continue;
    learner_.leave();
    if (options_.stay) continue;
    leave();
    return 0;
  }
  release_all();
  leave();
  spdlog::info("stopped by a signal");
  return 130;
}

}  // namespace

int run_actor(const ActorOptions& options) { return Actor(options).execute(); }

}  // namespace citylearn
