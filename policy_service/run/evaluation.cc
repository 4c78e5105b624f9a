// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation.h"

namespace citylearn {

Evaluation::Evaluation(Fleet& fleet, std::vector<Seat*> seats, const EvaluationOptions& options, MakePolicy make_policy)
    : fleet_(fleet), options_(options), make_policy_(std::move(make_policy)) {
  for (Seat* seat : seats) parts_[seat];
}

void Evaluation::begin(Seat& seat) {
  Part& part = parts_.at(&seat);
  part.policy = make_policy_(seat);
  part.episodes.clear();
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.first_frame() = static_cast<std::uint32_t>(options_.first_frame);
  settings.frames() = static_cast<std::uint32_t>(options_.frames);
  settings.max_steps() = static_cast<std::uint32_t>(options_.max_steps);
  settings.seed() = options_.seed;
  settings.tasks() = static_cast<std::uint32_t>(options_.tasks);
  settings.shuffle() = options_.shuffle;
  settings.policy() = options_.policy.c_str();
  settings.update() = options_.update;
  settings.run_id() = options_.job;
  fleet_.command(seat, settings);
}

bool Evaluation::decide(Seat& seat, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  parts_.at(&seat).policy->act(observation, choice);
  steps_ += choice.size();
  return true;
}

void Evaluation::add(const Seat& seat, const msg::EpisodeStat& episode) {
  const auto part = parts_.find(&seat);
  if (part == parts_.end() || episode.settings() != seat.settings.settings()) return;
  part->second.episodes.emplace(episode.task(), episode);
}

bool Evaluation::done() const {
  for (const auto& [seat, part] : parts_)
    if (static_cast<int>(part.episodes.size()) < options_.tasks) return false;
  return true;
}

double Evaluation::share() const {
  double finished = 0;
  for (const auto& [seat, part] : parts_) finished += static_cast<double>(part.episodes.size());
  return parts_.empty() ? 1 : finished / (static_cast<double>(parts_.size()) * options_.tasks);
}

void Evaluation::check_alive() const {
  for (const auto& [seat, part] : parts_)
    if (Clock::now() - seat->presence.last_heard() > options_.patience)
      throw Error("went silent during the evaluation on '" + seat->traversal() + "'", "env_service '" + seat->id + "'",
                  "start it again, then evaluate the checkpoint with --mode evaluate");
}

std::map<std::string, Score> Evaluation::scores() const {
  std::map<std::string, Score> result;
  for (const auto& [seat, part] : parts_) {
    std::vector<msg::EpisodeStat> episodes;
    for (const auto& [task, episode] : part.episodes) episodes.push_back(episode);
    result[seat->traversal()] = score(episodes);
  }
  return result;
}

}  // namespace citylearn
