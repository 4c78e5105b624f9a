// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/learner_session.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/exchange/timing.h"
#include "policy_service/distributed/trajectories.h"

namespace citylearn {
namespace {

enum Purpose : std::uint64_t { kSession = 105 };  // of a random stream

/// Parses "cells=256 hidden=512", as a learner writes it.
std::map<std::string, double> parse_parameters(const std::string& text) {
  std::map<std::string, double> values;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const std::size_t equals = word.find('=');
    try {
      if (equals == word.npos) throw std::invalid_argument(word);
      values[word.substr(0, equals)] = std::stod(word.substr(equals + 1));
    } catch (const std::logic_error&) {
      throw Error("'" + word + "' is not name=value", "LearnerInfo.network");
    }
  }
  return values;
}

}  // namespace

std::string validation_error(const msg::LearnerInfo& info) {
  if (info.steps() < 1 || info.steps() > msg::MAX_STEPS) return "with trajectories of " + std::to_string(info.steps());
  if (info.lesson_frames() < 2 || info.lesson_frames() > info.frames()) return "with a lesson beyond the route";
  if (info.window() < 1) return "with no window";
  if (info.frames() > msg::MAX_FRAMES || info.first_frame() > msg::MAX_FRAMES) return "with an impossible route";
  for (const double noise : {info.noise_frame(), info.noise_place(), info.noise_episode()})
    if (!std::isfinite(noise) || noise < 0) return "with an invalid noise";
  return "";
}

bool same_task(const msg::LearnerInfo& one, const msg::LearnerInfo& other) {
  msg::LearnerInfo same = other;
  same.header() = one.header();
  same.training() = one.training();
  same.lesson() = one.lesson();
  same.lesson_frames() = one.lesson_frames();
  same.max_steps() = one.max_steps();
  same.version() = one.version();
  same.hash() = one.hash();
  return same == one;
}

LearnerSession::LearnerSession(Node& node, const msg::LearnerInfo& info, WorkerPool& workers)
    : outbox(node), node_(node), info_(info), workers_(workers) {}

EnvRequirements LearnerSession::requirements() const {
  EnvRequirements required;
  required.traversals = {info_.traversal().c_str()};
  required.first_frame = info_.first_frame();
  required.frames = info_.frames();
  required.feature_dimension = info_.feature_dimension();
  required.learned.traversals = {{info_.traversal().c_str(), info_.traversal_hash(), info_.feature_dimension()}};
  return required;
}

bool LearnerSession::serves(const EnvHandle& env) const {
  return env.traversal() == info_.traversal().c_str() && env.usable();
}

bool LearnerSession::prepare(EnvClient& client) {
  if (prepared()) return true;
  const msg::LearnerInfo info = info_;
  EnvHandle* source = nullptr;
  for (const auto& [id, env] : client.envs())
    if (serves(*env)) source = env.get();
  if (!source) return false;
  NetworkTask task;
  task.frames = static_cast<int>(info.frames());
  task.features = static_cast<int>(info.feature_dimension());
  task.streets = source->streets;
  if (task.features > 0) {
    try {
      const std::vector<float> features =
          client.fetch_features(*source, static_cast<int>(info.first_frame()), task.frames, kFeaturesTimeout);
      task.reference = Eigen::Map<const Matrix<float>>(features.data(), task.features, task.frames);
    } catch (const Error& error) {  // tries another env_service next time
      if (source->refusal.empty()) spdlog::warn("{}", error.what());
      return false;
    }
  }
  task_ = std::move(task);
  const auto& entry = NetworkRegistry<float>::instance().find("network", info.agent().c_str());
  network_ = entry.create(
      Parameters("network " + entry.name, entry.parameters, parse_parameters(info.network().c_str())), task_);
  const int steps = static_cast<int>(info.steps());
  collector_ =
      std::make_unique<Collector>(CollectorOptions{info.seed(), static_cast<int>(info.first_frame()), steps, steps,
                                                   info.noise_frame(), info.noise_place(), info.noise_episode()},
                                  task_, *network_, workers_);
  parameters_ = std::make_unique<ParameterFetch>(info_, network_->parameter_count());
  begin_lesson();
  expect_parameters();
  return true;
}

/// Resets the collector under random streams that no other actor, and no other incarnation of this one, uses.
void LearnerSession::begin_lesson() {
  collector_->reset_all(mix_seeds({kSession, node_.incarnation(), info_.header().incarnation(), info_.lesson()}),
                        static_cast<int>(info_.lesson_frames()));
}

void LearnerSession::expect_parameters() {
  if (parameters_->expect(info_)) return;
  throw Error("has other parameters than network '" + std::string(info_.agent().c_str()) + "' of this program",
              "learner '" + learner() + "'", "run the same version everywhere");
}

bool LearnerSession::update(const msg::LearnerInfo& info) {
  const bool lesson = info.lesson() != info_.lesson() || info.lesson_frames() != info_.lesson_frames() ||
                      info.max_steps() != info_.max_steps();
  info_ = info;
  if (!prepared()) return false;
  expect_parameters();
  if (lesson) begin_lesson();
  return lesson;
}

msg::TaskSettings LearnerSession::begin(EnvHandle& env, int slot) {
  Served& served = served_[&env];
  if (served.slot > 0) collector_->remove(served.slot);
  served = Served();
  served.slot = slot;
  collector_->add(slot, static_cast<int>(env.info.agents()));
  msg::TaskSettings settings;
  settings.task_mode() = msg::TRAIN;
  settings.lesson() = info_.lesson();
  settings.first_frame() = info_.first_frame();
  settings.frames() = info_.lesson_frames();
  settings.max_steps() = info_.max_steps();
  settings.max_detour() = info_.max_detour();
  settings.seed() = collector_->environment_seed(slot);
  settings.policy() = info_.agent();
  const ParametersUsed newest = newest_parameters();
  settings.update() = newest ? newest->version : info_.version();
  settings.run_id() = info_.run_id();
  return settings;
}

bool LearnerSession::end(EnvHandle& env) {
  const auto found = served_.find(&env);
  if (found == served_.end()) return false;
  collector_->remove(found->second.slot);
  served_.erase(found);
  return true;
}

std::vector<EnvHandle*> LearnerSession::envs() const {
  std::vector<EnvHandle*> found;
  for (const auto& [env, served] : served_) found.push_back(env);
  return found;
}

bool LearnerSession::blocked() const {
  return std::any_of(served_.begin(), served_.end(), [](const auto& entry) { return entry.second.blocked; });
}

bool LearnerSession::act(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  const auto found = served_.find(&env);
  if (found == served_.end()) return false;
  Served& served = found->second;
  if (!served.parameters) served.parameters = newest_parameters();
  if (collector_->act(served.slot, observation, served.parameters->values, choice)) return true;
  send_segment(env, served);
  served.blocked = true;
  return begin_next_segment(served, choice);
}

bool LearnerSession::resume(EnvHandle& env, std::vector<std::uint8_t>& choice) {
  Served& served = served_.at(&env);
  return served.blocked && env.waiting && begin_next_segment(served, choice);
}

/// Begins the next segment, with the newest complete parameters, if there is room for it.
bool LearnerSession::begin_next_segment(Served& served, std::vector<std::uint8_t>& choice) {
  if (served.segments.size() >= info_.window()) return false;
  served.blocked = false;
  served.parameters = newest_parameters();
  collector_->resume(served.slot, served.parameters->values, choice);
  return true;
}

void LearnerSession::send_segment(const EnvHandle& env, Served& served) {
  const Rollout& rollout = collector_->rollout(served.slot);
  for (int agent = 0; agent < rollout.inputs.agents; ++agent) {
    msg::Trajectory& trajectory = outbox.add();
    trajectory.learner() = info_.header().sender();
    trajectory.environment() = env.id.c_str();
    trajectory.agent() = static_cast<std::uint32_t>(agent);
    trajectory.settings() = env.settings.settings();
    trajectory.step() = served.segment_step;
    trajectory.lesson() = env.settings.lesson();
    trajectory.version() = served.parameters->version;
    pack(rollout, agent, trajectory);
  }
  served.segment_step += static_cast<std::uint64_t>(rollout.inputs.steps);
  served.segments.push_back(outbox.last());
  collector_->begin_segment(served.slot);
  outbox.send_due();
}

LogSender::Acknowledged LearnerSession::acknowledge(const msg::LogAcknowledgement& acknowledgement) {
  const LogSender::Acknowledged result = outbox.acknowledge(acknowledgement);
  if (result != LogSender::Acknowledged::kYes) return result;
  for (auto& [env, served] : served_)
    while (!served.segments.empty() && served.segments.front() <= outbox.acknowledged()) served.segments.pop_front();
  outbox.send_due();
  return result;
}

}  // namespace citylearn
