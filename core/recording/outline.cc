// SPDX-License-Identifier: Apache-2.0
#include "core/recording/outline.h"

#include <algorithm>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "core/recording/mcap.h"
#include "core/recording/recording_clock.h"
#include "core/util/error.h"
#include "core/wire/messages.h"

namespace citylearn {
namespace {

void count(const std::vector<std::int64_t>& positions, std::int64_t length,
           std::array<std::uint64_t, RecordingOutline::kParts>& parts) {
  for (const std::int64_t position : positions) {
    const double share = length > 0 ? static_cast<double>(position) / static_cast<double>(length) : 0;
    const auto part = static_cast<std::size_t>(std::max(share, 0.0) * RecordingOutline::kParts);
    ++parts[std::min(part, RecordingOutline::kParts - 1)];
  }
}

/// Collects the runs of a recording and their updates.
class RunCollector {
 public:
  void on_message(const McapMessage& message, double position) {
    const std::string& topic = message.channel->topic;
    try {
      if (topic == topic_of<msg::TrainingStat>().name) {
        decode(std::span<const std::byte>(message.data), stat_);
        add_update(position);
      } else if (topic == topic_of<msg::RunInfo>().name) {
        decode(std::span<const std::byte>(message.data), info_);
        add_run(position);
      }
    } catch (const Error&) {  // of another protocol: it is not shown either
    }
  }
  std::vector<RecordedRun> take() {
    std::vector<RecordedRun> all;
    for (auto& [key, run] : runs_) {
      const auto& [session, policy, run_id] = key;
      if (run.seed && !run.updates.empty()) all.push_back({session, policy, *run.seed, run_id, std::move(run.updates)});
    }
    return all;
  }

 private:
  struct Run {
    std::optional<std::uint64_t> seed;  // of its RunInfo
    std::uint64_t incarnation = 0;
    std::vector<RecordedUpdate> updates;
  };
  Run& run_of(const msg::Header& header, std::uint64_t run_id) {
    return runs_[{header.session().c_str(), header.sender().c_str(), run_id}];
  }
  void add_run(double position) {
    Run& run = run_of(info_.header(), info_.run_id());
    if (!run.seed && !run.updates.empty()) run.updates.back().position = position;
    run.seed = info_.seed();
  }
  void add_update(double position) {
    Run& run = run_of(stat_.header(), stat_.log().stream());
    const std::uint64_t incarnation = stat_.header().incarnation();
    const bool again =
        run.incarnation == incarnation && !run.updates.empty() && stat_.update() <= run.updates.back().update;
    run.incarnation = incarnation;
    // A clock that was set back: positions stay in order.
    if (!run.updates.empty()) position = std::max(position, run.updates.back().position);
    if (!run.seed) run.updates.clear();  // before its RunInfo no run is shown; then its newest update is
    if (!again) run.updates.push_back({position, stat_.update(), stat_.steps(), stat_.episodes(), stat_.wall()});
  }

  std::map<std::tuple<std::string, std::string, std::uint64_t>, Run> runs_;  // by session, policy_service and run_id
  msg::TrainingStat stat_;
  msg::RunInfo info_;
};

}  // namespace

RecordingOutline outline_of(const std::vector<std::string>& files, const std::stop_token& stop) {
  RecordingClock clock;
  std::vector<std::int64_t> updates, episodes;
  RunCollector runs;
  try {
    for (const std::string& file : files) {
      McapReader reader(file);
      clock.begin_file();
      while (const auto message = reader.next()) {
        if (stop.stop_requested()) break;
        clock.follow(message->log_time);
        const std::string& topic = message->channel->topic;
        if (topic == topic_of<msg::TrainingStat>().name) updates.push_back(clock.position());
        if (topic == topic_of<msg::EpisodeStat>().name) episodes.push_back(clock.position());
        runs.on_message(*message, 1e-9 * static_cast<double>(clock.position()));
      }
    }
  } catch (const Error&) {
  }
  RecordingOutline outline;
  outline.seconds = 1e-9 * static_cast<double>(clock.length());
  count(updates, clock.length(), outline.updates);
  count(episodes, clock.length(), outline.episodes);
  outline.runs = runs.take();
  return outline;
}

}  // namespace citylearn
