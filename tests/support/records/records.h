// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/wire/messages.h"

namespace citylearn::testing {

inline constexpr std::uint64_t kJob = 1'700'000'000'000'000;

inline void sign(msg::Header& header, const std::string& sender, std::uint64_t incarnation, std::uint64_t message = 1,
                 const std::string& run = "demo") {
  header.protocol(msg::PROTOCOL);
  header.session(run);
  header.sender(sender);
  header.incarnation(incarnation);
  header.message(message);
}

/// The place of a record in a log that has dropped nothing.
inline msg::LogPosition log_position(std::uint64_t number, std::uint64_t stream = 0) {
  msg::LogPosition log;
  log.stream(stream);
  log.number(number);
  log.first(1);
  return log;
}

/// A training episode from frame `number` % 100 five frames on, with one step back on the way.
inline msg::EpisodeStat episode(std::uint64_t number, const std::string& environment = "env-summer",
                                std::uint64_t incarnation = 7, std::uint64_t job = kJob) {
  msg::EpisodeStat e;
  sign(e.header(), environment, incarnation, number);
  e.log() = log_position(number);
  e.agent(static_cast<std::uint32_t>(number % 16));
  e.traversal("summer");
  e.start(static_cast<std::uint32_t>(number % 100));
  e.goal(e.start() + 5);
  e.steps(7);
  e.shortest(5);
  e.reward(0.9f);
  e.completed(true);
  e.policy("place_filter");
  e.update(3);
  e.run_id(job);
  e.path({0b01'01'10'01, 0b01'01'01});
  return e;
}

/// A task of an evaluation: done on the shortest path of `shortest` frames, or not at all in 128 steps.
inline msg::EpisodeStat task(std::uint64_t number, std::uint32_t index, bool completed, std::uint32_t shortest = 40,
                             const std::string& policy = "place_filter") {
  msg::EpisodeStat e = episode(number);
  e.evaluation(true);
  e.task(index);
  e.start(0);
  e.goal(shortest);
  e.shortest(shortest);
  e.steps(completed ? shortest : 128);
  e.reward(completed ? 1.0f : -1.0f);
  e.completed(completed);
  e.policy(policy);
  e.update(100);
  e.path({});
  return e;
}

inline std::vector<msg::EpisodeStat> episodes(std::uint64_t first, std::uint64_t last,
                                              const std::string& environment = "env-summer") {
  std::vector<msg::EpisodeStat> all;
  for (std::uint64_t number = first; number <= last; ++number) all.push_back(episode(number, environment));
  return all;
}

inline msg::RunInfo run_info(std::uint64_t updates = 0, std::uint64_t incarnation = 500, std::uint64_t message = 1,
                             std::uint64_t seed = 1, std::uint64_t job = kJob) {
  msg::RunInfo info;
  sign(info.header(), "policy", incarnation, message);
  info.agent("place_filter");
  info.learner("ppo");
  info.seed(seed);
  info.run_id(job);
  info.updates(updates);
  const std::string manifest = R"({"agent":"place_filter","frames":128})";
  info.manifest(std::vector<std::uint8_t>(manifest.begin(), manifest.end()));
  return info;
}

inline msg::RunInfo ended(msg::RunInfo info) {
  info.ended(true);
  return info;
}

inline msg::TrainingStat training_stat(std::uint64_t update, std::uint64_t incarnation = 500, float reward = 0.5f,
                                       std::uint64_t job = kJob) {
  msg::TrainingStat s;
  sign(s.header(), "policy", incarnation, update);
  s.log() = log_position(update, job);
  s.update(update);
  s.steps(512 * update);
  s.episodes(10 * update);
  s.wall(0.25 * static_cast<double>(update));
  s.steps_per_second(2000);
  s.reward(reward);
  s.spl(update == 1 ? std::nanf("") : 0.8f);
  s.episode_length(48);
  s.policy_loss(0.01f);
  s.entropy(1.0f);
  s.learning_rate(1e-3f);
  return s;
}

inline std::vector<msg::TrainingStat> training_stats(std::uint64_t first, std::uint64_t last,
                                                     std::uint64_t incarnation = 500, float reward = 0.5f) {
  std::vector<msg::TrainingStat> all;
  for (std::uint64_t update = first; update <= last; ++update)
    all.push_back(training_stat(update, incarnation, reward));
  return all;
}

inline msg::TraversalInfo traversal_info(const std::string& environment = "env-summer", std::uint64_t incarnation = 7) {
  msg::TraversalInfo info;
  sign(info.header(), environment, incarnation);
  info.dataset("synthetic");
  info.traversal("summer");
  info.condition("summer");
  info.hash(0xFEDCBA9876543210);
  info.frames(160);
  info.agents(16);
  return info;
}

inline msg::ServiceStatus heartbeat(const std::string& service, const std::string& sender, std::uint64_t incarnation,
                                    msg::State state = msg::RUNNING) {
  msg::ServiceStatus status;
  sign(status.header(), sender, incarnation);
  status.service(service);
  status.service_state(state);
  return status;
}

}  // namespace citylearn::testing
