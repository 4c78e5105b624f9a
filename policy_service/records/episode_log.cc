// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/episode_log.h"

#include <spdlog/fmt/fmt.h>

#include <cinttypes>
#include <filesystem>
#include <fstream>

namespace citylearn {
namespace {

constexpr const char* kHeader =
    "environment,incarnation,episode,agent,traversal,evaluation,task,start,goal,steps,shortest,reward,completed";

}  // namespace

EpisodeLog::EpisodeLog(const std::string& path) : path_(path) {
  if (path_.empty()) return;
  load();
  file_.emplace(path_);
  if (file_->size() == 0) file_->add(std::string(kHeader) + "\n");
}

bool EpisodeLog::has_rows(const std::string& path) {
  std::error_code none;
  const std::uintmax_t size = std::filesystem::file_size(path, none);
  return !none && size > std::string_view(kHeader).size() + 1;
}

void EpisodeLog::load() {
  std::ifstream in(path_);
  if (!in) return;
  std::string line;
  std::uintmax_t whole = 0;  // bytes up to the last complete row
  bool first = true;
  while (std::getline(in, line) && !in.eof()) {
    if (first && line != kHeader) throw Error("is not an episode log", path_, "choose another --output");
    if (!first) {
      char environment[65];
      std::uint64_t incarnation, episode;
      if (std::sscanf(line.c_str(), "%64[^,],%" SCNu64 ",%" SCNu64, environment, &incarnation, &episode) != 3)
        throw Error("is not an episode log: " + line.substr(0, 40), path_, "choose another --output");
      received_[{environment, incarnation}].episodes.record(episode);
      ++total_;
    }
    first = false;
    whole += line.size() + 1;
  }
  in.close();
  if (whole != std::filesystem::file_size(path_)) std::filesystem::resize_file(path_, whole);
}

EpisodeLog::Received& EpisodeLog::received_from(const msg::EpisodeStat& episode) {
  Received& received = received_[{episode.header().sender().c_str(), episode.header().incarnation()}];
  received.episodes.give_up(1, episode.acknowledged());
  return received;
}

void EpisodeLog::skip(const msg::EpisodeStat& episode) { received_from(episode).episodes.record(episode.episode()); }

bool EpisodeLog::record(const msg::EpisodeStat& episode) {
  if (file_ && file_->waiting() > kMostWaiting) return false;
  if (!received_from(episode).episodes.record(episode.episode())) return false;
  ++total_;
  if (file_)
    file_->add(fmt::format("{},{},{},{},{},{},{},{},{},{},{},{:.6f},{}\n", episode.header().sender().c_str(),
                           episode.header().incarnation(), episode.episode(), episode.agent(),
                           episode.traversal().c_str(), episode.evaluation() ? 1 : 0, episode.task(), episode.start(),
                           episode.goal(), episode.steps(), episode.shortest(), episode.reward(),
                           episode.completed() ? 1 : 0));
  return true;
}

std::uint64_t EpisodeLog::recorded(const std::string& environment, std::uint64_t incarnation) {
  const bool handed_on = !file_ || file_->flush();
  const auto found = received_.find({environment, incarnation});
  if (found == received_.end()) return 0;
  if (handed_on) found->second.handed_on = found->second.episodes.settled().reach();
  return found->second.handed_on;
}

}  // namespace citylearn
