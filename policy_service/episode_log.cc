#include "policy_service/episode_log.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cerrno>
#include <cinttypes>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace citylearn {
namespace {

constexpr const char* kHeader =
    "environment,incarnation,episode,agent,traversal,evaluation,task,start,goal,steps,shortest,reward,completed";

}  // namespace

void EpisodeLog::Progress::add(std::uint64_t episode) {
  beyond[episode] = true;
  skip_to(contiguous);
}

void EpisodeLog::Progress::skip_to(std::uint64_t episode) {
  contiguous = std::max(contiguous, episode);
  beyond.erase(beyond.begin(), beyond.upper_bound(contiguous));
  while (!beyond.empty() && beyond.begin()->first == contiguous + 1) {
    ++contiguous;
    beyond.erase(beyond.begin());
  }
}

EpisodeLog::EpisodeLog(const std::string& path) : path_(path) {
  if (path_.empty()) return;
  load();
  file_ = std::fopen(path_.c_str(), "a");
  if (!file_) throw Error(std::strerror(errno), path_, "choose another --output");
  if (std::filesystem::file_size(path_) == 0) std::fprintf(file_, "%s\n", kHeader);
}

EpisodeLog::~EpisodeLog() {
  if (file_) std::fclose(file_);
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
      progress_[{environment, incarnation}].add(episode);
      ++total_;
    }
    first = false;
    whole += line.size() + 1;
  }
  in.close();
  if (whole != std::filesystem::file_size(path_)) std::filesystem::resize_file(path_, whole);
}

EpisodeLog::Progress& EpisodeLog::progress_of(const msg::EpisodeStat& episode) {
  Progress& progress = progress_[{episode.header().sender().c_str(), episode.header().incarnation()}];
  progress.skip_to(episode.acknowledged());
  return progress;
}

void EpisodeLog::pass_over(const msg::EpisodeStat& episode) { progress_of(episode).add(episode.episode()); }

bool EpisodeLog::record(const msg::EpisodeStat& episode) {
  Progress& progress = progress_of(episode);
  if (episode.episode() <= progress.contiguous || progress.beyond.contains(episode.episode())) return false;
  progress.add(episode.episode());
  ++total_;
  if (file_)
    fmt::print(file_, "{},{},{},{},{},{},{},{},{},{},{},{:.6f},{}\n", episode.header().sender().c_str(),
               episode.header().incarnation(), episode.episode(), episode.agent(), episode.traversal().c_str(),
               episode.evaluation() ? 1 : 0, episode.task(), episode.start(), episode.goal(), episode.steps(),
               episode.shortest(), episode.reward(), episode.completed() ? 1 : 0);
  return true;
}

std::uint64_t EpisodeLog::recorded(const std::string& environment, std::uint64_t incarnation) {
  if (file_ && (std::fflush(file_) != 0 || std::ferror(file_)))
    throw Error(std::strerror(errno), path_, "free some space");
  const auto found = progress_.find({environment, incarnation});
  return found == progress_.end() ? 0 : found->second.contiguous;
}

}  // namespace citylearn
