// SPDX-License-Identifier: Apache-2.0
#include "env_service/env_service.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "core/exchange/command.h"
#include "core/util/name.h"
#include "core/util/text.h"
#include "core/wire/rejections.h"
#include "env_service/environment.h"
#include "env_service/episode_outbox.h"
#include "env_service/live_steps.h"
#include "env_service/scene_sender.h"
#include "env_service/traversal_server.h"

namespace citylearn {
namespace {

using std::chrono::milliseconds;

constexpr std::uint64_t kEpisodesAtOnce = 32;  // before other messages get their turn
constexpr char kNotInCharge[] = "an action of a service that is not in charge";

Node::Options node_options(Node::Options options, const Traversal& traversal) {
  options.service = "env_service";
  if (options.id.empty()) options.id = name_from("env-" + traversal.name);
  return options;
}

std::string route(const msg::TaskSettings& settings) {
  return "frames " + std::to_string(settings.first_frame()) + ".." +
         std::to_string(std::uint64_t{settings.first_frame()} + settings.frames() - 1);
}

bool same_but_header(const msg::TaskSettings& one, msg::TaskSettings other) {
  other.header() = one.header();
  return one == other;
}

/// Puts one Environment on the wire: announces its traversal, applies a policy_service's TaskSettings, publishes one
/// Observation a tick and waits for its Action, and keeps each episode until it is acknowledged. Every message may be
/// lost, repeated or late: what is awaited is asked for again, what comes twice is dropped
/// (docs/decisions/0003-step-protocol.md). Used by one thread.
class EnvService {
 public:
  EnvService(const Traversal& traversal, const EnvServiceOptions& options);
  void run(const std::function<bool()>& stop);

 private:
  void take_messages();
  void on_settings(const msg::TaskSettings& settings);
  bool accepts(const msg::TaskSettings& settings);
  void watch_policy(const std::string& id);
  void refuse(const msg::Header& header, const std::string& kind);
  bool start_task(const msg::TaskSettings& settings);
  void on_action(const msg::Action& action);
  void on_acknowledgement(const msg::EpisodeAcknowledgement& acknowledgement);
  void on_status(const msg::ServiceStatus& status);

  void send_info();
  void send_observation();
  void finish_step();
  void record_episodes();
  void send_episodes();
  Clock::time_point episodes_due() const;
  void do_due_work();
  Clock::time_point next_due() const;
  void report();
  void leave();
  /// Takes messages and ignores them.
  void discard(auto&... messages) {
    while ((node_.take(messages) || ...)) continue;
  }

  /// Returns whether an Action is awaited.
  bool running() const { return observation_sender_.unconfirmed(); }
  bool robot_moves() const { return live_ && live_->busy(); }

  const Traversal& traversal_;
  Node node_;
  Rejections rejections_;
  Environment environment_;
  TraversalServer server_;
  SceneSender scenes_;
  std::unique_ptr<LiveSteps> live_;  // of a robot; null: agents are simulated

  msg::TraversalInfo info_;       // its `settings` are those in force
  msg::TaskSettings settings_;    // taken last, in force when info_.settings().version() != 0, else refused
  std::string refusal_;           // why they are not in force
  CommandTarget policies_;        // that command this env_service
  std::string policy_id_;         // of the one that sent settings_
  msg::Observation observation_;  // the last one sent
  CommandSender observation_sender_;
  bool policy_silent_ = false;
  enum class Silence { kNone, kLogged, kOver } silence_ = Silence::kNone;  // of it, as logged under these settings
  bool masked_action_logged_ = false;

  EpisodeOutbox outbox_;
  std::string outbox_problem_;  // as reported
  Clock::time_point last_episodes_;
  const std::chrono::duration<double> linger_;

  Clock::time_point now_;
  Clock::time_point next_info_, next_report_, last_report_;
  Presence acting_;          // of the policy_service: when it answered last, or had nothing to answer
  std::uint64_t steps_ = 0;  // of agents since last_report_
  std::uint64_t tasks_done_ = 0;

  // Members, so that a tick allocates nothing.
  msg::Action action_;
  msg::TaskSettings taken_settings_;
  msg::EpisodeAcknowledgement acknowledgement_;
  msg::EpisodeStat episode_;
  msg::ServiceStatus status_;
};

EnvService::EnvService(const Traversal& traversal, const EnvServiceOptions& options)
    : traversal_(traversal),
      node_(node_options(options.node, traversal_)),
      rejections_(node_),
      environment_(traversal_, options.agents, options.imperfections, options.goals),
      server_(node_, environment_),
      scenes_(node_, environment_),
      info_(server_.info()),
      outbox_(options.recorders),
      linger_(options.linger) {
  environment_.allow_evaluation_agents(options.evaluation_agents);
  if (options.live)
    live_ = std::make_unique<LiveSteps>(
        environment_, std::make_unique<Robot>(options.live->robot, node_.options().id, node_.options().middleware,
                                              traversal_, *options.live->images));
  node_.create_reader_at<msg::ServiceStatus>(node_.options().id);  // of another process with this id
  node_.create_reader<msg::TaskSettings>();
  node_.create_reader<msg::Action>();
  node_.create_reader<msg::EpisodeAcknowledgement>();
  node_.create_writer<msg::TraversalInfo>();
  node_.create_writer<msg::Observation>();
  node_.create_writer<msg::EpisodeStat>();
  node_.create_writer<msg::Scene>();
}

void EnvService::run(const std::function<bool()>& stop) {
  now_ = last_report_ = next_report_ = next_info_ = Clock::now();
  spdlog::info("'{}' in session '{}': traversal {} of {}, {} frames {}, {} agents, hash {:016x}, over {}",
               node_.options().id, node_.options().session, traversal_.name, traversal_.dataset, traversal_.frames,
               traversal_.images ? "of images" : "x " + std::to_string(traversal_.dimension) + " features",
               environment_.agents(), environment_.traversal_hash(), node_.middleware_name());
  // The policy_service waits for the observation that its action leads to. A robot takes longer than waking a thread.
  if (!live_)
    node_.answer_at_once([this] {
      now_ = Clock::now();
      while (node_.take(action_)) on_action(action_);
      return next_due() <= now_;
    });
  while (!stop()) {
    take_messages();
    now_ = Clock::now();
    do_due_work();
    node_.wait(server_.send_objects() ? now_ : std::min(next_due(), now_ + kStopCheckInterval));
  }
  leave();
}

void EnvService::take_messages() {
  now_ = Clock::now();
  while (node_.take(action_)) on_action(action_);
  while (node_.take(taken_settings_)) on_settings(taken_settings_);
  while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  if (server_.take_requests()) send_info();  // what is needed to read the objects
  while (node_.take(status_)) on_status(status_);
}

/// Returns whether settings are new and their sender is in charge. Answers those that are not.
bool EnvService::accepts(const msg::TaskSettings& settings) {
  const msg::SettingsId& id = settings.settings();
  if (id.version() == 0 || id.incarnation() != settings.header().incarnation()) {
    rejections_.add(settings.header(), "settings without a version, or in the name of another process");
    return false;
  }
  const std::string sender = settings.header().sender().c_str();
  const bool takes_over = policies_.in_charge() && !policies_.in_charge(id.incarnation());
  const double silence = std::chrono::duration<double>(now_ - policies_.last_heard()).count();
  const bool refused = !refusal_.empty() && same_but_header(settings, settings_);
  using Verdict = CommandTarget::Verdict;
  switch (refused ? Verdict::kOld : policies_.take(id.incarnation(), id.version(), now_)) {
    case Verdict::kNew:
      break;
    case Verdict::kOld:
      ++node_.traffic.repeated;
      // Their sender has not seen yet that they are in force. Observations show it too, but not while idle.
      if (id == info_.settings()) send_info();
      if (policies_.replaced(id.incarnation())) refuse(settings.header(), "settings of a service that was replaced");
      return false;
    case Verdict::kTooFarAhead:
      rejections_.add(settings.header(), "settings with a version far ahead of the last ones");
      return false;
    case Verdict::kNotInCharge:
      refuse(settings.header(), "settings while another policy_service is in charge");
      return false;
  }
  if (takes_over)
    spdlog::warn("policy_service '{}' takes over from {}, which was last heard {:.1f} s ago", sender,
                 sender == policy_id_ ? "its earlier process" : "'" + policy_id_ + "'", silence);
  watch_policy(sender);
  return true;
}

void EnvService::on_settings(const msg::TaskSettings& settings) {
  if (settings.environment() != node_.options().id || !accepts(settings)) return;
  outbox_.force_successor(settings.header(), now_);  // that its predecessor stops may be lost
  info_.settings() = msg::SettingsId();
  info_.by_reference() = false;
  settings_ = settings;
  observation_sender_.confirm();
  policy_silent_ = masked_action_logged_ = false;
  silence_ = Silence::kNone;
  tasks_done_ = 0;
  refusal_.clear();
  const bool idle = settings.task_mode() == msg::IDLE;
  const msg::SettingsId& id = settings.settings();
  if (idle) spdlog::info("settings {} of '{}': idle", id.version(), policy_id_);
  if (idle || start_task(settings)) {
    policies_.obey(id.version(), !idle);
    info_.settings() = id;
    info_.by_reference() = settings.by_reference();
    outbox_.set_context(settings, traversal_.name);
  }
  send_info();
  if (live_ && (idle || !refusal_.empty())) live_->stop();
  if (!idle && refusal_.empty()) {
    acting_.heard(now_);
    live_ ? live_->reset(settings_) : send_observation();
  }
  report();
}

/// Notes a message of a policy_service that is not in charge, and tells it, at most once a second, which one is.
void EnvService::refuse(const msg::Header& header, const std::string& kind) {
  rejections_.add(header, kind, "'" + policy_id_ + "' is in charge");
  if (now_ >= next_info_) send_info();
}

/// Reads the heartbeats of the policy_service in charge, which show that it lives while it sends no actions.
void EnvService::watch_policy(const std::string& id) {
  if (id == policy_id_) return;
  if (!policy_id_.empty()) node_.release_topics(policy_id_);
  policy_id_ = id;
  node_.create_reader_at<msg::ServiceStatus>(policy_id_);
}

/// Resets the environment. Returns false when it refuses the settings; refusal_ then says why.
bool EnvService::start_task(const msg::TaskSettings& settings) {
  try {
    environment_.reset(settings);
    scenes_.set_belief({});
  } catch (const Error& error) {
    refusal_ = error.what();
    ++node_.traffic.rejected;
    spdlog::error("settings {} of '{}' refused: {}", settings_.settings().version(), policy_id_, refusal_);
    return false;
  }
  std::string what = "training";
  if (settings.task_mode() == msg::EVALUATE)
    what = fmt::format("evaluation tasks {}..{}", settings.first_task(), settings.first_task() + settings.tasks() - 1);
  spdlog::info("settings {} of '{}': {}, {}, at most {} steps, seed {}{}", settings_.settings().version(), policy_id_,
               what, route(settings), settings.max_steps(), settings.seed(),
               settings.shuffle() ? ", frames shuffled" : "");
  return true;
}

void EnvService::on_action(const msg::Action& action) {
  if (action.environment() != node_.options().id) return;
  if (!running() || action.environment_incarnation() != node_.incarnation() || action.step() != observation_.step() ||
      action.settings() != observation_.settings()) {
    if (policies_.replaced(action.header().incarnation())) return refuse(action.header(), kNotInCharge);
    ++node_.traffic.repeated;
    return;
  }
  if (action.header().sender() != settings_.header().sender() ||
      action.header().incarnation() != settings_.header().incarnation())
    return refuse(action.header(), kNotInCharge);
  try {
    live_ ? live_->step(action.choice(), action.belief()) : environment_.step(action.choice());
  } catch (const Error& error) {
    ++node_.traffic.rejected;
    if (!std::exchange(masked_action_logged_, true))
      spdlog::warn("rejected an action of '{}': {} (more under these settings are counted, not logged)",
                   action.header().sender().c_str(), error.what());
    return;
  }
  acting_.heard(now_);
  policies_.hear(action.header().incarnation(), now_);
  scenes_.set_belief(action.belief());
  steps_ += action.choice().size();
  observation_sender_.confirm();
  live_ ? node_.alarm("robot", live_->trouble(now_)) : finish_step();
}

/// Publishes what the agents see after their step.
void EnvService::finish_step() {
  send_observation();  // first: the policy_service waits for it
  record_episodes();
  if (std::exchange(policy_silent_, false)) report();
  if (silence_ == Silence::kLogged) {
    silence_ = Silence::kOver;
    spdlog::info("policy_service '{}' answers again (this is logged once under these settings)", policy_id_);
  }
  if (!running()) {
    spdlog::info("evaluation of settings {} done", settings_.settings().version());
    report();
  }
}

void EnvService::on_acknowledgement(const msg::EpisodeAcknowledgement& acknowledgement) {
  if (acknowledgement.writer() != node_.options().id || acknowledgement.writer_incarnation() != node_.incarnation())
    return;
  const auto result = outbox_.acknowledge(acknowledgement, now_);
  if (result == EpisodeOutbox::Acknowledged::kImpossible)
    rejections_.add(acknowledgement.header(), "an acknowledgement of episodes that do not exist");
  if (result == EpisodeOutbox::Acknowledged::kTooMany)
    rejections_.add(acknowledgement.header(), "an acknowledgement of one recorder too many");
  if (result == EpisodeOutbox::Acknowledged::kRepeated) ++node_.traffic.repeated;
}

void EnvService::on_status(const msg::ServiceStatus& status) {
  node_.check_twin(status);
  const bool leaves = status.service_state() == msg::STOPPING || status.service_state() == msg::FAILED;
  policies_.hear(status.header().incarnation(), now_, leaves);
}

void EnvService::send_info() {
  node_.publish(info_);
  next_info_ = now_ + kHeartbeat;
}

void EnvService::send_observation() {
  environment_.observe(observation_);
  observation_.wants_belief() = live_ || scenes_.watched();
  observation_sender_.begin(now_);
  observation_sender_.take_due(now_);
  node_.publish(observation_);
  // After the last task the observation shows that all agents are idle and needs no answer.
  if (environment_.done()) observation_sender_.confirm();
}

void EnvService::record_episodes() {
  for (const Environment::Episode& episode : environment_.finished()) {
    outbox_.add(episode);
    ++tasks_done_;
  }
  send_episodes();
  if (outbox_.problem() == outbox_problem_) return;
  outbox_problem_ = outbox_.problem();
  node_.alarm("episodes", outbox_problem_);
  report();
}

/// Sends new episodes, and again those that a recorder lacks. During a task several go out at once, because one that
/// comes alone wakes each of its readers.
void EnvService::send_episodes() {
  if (now_ < episodes_due() && outbox_.last() - outbox_.sent() < kEpisodesAtOnce) return;
  last_episodes_ = now_;
  for (std::uint64_t count = 0; count < kEpisodesAtOnce;) {
    const auto sending = outbox_.next(now_);
    if (!sending) return;
    outbox_.fill(sending->number, episode_);
    node_.publish(episode_);
    if (!sending->again) continue;
    ++node_.traffic.resent;
    ++count;
  }
}

void EnvService::do_due_work() {
  if (live_ && live_->advance(now_)) {
    acting_.heard(now_);
    finish_step();
  }
  if (observation_sender_.take_due(now_)) {
    node_.publish(observation_);
    ++node_.traffic.resent;
  }
  if (running() && !policy_silent_ && !acting_.here(now_)) {
    policy_silent_ = true;
    if (live_) live_->release();
    report();
  }
  // One whose heartbeats come thinks.
  if (policy_silent_ && silence_ == Silence::kNone && policies_.silent(now_)) {
    silence_ = Silence::kLogged;
    spdlog::warn("nothing of policy_service '{}' for {} s: waiting for it", policy_id_, kSilence.count());
  }
  // A policy_service at work knows the info; while none is, another one may come.
  if ((!running() || policy_silent_) && now_ >= next_info_) send_info();
  send_episodes();
  scenes_.send(now_, info_, policies_.in_charge() ? &settings_ : nullptr);
  if (now_ >= next_report_) report();
}

Clock::time_point EnvService::episodes_due() const {
  return std::max(outbox_.due(), running() ? last_episodes_ + kCommitGather : Clock::time_point());
}

Clock::time_point EnvService::next_due() const {
  Clock::time_point due = std::min({next_report_, observation_sender_.due(), episodes_due()});
  if (running() && !policy_silent_) due = std::min(due, acting_.gone_at());
  if (!running() || policy_silent_) due = std::min(due, next_info_);
  return live_ ? std::min(due, live_->due()) : due;
}

void EnvService::report() {
  const double elapsed = std::chrono::duration<double>(now_ - last_report_).count();
  const float rate = elapsed > 0 ? static_cast<float>(static_cast<double>(steps_) / elapsed) : 0;
  steps_ = 0;
  last_report_ = now_;
  next_report_ = now_ + kHeartbeat;
  msg::State state = msg::WAITING;
  std::string activity = "waiting for a policy_service";
  if (!refusal_.empty()) {
    state = msg::FAILED;
    activity = "refused settings: " + refusal_;
  } else if (policy_silent_) {
    activity = "waiting for the policy_service";
  } else if (info_.settings().version() != 0 && settings_.task_mode() == msg::IDLE) {
    activity = "idle, as the policy_service asked";
  } else if (info_.settings().version() != 0) {
    if (running() || robot_moves()) state = msg::RUNNING;
    activity = settings_.task_mode() == msg::TRAIN
                   ? "training on " + traversal_.name + ", " + route(settings_)
                   : "evaluation on " + traversal_.name + ": " + std::to_string(tasks_done_) + " of " +
                         std::to_string(settings_.tasks()) + " tasks";
  }
  if (live_) {
    if (live_->awaits_goal()) activity = "waits for a goal: " + activity;
    const std::string trouble = live_->trouble(now_);
    node_.alarm("robot", trouble);
    if (!trouble.empty()) activity = "waits for the robot: " + trouble;
  }
  if (!outbox_problem_.empty()) activity = outbox_problem_ + "; " + activity;
  node_.metrics().set_queue("episodes", outbox_.kept(), EpisodeOutbox::kCapacity);
  node_.report(state, activity, rate);
}

void EnvService::leave() {
  const Clock::time_point begin = Clock::now();
  node_.report(msg::STOPPING, "stopping");
  observation_sender_.confirm();
  if (live_) live_->stop();
  const auto worth_waiting = [&] {
    if (outbox_.kept() == 0 || node_.readers<msg::EpisodeStat>() == 0) return false;
    return now_ < begin + (outbox_.reader_expected(now_) ? std::chrono::ceil<milliseconds>(linger_) : kLingerUnheard);
  };
  now_ = begin;
  outbox_.hurry(now_);
  while (worth_waiting()) {
    send_episodes();
    node_.wait(std::min(outbox_.due(), now_ + kStopCheckInterval));
    now_ = Clock::now();
    while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
    // Messages that are not taken would wake the wait again and again.
    discard(status_, action_, taken_settings_);
    server_.take_requests();
  }
  if (outbox_.kept() == 0)
    spdlog::info("'{}' stops: {} episodes, all acknowledged", node_.options().id, outbox_.last());
  else
    spdlog::warn("'{}' stops: {} episodes, {} of them not acknowledged{}", node_.options().id, outbox_.last(),
                 outbox_.kept(), outbox_.lacking().empty() ? "" : " by " + joined(outbox_.lacking()));
}

}  // namespace

void run_env_service(const EnvServiceOptions& options, const Traversal& traversal, const std::function<bool()>& stop) {
  EnvService(traversal, options).run(stop);
}

}  // namespace citylearn
