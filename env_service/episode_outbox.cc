// SPDX-License-Identifier: Apache-2.0
#include "env_service/episode_outbox.h"

namespace citylearn {

void EpisodeOutbox::set_context(const msg::TaskSettings& settings, const std::string& traversal) {
  context_ = std::make_shared<EpisodeContext>(EpisodeContext{settings.settings(), settings.task_mode() == msg::EVALUATE,
                                                             settings.shuffle(), traversal, settings.policy().c_str(),
                                                             settings.update(), settings.run_id()});
}

void EpisodeOutbox::add(const Environment::Episode& episode) {
  entries_.push_back({context_, episode});
  LogSender::add();
  drop_acknowledged();
}

void EpisodeOutbox::fill(std::uint64_t number, msg::EpisodeStat& stat) const {
  const auto& [context, episode] = entries_.at(number - acknowledged() - 1);
  stat.log() = position(number);
  stat.settings() = context->settings;
  stat.agent() = static_cast<std::uint32_t>(episode.agent);
  stat.evaluation() = context->evaluation;
  stat.task() = static_cast<std::uint32_t>(episode.task);
  stat.traversal() = context->traversal.c_str();
  stat.start() = static_cast<std::uint32_t>(episode.start);
  stat.goal() = static_cast<std::uint32_t>(episode.goal);
  stat.steps() = static_cast<std::uint32_t>(episode.steps);
  stat.shortest() = static_cast<std::uint32_t>(episode.shortest);
  stat.reward() = episode.reward;
  stat.completed() = episode.completed;
  stat.shuffled() = context->shuffled;
  stat.policy() = context->policy.c_str();
  stat.update() = context->update;
  stat.run_id() = context->run_id;
  stat.path() = episode.path;
}

EpisodeOutbox::Acknowledged EpisodeOutbox::acknowledge(const msg::LogAcknowledgement& acknowledgement,
                                                       Clock::time_point now) {
  const Acknowledged result = LogSender::acknowledge(acknowledgement, now);
  drop_acknowledged();
  return result;
}

void EpisodeOutbox::drop_acknowledged() {
  while (entries_.size() > kept()) entries_.pop_front();
}

}  // namespace citylearn
