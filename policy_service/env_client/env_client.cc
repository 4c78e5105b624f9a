// SPDX-License-Identifier: Apache-2.0
#include "policy_service/env_client/env_client.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/exchange/command.h"
#include "core/exchange/timing.h"
#include "policy_service/env_client/observation_check.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxAlarms = 8;
constexpr int kMaxInvalid = 5;  // observations in a row: a forged one among valid ones is not the env_service's fault

Error did_not_come(const RouteFeatures& route, const EnvHandle& env) {
  return Error(std::to_string(route.transfer.missing()) + " parts of its features did not come",
               "traversal '" + env.traversal() + "'", "is env_service '" + env.id + "' still running?");
}

/// Returns whether an announcement keeps what a process may not change.
bool same_traversal(const msg::TraversalInfo& a, const msg::TraversalInfo& b) {
  return a.hash() == b.hash() && a.frames() == b.frames() && a.agents() == b.agents() &&
         a.traversal() == b.traversal() && a.images() == b.images() && a.rule() == b.rule() &&
         a.places() == b.places() && a.links() == b.links() && a.streets_hash() == b.streets_hash();
}

/// Returns whether the sender is an env_service, or the encoder_service that completed its announcement.
bool serves_features(const std::map<std::string, std::unique_ptr<EnvHandle>>& envs, const msg::Header& header) {
  return std::any_of(envs.begin(), envs.end(), [&](const auto& entry) {
    const msg::TraversalInfo& info = entry.second->info;
    return (header.sender() == info.header().sender() && header.incarnation() == info.header().incarnation()) ||
           (header.sender() == info.encoder_service() && header.incarnation() == info.encoder_incarnation());
  });
}

std::string unconfirmed(const EnvHandle& env) {
  return "does not confirm its settings" + (env.failure.empty() ? "" : ": " + env.failure);
}

/// Notes which settings an env_service obeys by its message.
void note_settings(EnvHandle& env, const msg::SettingsId& settings, std::uint64_t own_incarnation) {
  env.obeys = settings.version() == 0 ? 0 : settings.incarnation();
  if (settings.version() == 0 || settings.incarnation() == own_incarnation) {
    env.heard_other = {};
    return;
  }
  if (env.heard_other == Clock::time_point{}) env.heard_other = Clock::now();
  if (env.in_force()) env.settings_sender.begin(Clock::now());
}

}  // namespace

EnvClient::EnvClient(Node& node, const EnvClientOptions& options)
    : node_(node), options_(options), rejections_(node), features_(node), streets_(node, options.patience) {
  node_.create_reader<msg::TraversalChunk>();
  if (options_.attached_only) {
    node_.create_reader_at<msg::ServiceStatus>(node_.options().id);  // of another process with this id
    return;
  }
  node_.create_reader<msg::ServiceStatus>();
  node_.create_reader<msg::TraversalInfo>();
  node_.create_reader<msg::EpisodeStat>();
}

/// Tells env_services that this process stops, so that the next one need not wait until it counts as silent.
EnvClient::~EnvClient() {
  node_.answer_at_once(nullptr);
  if (!records_) return;
  try {
    for (const auto& [id, env] : envs_) send_acknowledgement(*env, msg::STOPS);
  } catch (const Error&) {  // then the next process has to wait
  }
}

void EnvClient::attach(const std::string& id) {
  if (!attached_.insert(id).second) return;
  node_.create_reader_at<msg::ServiceStatus>(id);
  node_.create_reader_at<msg::TraversalInfo>(id);
}

void EnvClient::detach(const std::string& id) {
  attached_.erase(id);
  node_.release_topics(id);
}

void EnvClient::receive_observations(bool wanted) {
  wants_observations_ = wanted;
  if (!wanted)
    for (const auto& [id, env] : envs_) node_.delete_reader_at<msg::Observation>(id);
}

void EnvClient::answer_at_once() {
  node_.answer_at_once([this] {
    while (node_.take(observation_)) on_observation(observation_);
    return std::exchange(undecided_, false);
  });
}

void EnvClient::spin(Clock::time_point deadline) {
  ask_for_features();
  send_due_settings();
  // Settings and requests are re-sent by this loop, so it never sleeps past their time.
  node_.wait(std::min(deadline, Clock::now() + kStopCheckInterval));
  while (node_.take(info_)) on_info(info_);
  while (node_.take(status_)) on_status(status_);
  while (node_.take(chunk_))
    if (!features_.take(chunk_, serves_features(envs_, chunk_.header())))
      rejections_.add(chunk_.header(), "invalid features");
  handle_streets();
  while (node_.take(observation_)) on_observation(observation_);
  while (node_.take(episode_))
    if (EnvHandle* env = speaking(episode_.header()); env && finished) finished(*env, episode_);
  if (Clock::now() >= next_refusals_) report_refusals();
  if (!records_ || Clock::now() < next_acknowledgements_) return;
  next_acknowledgements_ = Clock::now() + kAcknowledge;
  for (const auto& [id, env] : envs_)
    if (env->alive()) send_acknowledgement(*env);
}

// Which env_services there are, and which of them are used.

EnvHandle* EnvClient::known(const msg::Header& header) {
  const auto found = envs_.find(header.sender().c_str());
  if (found == envs_.end() || found->second->incarnation() != header.incarnation()) return nullptr;
  found->second->presence.hear(header.incarnation(), Clock::now());
  return found->second.get();
}

/// Works as known(), for messages that only the process that announced itself sends.
EnvHandle* EnvClient::speaking(const msg::Header& header) {
  if (EnvHandle* env = known(header)) return env;
  const auto found = envs_.find(header.sender().c_str());
  if (found == envs_.end() || found->second->presence.preceded(header.incarnation()))
    ++node_.traffic.repeated;
  else
    rejections_.add(header, "a message of another process than the one that announced itself");
  return nullptr;
}

void EnvClient::on_status(const msg::ServiceStatus& status) {
  node_.check_twin(status);
  if (EnvHandle* env = known(status.header())) {
    env->busy = status.service_state() == msg::RUNNING;
    env->failure = status.service_state() == msg::FAILED ? status.activity().c_str() : "";
    if (status.service_state() == msg::STOPPING) env->presence.leave();
  }
  services_.on_status(status);
}

std::string EnvClient::other_policy(const EnvHandle& env) const {
  return env.obeys != node_.incarnation() && (env.busy || env.lost()) ? services_.id_of(env.obeys) : "";
}

void EnvClient::on_info(const msg::TraversalInfo& info) {
  if (info.images() && info.feature_dimension() == 0) {  // an encoder_service will publish it again, complete
    if (!known(info.header())) services_.on_images(info);
    return;
  }
  if (options_.attached_only && !attached_.contains(info.header().sender().c_str())) return;  // of before detach()
  // It shows whether the service lives that has the features.
  if (options_.attached_only && info.encoder_incarnation() != 0)
    node_.create_reader_at<msg::ServiceStatus>(info.encoder_service().c_str());
  services_.on_complete(info.header());
  std::unique_ptr<EnvHandle>& slot = envs_[info.header().sender().c_str()];
  if (!slot) slot = std::make_unique<EnvHandle>();
  EnvHandle& env = *slot;
  const Incumbent::Heard heard = env.presence.hear(info.header().incarnation(), Clock::now());
  if (heard == Incumbent::Heard::kOther) {
    ++node_.traffic.repeated;
    return;
  }
  const bool fresh = heard == Incumbent::Heard::kSuccessor;
  if (!fresh && !same_traversal(info, env.info)) {
    rejections_.add(info.header(), "an announcement that differs from what this process said before");
    return;
  }
  if (fresh) env.order = MessageOrder();
  if (!env.order.in_order(info.header(), Clock::now())) return;
  if (!fresh && contents_of(info) != contents_of(env.info) &&
      (env.refusal.empty() ? answers_requests(env) : !why_refused(info).empty())) {
    rejections_.add(info.header(), "an announcement that a second encoder_service completed");
    return;
  }
  const bool forged = obeys_forged_settings(env, info);
  // An env_service that lost its settings was reset by a service that is not known here. One whose observations come
  // has them: what it announced before it took them may arrive later than these, as they are on another topic.
  const bool obeys_ours = env.info.settings() != env.settings.settings() && env.observed.here(Clock::now());
  const bool lost_settings = env.in_force() && info.settings().version() == 0 && !obeys_ours;
  const bool begins_anew = fresh || (env.commands() && (forged || lost_settings));
  env.info = info;
  note_settings(env, info.settings(), node_.incarnation());
  if (begins_anew) {
    env.id = info.header().sender().c_str();
    if (fresh) env.until_restart = false, env.streets.reset();
    env.invalid = 0;
    env.waiting = env.busy = env.episodes_missing = false;
    env.features.reset();
    env.acknowledged = 0;
    env.settings_sender.begin(Clock::now());
  } else if (info.settings() == env.settings.settings()) {
    env.settings_sender.confirm();
  }
  join_or_refuse(env, begins_anew);
}

/// Returns whether an env_service obeys forged settings in this service's name. The next settings will be newer.
bool EnvClient::obeys_forged_settings(EnvHandle& env, const msg::TraversalInfo& info) {
  const msg::SettingsId& id = info.settings();
  if (id.incarnation() != node_.incarnation() || id.version() <= env.given) return false;
  if (id.version() - env.given > kMaxVersionsAhead) return false;  // an env_service would not have taken them
  rejections_.add(info.header(), "settings in force that another participant gave in this service's name");
  version_ = std::max<std::uint32_t>(version_, id.version());
  env.given = id.version();
  return true;
}

/// Decides by an announcement whether the env_service takes part.
void EnvClient::join_or_refuse(EnvHandle& env, bool fresh) {
  const bool joins = fresh || !env.refusal.empty();
  if (!env.until_restart) set_refusal(env, why_refused(env.info));
  if (!env.refusal.empty() || !(joins || env.joining)) return;
  env.joining = env.on_streets() && !env.streets;  // it joins once its map is here
  if (env.joining) return;
  const msg::TraversalInfo& info = env.info;
  EnvHandle*& first = first_[env.traversal()];
  if (!first || !first->usable()) first = &env;
  spdlog::info("{} '{}' joins: traversal {} of {}, {} frames x {} features, {} agents",
               env.commands() ? "restarted env_service" : "env_service", env.id, info.traversal().c_str(),
               info.dataset().c_str(), info.frames(), info.feature_dimension(), info.agents());
  env.settings = msg::TaskSettings();
  if (records_) send_acknowledgement(env);
  if (joined) contain(env, [&] { joined(env); });
}

/// Takes street maps, asks for those of env_services that are to join, and lets them join.
void EnvClient::handle_streets() {
  for (msg::StreetsChunk chunk; node_.take(chunk);)
    if (const EnvHandle* env = known(chunk.header()); env && !streets_.take(env->info, chunk))
      rejections_.add(chunk.header(), "a wrong street map");
  for (const auto& [id, env] : envs_) {
    if (!env->joining || !env->alive()) {
      streets_.forget(id);
      continue;
    }
    contain(*env, [&] { env->streets = streets_.find_or_ask(env->info); });
    if (env->streets) join_or_refuse(*env, true);
  }
}

/// Returns why the run does not use the env_service that announced this; empty when it does.
std::string EnvClient::why_refused(const msg::TraversalInfo& info) const {
  if (std::string wrong = misfit(info, required_); !wrong.empty()) return wrong;
  if (const auto first = first_.find(info.traversal().c_str());
      first != first_.end() && first->second->usable() && info.header().sender() != first->second->id)
    if (std::string wrong = contents_misfit(contents_of(info), contents_of(first->second->info),
                                            "env_service '" + first->second->id + "'");
        !wrong.empty())
      return wrong;
  try {
    by_reference(options_.observing, info);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

void EnvClient::require(EnvRequirements required) {
  required_ = std::move(required);
  for (const auto& [id, env] : envs_)
    if (env->refusal.empty()) set_refusal(*env, why_refused(env->info));
}

void EnvClient::refuse(EnvHandle& env, const std::string& why) {
  if (env.until_restart) return;
  env.until_restart = true;
  set_refusal(env, why);
}

void EnvClient::set_refusal(EnvHandle& env, const std::string& why) {
  if (why == env.refusal) return;
  env.refusal = why;
  if (!why.empty()) env.release(), env.joining = false;
  report_refusals();
}

/// Runs `call`, whose errors concern this env_service alone.
void EnvClient::contain(EnvHandle& env, const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    refuse(env, error.what());
  }
}

/// Returns what keeps an env_service that is present from its part: it is refused, works for another policy_service,
/// does not do as it is told, or nobody encodes its pictures. Empty when nothing does.
std::string EnvClient::trouble_of(const EnvHandle& env) const {
  const Clock::time_point now = Clock::now();
  if (!env.alive()) return "";
  if (!env.refusal.empty()) return "is not used: " + env.refusal;
  if (env.lost()) {
    const std::string other = other_policy(env);
    return "works for " + (other.empty() ? "another policy_service" : "'" + other + "'") +
           "; this one waits until that one ends";
  }
  if (!env.commands()) return "";
  if (env.settings.task_mode() != msg::IDLE && !answers_requests(env) &&
      (env.in_force() ? !env.settings.by_reference() : now - env.commanded > kAlarmDelay))
    return "waits: encoder_service '" + env.info.encoder_service().to_string() + "', which encodes for it, is silent";
  return env.settings_sender.unconfirmed_for(now) > kAlarmDelay ? unconfirmed(env) : "";
}

/// Keeps an alarm for each env_service that has trouble.
void EnvClient::report_refusals() {
  next_refusals_ = Clock::now() + kRefusalInterval;
  for (const auto& [id, env] : envs_) {
    const std::string trouble = trouble_of(*env);
    if (trouble.empty() ? alarms_.erase(id) > 0
                        : alarms_.contains(id) || (alarms_.size() < kMaxAlarms && alarms_.insert(id).second))
      node_.alarm("env_service '" + id + "'", trouble);
  }
}

// Settings.

void EnvClient::command(EnvHandle& env, msg::TaskSettings settings) {
  const bool idle = settings.task_mode() == msg::IDLE;
  if (!idle && !env.refusal.empty()) return;
  settings.environment() = env.id.c_str();
  settings.settings().incarnation() = node_.incarnation();
  settings.settings().version() = env.given = ++version_;
  settings.by_reference() = !idle && by_reference(options_.observing, env.info);
  std::shared_ptr<RouteFeatures> features;
  contain(env, [&] {
    if (settings.by_reference()) features = features_.want(env.info, settings.first_frame(), settings.frames());
  });
  if (!idle && !env.refusal.empty()) return;
  // Releases the earlier features last: they may be the same ones.
  const auto before = std::exchange(env.features, features);
  if (!idle && wants_observations_) {
    node_.create_writer_at<msg::Action>(env.id);
    node_.create_reader_at<msg::Observation>(env.id);
  }
  env.settings = settings;
  env.waiting = false;
  env.next_step = 0;
  env.commanded = Clock::now();
  env.settings_sender.begin(env.commanded);
  send_due_settings();
}

void EnvClient::send_due_settings() {
  const Clock::time_point now = Clock::now();
  for (const auto& [id, env] : envs_) {
    if (!env->commands() || env->in_force()) continue;
    CommandSender& sender = env->settings_sender;
    const bool lacks_features = env->features && !env->features->complete();
    if (lacks_features || !answers_requests(*env) || env->lost()) sender.hold(now);
    if (sender.unconfirmed_for(now) > options_.patience)
      refuse(*env, unconfirmed(*env));
    else if (!lacks_features && sender.take_due(now))
      node_.publish(env->settings);
  }
}

// Observations.

void EnvClient::on_observation(msg::Observation& observation) {
  EnvHandle* env = speaking(observation.header());
  if (!env) return;
  note_settings(*env, observation.settings(), node_.incarnation());
  if (!env->refusal.empty()) {
    rejections_.add(observation.header(), "an observation of an env_service that is not used");
    return;
  }
  // The encoder_service that this run knows will publish the same observation again, with features.
  if (!observation.by_reference() && observation.encoder_incarnation() != env->info.encoder_incarnation()) return;
  if (!env->commands() || observation.settings() != env->settings.settings()) {
    ++node_.traffic.repeated;
    return;
  }
  env->settings_sender.confirm();
  env->observed.heard(Clock::now());
  if (observation.step() + 1 == env->next_step) {  // our answer was lost, or crossed this repetition
    ++node_.traffic.repeated;
    ++node_.traffic.resent;
    node_.publish(env->last_action);
    return;
  }
  if (observation.step() != env->next_step || env->waiting) {
    ++node_.traffic.repeated;
    return;
  }
  if (const std::string wrong = check_and_complete(*env, observation); !wrong.empty()) {
    rejections_.add(observation.header(), "an observation " + wrong);
    if (++env->invalid >= kMaxInvalid) refuse(*env, "sends observations " + wrong);
    return;
  }
  env->invalid = 0;
  env->waiting = true;
  env->wants_belief = observation.wants_belief();
  contain(*env, [&] {
    const bool decided = decide && decide(*env, observation, choice_);
    if (decided) answer(*env, choice_);
    undecided_ = undecided_ || !decided;
  });
}

void EnvClient::answer(EnvHandle& env, const std::vector<std::uint8_t>& choice) {
  msg::Action& action = env.last_action;
  action.environment() = env.id.c_str();
  action.environment_incarnation() = env.incarnation();
  action.settings() = env.settings.settings();
  action.step() = env.next_step;
  action.choice() = choice;
  action.belief() = {};
  if (env.wants_belief && believe) believe(env, action.belief());
  env.waiting = false;
  ++env.next_step;
  node_.publish(action);
}

// Features.

/// Returns whether the service that has the features is alive: the env_service, or the encoder_service behind it.
bool EnvClient::answers_requests(const EnvHandle& env) const {
  if (!env.alive()) return false;
  const std::uint64_t encoder = env.info.encoder_incarnation();
  return encoder == 0 || !services_.id_of(encoder).empty();
}

void EnvClient::ask_for_features() {
  for (const auto& [id, env] : envs_) {
    if (!env->features || env->features->complete()) continue;
    RouteFeatures& route = *env->features;
    if (!answers_requests(*env)) {
      route.progress = Clock::now();  // it may come back
    } else if (Clock::now() - route.progress > options_.patience) {
      refuse(*env, did_not_come(route, *env).what());
      continue;
    }
    features_.ask(route, id);
  }
}

std::vector<float> EnvClient::fetch_features(EnvHandle& env, int first, int count, std::chrono::milliseconds patience) {
  const auto route =
      features_.want(env.info, static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(std::max(count, 0)));
  const Clock::time_point since = Clock::now();
  while (!route->complete()) {
    const Clock::time_point now = Clock::now(), deadline = std::max(since, route->progress) + patience;
    if (now >= deadline || !env.alive()) {
      const Error error = did_not_come(*route, env);
      if (answers_requests(env)) refuse(env, error.what());
      throw error;
    }
    features_.ask(*route, env.id);
    spin(std::min(deadline, std::max(now, route->transfer.due())));
    if (fetching) fetching();
  }
  // The cache may hold more than was asked for.
  const float* begin = route->at(static_cast<std::uint32_t>(first));
  return {begin, begin + static_cast<std::size_t>(count) * route->dimension()};
}

// Episodes.

void EnvClient::begin_recording() {
  records_ = true;
  for (const auto& [id, env] : envs_) acknowledge(*env, 0);
}

void EnvClient::acknowledge(EnvHandle& env, std::uint64_t episode) {
  env.acknowledged = episode;
  send_acknowledgement(env);
}

void EnvClient::send_acknowledgement(const EnvHandle& env, msg::ReaderState state) {
  msg::EpisodeAcknowledgement acknowledgement;
  acknowledgement.writer() = env.id.c_str();
  acknowledgement.writer_incarnation() = env.incarnation();
  acknowledgement.number() = env.acknowledged;
  acknowledgement.state() = state;
  node_.publish(acknowledgement);
}

void EnvClient::end_recording() {
  records_ = false;
  for (const auto& [id, env] : envs_) {
    send_acknowledgement(*env, env->episodes_missing ? msg::STOPS : msg::LEAVES);
    if (env->alive() && env->episodes_missing)
      spdlog::warn("episodes of env_service '{}' did not arrive: it keeps them until the run goes on (--resume)", id);
  }
}

}  // namespace citylearn
