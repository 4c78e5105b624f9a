// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/episode_log.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cinttypes>
#include <filesystem>
#include <fstream>

#include "core/files/csv.h"
#include "core/files/files.h"

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
  refuse_special_file(path_);
  std::ifstream in(path_);
  if (!in) return;
  std::string line, row;
  std::uintmax_t whole = 0;  // bytes up to the last complete row
  bool first = true, quoted = false;
  while (std::getline(in, line) && !in.eof()) {
    row += line;
    if (row.find('\0') != row.npos) break;
    if (std::count(line.begin(), line.end(), '"') % 2 == 1) quoted = !quoted;
    if (quoted) {  // a field goes on in the next line
      row += '\n';
      continue;
    }
    if (first && row != kHeader) throw Error("is not an episode log", path_, "choose another --output");
    if (!first) {
      const std::vector<std::string> fields = csv_fields(row);
      std::uint64_t incarnation = 0, episode = 0;
      if (fields.size() < 3 || std::sscanf(fields[1].c_str(), "%" SCNu64, &incarnation) != 1 ||
          std::sscanf(fields[2].c_str(), "%" SCNu64, &episode) != 1)
        throw Error("is not an episode log: " + row.substr(0, 40), path_, "choose another --output");
      received_[{fields[0], incarnation}].episodes.record(episode);
      ++total_;
    }
    first = false;
    whole += row.size() + 1;
    row.clear();
  }
  in.close();
  // What follows was being written when the process was killed or the power went, and was not acknowledged.
  if (whole != std::filesystem::file_size(path_)) std::filesystem::resize_file(path_, whole);
}

EpisodeLog::Received& EpisodeLog::received_from(const msg::EpisodeStat& episode) {
  Received& received = received_[{episode.header().sender().c_str(), episode.header().incarnation()}];
  received.episodes.give_up(1, episode.log().first() - 1);
  return received;
}

void EpisodeLog::write_in_order(Received& received) {
  const std::uint64_t reach = received.episodes.settled().reach();
  while (!received.early.empty() && received.early.begin()->first <= reach) {
    if (file_) file_->add(received.early.begin()->second);
    received.early.erase(received.early.begin());
  }
}

void EpisodeLog::skip(const msg::EpisodeStat& episode) {
  Received& received = received_from(episode);
  received.episodes.record(episode.log().number());
  write_in_order(received);
}

bool EpisodeLog::record(const msg::EpisodeStat& episode) {
  if (file_ && file_->waiting() > kMaxWaitingBytes) return false;
  Received& received = received_from(episode);
  const std::uint64_t number = episode.log().number();
  if (received.early.size() >= kMaxEarlyRows && number > received.episodes.settled().reach() + 1) return false;
  if (!received.episodes.record(number)) return false;
  ++total_;
  received.early[number] =
      fmt::format("{},{},{},{},{},{},{},{},{},{},{},{:.6f},{}\n", csv_field(episode.header().sender().c_str()),
                  episode.header().incarnation(), number, episode.agent(), csv_field(episode.traversal().c_str()),
                  episode.evaluation() ? 1 : 0, episode.task(), episode.start(), episode.goal(), episode.steps(),
                  episode.shortest(), episode.reward(), episode.completed() ? 1 : 0);
  write_in_order(received);
  return true;
}

bool EpisodeLog::has_gap(const std::string& environment, std::uint64_t incarnation) const {
  const auto found = received_.find({environment, incarnation});
  return found != received_.end() && !found->second.early.empty();
}

std::uint64_t EpisodeLog::recorded(const std::string& environment, std::uint64_t incarnation) {
  const bool on_disk = !file_ || file_->sync();
  const auto found = received_.find({environment, incarnation});
  if (found == received_.end()) return 0;
  if (on_disk) found->second.on_disk = found->second.episodes.settled().reach();
  return found->second.on_disk;
}

}  // namespace citylearn
