// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/runs_feed.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/util/error.h"
#include "dashboard/live/json.h"

namespace citylearn {

RunsFeed::RunsFeed(Hub& hub, std::function<nlohmann::json()> runs, std::chrono::milliseconds period)
    : hub_(hub), runs_(std::move(runs)), period_(period) {}

void RunsFeed::work(const std::stop_token& stop) {
  std::string last;
  std::unique_lock guard(mutex_);
  while (true) {
    wake_.wait_for(guard, stop, period_, [] { return false; });  // a pause that `stop` ends
    if (stop.stop_requested()) return;
    const std::vector<std::string> watched = hub_.watched();
    if (std::find(watched.begin(), watched.end(), "runs") == watched.end()) {
      last.clear();  // the next watcher gets the list
      continue;
    }
    try {
      std::string text = text_of(runs_());
      if (text == last) continue;
      hub_.publish("runs", {}, bytes_of(text), Hub::Merge::kReplace);
      last = std::move(text);
    } catch (const Error& error) {
      spdlog::debug("the list of runs: {}", error.what());  // the recorder and the API report it
    }
  }
}

}  // namespace citylearn
