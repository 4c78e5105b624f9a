// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/episodes_csv.h"

namespace citylearn::testing {

/// A service of a history, alive or ended.
struct Program {
  std::string id, kind;  ///< kind: "policy_service", "env_service" or "recorder_process"
  std::string folder;    ///< a policy_service's --output
  int overwritten = 0;   ///< how often the folder had been overwritten when this one began
  std::unique_ptr<Service> service;
  pid_t process = 0;
  std::optional<int> status;            ///< of its exit
  bool killed = false, warned = false;  ///< by SIGKILL; by SIGTERM
  Clock::time_point news, thaw{};       ///< when it last had news; when it is to continue after SIGSTOP
  std::uint64_t incarnation = 0, run_id = 0;
  std::string says;      ///< what its newest heartbeat says
  bool settled = false;  ///< it has what it needs, its output folder among that

  bool alive() const { return !status; }
  bool frozen() const { return thaw != Clock::time_point{}; }
};

/// Hears everything, and knows from it what must stand in which file, and who is silent for too long.
class Chronicle {
 public:
  /// So long a service may neither make progress nor say what it waits for.
  static constexpr seconds kSilent{10};

  Chronicle(const std::string& middleware, std::uint32_t domain)
      : node_({middleware_options(middleware, domain), "witness", "witness", ""}) {
    node_.create_reader<msg::ServiceStatus>();
    node_.create_reader<msg::RunInfo>();
    node_.create_reader<msg::TrainingStat>();
    node_.create_reader<msg::EpisodeStat>();
  }

  struct Heard {
    std::uint64_t run_id = 0, policy = 0;  ///< policy: incarnation of the process that commanded it
  };
  std::vector<std::unique_ptr<Program>> programs;
  std::map<Source, std::map<std::uint64_t, Heard>> episodes;
  std::map<std::string, Ledger> required;  ///< by folder: episodes that were acknowledged
  std::map<std::string, int> overwritten;  ///< by folder

  void spin() {
    for (const auto& program : programs) {
      if (!program->alive()) continue;
      if (program->frozen() && Clock::now() >= program->thaw) {
        program->service->send(SIGCONT);
        program->thaw = {};
        program->news = Clock::now();
      }
      program->status = program->service->wait(milliseconds(0));
    }
    node_.wait(Clock::now() + milliseconds(20));
    while (node_.take(status_)) on_status(status_);
    while (node_.take(run_))
      if (Program* program = find(run_.header().incarnation())) program->run_id = run_.run_id();
    while (node_.take(stat_)) note_news(stat_.header().incarnation());
    while (node_.take(episode_)) {
      const Source source{episode_.header().sender().c_str(), episode_.header().incarnation()};
      episodes[source][episode_.log().number()] = {episode_.run_id(), episode_.settings().incarnation()};
      discarded_[source] = std::max<std::uint64_t>(discarded_[source], episode_.log().first() - 1);
      note_news(source.incarnation);
      note_news(episode_.settings().incarnation());
    }
    while (node_.take(acknowledgement_)) on_acknowledgement(acknowledgement_);
  }
  bool until(const std::function<bool()>& condition, milliseconds patience) {
    const Clock::time_point deadline = Clock::now() + patience;
    while (!condition()) {
      if (Clock::now() >= deadline) return false;
      spin();
    }
    return true;
  }

  /// Demands of the folders what was acknowledged so far. Call it before a folder is copied or overwritten.
  void require_acknowledged() {
    for (const auto& [incarnation, sources] : acknowledged_) {
      const Program* program = find(incarnation);
      if (!program || program->folder.empty() || program->overwritten != overwritten[program->folder]) continue;
      for (const auto& [source, mark] : sources)
        for (const auto& [number, heard] : episodes[source])
          if (number <= mark.up_to &&
              (heard.policy == incarnation || (heard.run_id == program->run_id && number > mark.others)))
            required[program->folder][source].insert(number);
    }
  }
  /// Returns what all processes of a recorder together acknowledged.
  Ledger acknowledged_by(const std::string& id) const {
    Ledger ledger;
    std::map<Source, std::uint64_t> others;  // have all up to this one since before the recorder was known
    for (const auto& program : programs) {
      const auto found = acknowledged_.find(program->incarnation);
      if (program->id != id || found == acknowledged_.end()) continue;
      for (const auto& [source, mark] : found->second) {
        const std::uint64_t first = others.try_emplace(source, mark.others).first->second;
        for (const auto& [number, heard] : episodes.at(source))
          if (number > first && number <= mark.up_to) ledger[source].insert(number);
      }
    }
    return ledger;
  }
  /// Returns which program has been silent for too long, and what it said last.
  std::string silent() {
    for (const auto& program : programs) {
      if (!program->alive() || program->frozen()) continue;
      if (program->kind != "env_service") note_lag(*program);
      if (Clock::now() - program->news > kSilent)
        return program->id + " is silent; its last words were '" + program->says + "'";
    }
    return "";
  }
  Program* find(std::uint64_t incarnation) const {
    for (const auto& program : programs)
      if (program->incarnation == incarnation && incarnation != 0) return program.get();
    return nullptr;
  }

 private:
  struct Mark {
    std::uint64_t up_to = 0;   ///< acknowledged
    std::uint64_t others = 0;  ///< no longer kept for it when it began
    Clock::time_point since{};
    bool behind = false;
    Clock::time_point behind_since{};
  };

  void note_news(std::uint64_t incarnation) {
    if (Program* program = find(incarnation)) program->news = Clock::now();
  }
  void on_status(const msg::ServiceStatus& status) {
    if (status.service() == "env_service")
      node_.create_reader_at<msg::EpisodeAcknowledgement>(status.header().sender().c_str(),
                                                          status.header().session().c_str());
    for (const auto& program : programs)
      if (program->process == static_cast<pid_t>(status.process()))
        program->incarnation = status.header().incarnation();
    Program* program = find(status.header().incarnation());
    if (!program) return;
    const std::string says =
        std::to_string(status.service_state()) + " " + status.activity().c_str() + "; " + status.alarm().c_str();
    const bool explains = status.service_state() == msg::WAITING || status.alarm().size() > 0;
    if (says != program->says || explains || status.rate() > 0 || program->kind == "recorder_process")
      program->news = Clock::now();
    program->says = says;
    program->settled = status.service_state() != msg::STARTING;
  }
  void on_acknowledgement(const msg::EpisodeAcknowledgement& message) {
    const Source source{message.writer().c_str(), message.writer_incarnation()};
    const auto [entry, fresh] = acknowledged_[message.header().incarnation()].try_emplace(source);
    Mark& mark = entry->second;
    if (fresh) mark.since = Clock::now();
    if (Clock::now() - mark.since < milliseconds(300)) mark.others = discarded_[source];
    if (message.number() > mark.up_to) mark.behind = false;
    mark.up_to = std::max<std::uint64_t>(mark.up_to, message.number());
  }
  /// A recorder that acknowledges nothing although there is something is silent too.
  void note_lag(Program& program) {
    for (auto& [source, mark] : acknowledged_[program.incarnation]) {
      const Program* env = find(source.incarnation);
      const auto& all = episodes[source];
      const bool behind = env && env->alive() && !env->frozen() && !all.empty() && all.rbegin()->first > mark.up_to &&
                          (program.kind == "recorder_process" || all.rbegin()->second.policy == program.incarnation);
      if (behind && mark.behind && Clock::now() - mark.behind_since > kSilent) {
        program.news = {};
        program.says += "; it does not acknowledge what " + source.id + " sends";
      }
      if (behind != mark.behind) mark.behind_since = Clock::now();
      mark.behind = behind;
    }
  }

  Node node_;
  std::map<std::uint64_t, std::map<Source, Mark>> acknowledged_;  // by incarnation of the recorder
  std::map<Source, std::uint64_t> discarded_;                     // episodes up to this one are no longer kept
  msg::ServiceStatus status_;
  msg::RunInfo run_;
  msg::TrainingStat stat_;
  msg::EpisodeStat episode_;
  msg::EpisodeAcknowledgement acknowledgement_;
};

/// The files of a folder and their contents, without the lock.
inline std::map<std::string, std::string> files_of(const std::string& folder) {
  std::map<std::string, std::string> files;
  if (std::filesystem::exists(folder))
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
      if (entry.is_regular_file() && entry.path().filename() != ".lock") files[entry.path()] = contents(entry.path());
  return files;
}

}  // namespace citylearn::testing
