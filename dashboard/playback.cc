// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback.h"

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "core/exchange/timing.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

std::unique_ptr<Middleware> inprocess(std::uint32_t domain) {
  MiddlewareOptions options;
  options.name = "inprocess";
  options.domain = domain;
  options.participant = "playback";
  return create_middleware(options);
}

}  // namespace

Playback::Playback(std::uint32_t domain, const ReplayOptions& options)
    : middleware_(inprocess(domain)), replayer_(*middleware_, options) {}

void Playback::play(const std::stop_token& stop) {
  try {
    while (replayer_.poll()) {
      if (stop.stop_requested()) return;
      middleware_->wait(std::min(replayer_.due(), Clock::now() + kStopCheckInterval));
    }
  } catch (const Error& error) {
    report(error.what());
  }
  const ReplayFigures& figures = replayer_.figures();
  for (const std::string& remark : figures.remarks) report(remark);
  for (const auto& [what, count] : figures.skipped) report(std::to_string(count) + " messages skipped: " + what);
  std::uint64_t played = 0;
  for (const auto& [topic, count] : figures.played) played += count;
  report("the recording has ended: " + std::to_string(played) + " messages");
}

void Playback::report(const std::string& line) {
  const std::lock_guard lock(mutex_);
  messages_.push_back(line);
}

std::vector<std::string> Playback::take_messages() {
  const std::lock_guard lock(mutex_);
  return std::exchange(messages_, {});
}

TemporaryFolder::TemporaryFolder() : path_((std::filesystem::temp_directory_path() / "citylearn-XXXXXX").string()) {
  if (!mkdtemp(path_.data())) throw Error(std::string("cannot be made: ") + std::strerror(errno), path_);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code none;
  std::filesystem::remove_all(path_, none);
}

}  // namespace citylearn
