// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/learner_session.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <sstream>

#include "core/exchange/timing.h"

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
  required.learned = {{info_.traversal().c_str(), info_.traversal_hash(), info_.feature_dimension(), std::nullopt}};
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

}  // namespace citylearn
