// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/run_context.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/wire/service.h"

namespace citylearn {

RunContext::RunContext(const PolicyServiceOptions& given, Node& at, EnvClient& envs)
    : options(given), node(at), client(envs), records(options, node, client) {
  client.answer_at_once();
  client.fetching = [this] { handle(); };
}

void RunContext::spin(std::chrono::milliseconds moment) {
  client.spin(Clock::now() + moment);
  handle();
}

void RunContext::handle() {
  if (on_spin) on_spin();
  records.handle();
  if (stop_requested()) throw StopRequested();
}

void RunContext::require(std::optional<int> feature_dimension, const TrainingData& learned) {
  EnvRequirements required;
  required.traversals = {options.evaluate.begin(), options.evaluate.end()};
  if (!required.traversals.empty()) required.traversals.insert(options.train.begin(), options.train.end());
  required.first_frame = static_cast<std::uint32_t>(options.first_frame);
  required.frames = options.cap_frames || all_frames_ ? 0 : static_cast<std::uint32_t>(options.frames);
  required.streets = streets_;
  feature_dimension_ = feature_dimension;
  if (feature_dimension) required.feature_dimension = static_cast<std::uint32_t>(*feature_dimension);
  required.learned = learned_ = learned;
  client.require(std::move(required));
}

void RunContext::fit_route(const std::vector<EnvHandle*>& envs) {
  if (streets_ || envs.empty()) return;
  const EnvHandle& first = env_on(options.train.front()) ? *env_on(options.train.front()) : *envs.front();
  streets_ = first.on_streets();
  if (options.goal_radius > 0 && !*streets_)
    throw Error("is for streets, which '" + first.traversal() + "' has not", "--goal-radius");
  if (options.max_detour == kDefaultDetour) options.max_detour = *streets_ ? 3 : 0;
  const bool capped = std::exchange(options.cap_frames, false);
  all_frames_ = *streets_ && capped;
  for (const EnvHandle* env :
       all_frames_ ? std::vector{&first} : std::vector<const EnvHandle*>(envs.begin(), envs.end())) {
    const int frames = static_cast<int>(env->info.frames()) - options.first_frame;
    if (!capped || frames < 2 || (frames >= options.frames && !*streets_)) continue;
    spdlog::info("'{}' has {} frames: --frames is {}:{}", env->traversal(), env->info.frames(), options.first_frame,
                 options.first_frame + frames);
    if (options.cap_steps) options.max_steps = frames;
    options.frames = frames;
  }
  require(feature_dimension_, learned_);
}

std::shared_ptr<const StateMap> RunContext::streets_on(const std::string& traversal) const {
  const EnvHandle* env = env_on(traversal);
  return env ? env->streets : nullptr;
}

/// Returns whether this run may use an env_service. A learner leaves them to its actors.
bool RunContext::free(const EnvHandle& env) const {
  return env.usable() && (options.role == "learner" || client.other_policy(env).empty());
}

std::vector<EnvHandle*> RunContext::envs_on(const std::string& traversal) const {
  std::vector<EnvHandle*> found;
  for (const auto& [id, env] : client.envs())
    if (env->traversal() == traversal && free(*env)) found.push_back(env.get());
  return found;
}

std::vector<EnvHandle*> RunContext::training_envs() const {
  std::vector<EnvHandle*> found;
  for (const std::string& traversal : options.train)
    for (EnvHandle* env : envs_on(traversal)) found.push_back(env);
  return found;
}

int RunContext::experience_on(const std::string& traversal) const {
  const auto found = std::find(options.train.begin(), options.train.end(), traversal);
  return found == options.train.end() ? -1 : static_cast<int>(found - options.train.begin());
}

EnvHandle* RunContext::env_on(const std::string& traversal) const {
  const std::vector<EnvHandle*> found = envs_on(traversal);
  return found.empty() ? nullptr : found.front();
}

/// Throws Error when an env_service on a traversal without others has data that do not fit the agent of --checkpoint:
/// nobody would change them while this waits.
void RunContext::require_checkpoints_data(const std::string& traversal) const {
  if (!envs_on(traversal).empty()) return;
  for (const auto& [id, env] : client.envs())
    if (env->traversal() == traversal && env->alive())
      if (const std::string wrong = learned_.misfit(contents_of(env->info)); !wrong.empty())
        throw Error(wrong, "env_service '" + id + "' on '" + traversal + "', for " + options.checkpoint,
                    learned_.remedy(traversal));
}

void RunContext::wait_for_envs(const std::set<std::string>& traversals, int training_envs) {
  Clock::time_point since = Clock::now(), next_log = since + std::chrono::seconds(5);
  while (true) {
    std::string missing;
    for (const std::string& traversal : traversals) {
      const int wanted = experience_on(traversal) >= 0 ? training_envs : 1;
      const int found = static_cast<int>(envs_on(traversal).size());
      if (found >= wanted) continue;
      if (!options.checkpoint.empty()) require_checkpoints_data(traversal);
      missing += (missing.empty() ? "" : ", ") + traversal;
      if (wanted > 1) missing += fmt::format(" ({} of {})", found, wanted);
    }
    if (missing.empty()) return;
    // Waiting does not help against a foreign type on our topics.
    const std::vector<std::string> wrong_types = node.discovery().wrong_types();
    if (!wrong_types.empty() && Clock::now() - since > kSilence)
      throw Error("no env_service on " + missing + "; " + wrong_types.front());
    std::string found;
    for (const auto& [id, env] : client.envs()) {
      found += (found.empty() ? "" : ", ") + id + " on " + env->traversal();
      if (!env->refusal.empty()) found += ", which " + env->refusal;
      if (env->joining) found += ", whose street map is on its way";
      if (const std::string other = client.other_policy(*env); !other.empty())
        found += ", which works for '" + other + "'";
    }
    const auto unencoded = client.services().unencoded();
    const auto encoders = client.services().encoders();
    const bool encoding = !unencoded.empty() && std::any_of(encoders.begin(), encoders.end(),
                                                            [](const auto& encoder) { return encoder.working; });
    for (const auto& [id, traversal] : unencoded)
      found += (found.empty() ? "" : ", ") + id + " on " + traversal +
               (encoding ? ", being encoded" : ", whose images wait for an encoder_service");
    found = found.empty() ? "none was found" : "found: " + found;
    for (const std::string& traversal : traversals) {
      const auto is_on = [&](const auto& one) { return one.second == traversal; };
      const auto hosts = [&](const auto& one) { return one.second->traversal() == traversal; };
      if (client.envs().size() + unencoded.size() > 0 && std::none_of(unencoded.begin(), unencoded.end(), is_on) &&
          std::none_of(client.envs().begin(), client.envs().end(), hosts))
        found += "; none is called " + traversal;
    }
    for (const auto& encoder : encoders)
      if (!unencoded.empty() && !encoder.working) found += "; " + encoder.id + ": " + encoder.activity;
    // Encoding may take longer than --wait, and reports its progress.
    if (encoding) since = Clock::now();
    if (options.wait > 0 && seconds_since(since) > options.wait)
      throw EnvServicesMissing(fmt::format("no env_service on {} within {:.0f} s ({})", missing, options.wait, found),
                               "",
                               fmt::format("same --session '{}', --domain {} and --interface there?",
                                           options.node.session, options.node.middleware.domain));
    if (Clock::now() > next_log) {
      if (!encoding) spdlog::info("starting: waiting for env_services on {} ({})", missing, found);
      for (const auto& encoder : encoders)
        if (encoding && encoder.working)
          spdlog::info("starting: waiting for features of {}; {}: {}", missing, encoder.id, encoder.activity);
      next_log += std::chrono::seconds(10);
    }
    node.report(msg::WAITING, "waiting for env_services");
    spin();
  }
}

void RunContext::wait_for_training_envs(int count) {
  wait_for_envs({options.train.begin(), options.train.end()}, count);
}

std::vector<EnvHandle*> RunContext::evaluation_envs(bool remembers) {
  std::set<std::string> traversals(options.evaluate.begin(), options.evaluate.end());
  if (traversals.empty())
    for (const auto& [id, env] : client.envs())
      if (free(*env)) traversals.insert(env->traversal());
  if (traversals.empty() && options.mode == "evaluate") traversals.insert(options.train.front());
  std::set<std::string> awaited = traversals;
  if (remembers) awaited.insert(options.train.begin(), options.train.end());
  wait_for_envs(awaited, 1);
  std::vector<EnvHandle*> envs;
  for (const std::string& traversal : traversals) envs.push_back(env_on(traversal));
  return envs;
}

const std::vector<float>& RunContext::features_on(const std::string& traversal) {
  std::vector<float>& features = features_[traversal];
  while (features.empty()) {
    EnvHandle* env = env_on(traversal);
    if (!env || env->info.feature_dimension() == 0) break;
    node.report(msg::WAITING, "waiting for the features of '" + traversal + "'");
    try {
      const int count = env->streets ? env->streets->states() : options.frames;
      features = client.fetch_features(*env, options.first_frame, count, options.client.patience);
    } catch (const Error&) {
      if (env->alive() && env->refusal.empty()) throw;  // its encoder_service is gone
    }
  }
  return features;
}

const Matrix<float>& RunContext::reference() {
  Matrix<float> all;
  std::optional<TraversalContents> first;
  for (std::size_t i = 0; i < options.train.size(); ++i) {
    const std::string& name = options.train[i];
    if (const EnvHandle* env = env_on(name)) {
      const TraversalContents contents = contents_of(env->info);
      if (!first) first = contents;
      if (const std::string wrong = features_misfit(contents, *first, "'" + first->traversal + "'"); !wrong.empty())
        throw Error(wrong, "traversal '" + name + "'", "train on traversals with features of one kind");
      if (env->streets != streets_on(options.train.front()))
        throw Error("walks on other streets than '" + options.train.front() + "'", "traversal '" + name + "'",
                    "train on traversals of one map, with one rule");
    }
    if (reference_.size() > 0) continue;
    const std::vector<float>& features = features_on(name);
    if (features.empty()) return reference_;
    const auto dimension = static_cast<std::ptrdiff_t>(features.size()) / options.frames;
    if (i == 0) all.resize(dimension, options.frames * static_cast<std::ptrdiff_t>(options.train.size()));
    all.middleCols(static_cast<std::ptrdiff_t>(i) * options.frames, options.frames) =
        Eigen::Map<const Matrix<float>>(features.data(), dimension, options.frames);
    features_.erase(name);  // of a million places 256 MB
  }
  if (reference_.size() == 0) reference_ = std::move(all);
  return reference_;
}

void RunContext::leave() {
  records.end();
  msg::TaskSettings idle;
  idle.task_mode() = msg::IDLE;
  for (const auto& [id, env] : client.envs())
    if (env->alive() && env->commands()) client.command(*env, idle);
  const Clock::time_point begin = Clock::now();
  const auto awaited = [&](const auto& entry) {
    const EnvHandle& env = *entry.second;
    const bool idle_soon = Clock::now() - begin < kReleaseTimeout && env.commands();
    return env.alive() && ((idle_soon && !env.in_force()) || env.episodes_missing);
  };
  // What did not arrive comes again: an env_service would drop the episodes, and this process ends with its figures.
  while (!stop_requested() && Clock::now() - begin < kLinger &&
         (records.reader_expected() || std::any_of(client.envs().begin(), client.envs().end(), awaited))) {
    client.spin(begin + kLinger);
    records.handle();
    records.acknowledge();
  }
  client.end_recording();
}

}  // namespace citylearn
