// SPDX-License-Identifier: Apache-2.0
#include "core/recording/outline.h"

#include <algorithm>

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

}  // namespace

RecordingOutline outline_of(const std::vector<std::string>& files, const std::stop_token& stop) {
  RecordingClock clock;
  std::vector<std::int64_t> updates, episodes;
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
      }
    }
  } catch (const Error&) {
  }
  RecordingOutline outline;
  outline.seconds = 1e-9 * static_cast<double>(clock.length());
  count(updates, clock.length(), outline.updates);
  count(episodes, clock.length(), outline.episodes);
  return outline;
}

}  // namespace citylearn
