// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/playback.h"

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

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

constexpr std::chrono::milliseconds kLook{50};  // whether it is to end

}  // namespace

Playback::Playback(std::uint32_t domain, const ReplayOptions& options)
    : middleware_(inprocess(domain)), replayer_(*middleware_, options) {
  thread_ = std::thread([this] { play(); });
}

Playback::~Playback() {
  stop_ = true;
  thread_.join();
}

void Playback::play() {
  try {
    while (replayer_.turn()) {
      if (stop_) return;
      middleware_->wait(std::min(replayer_.due(), Clock::now() + kLook));
    }
  } catch (const Error& error) {
    tell(error.what());
  }
  const Replayer::Figures& figures = replayer_.figures();
  for (const std::string& remark : figures.remarks) tell(remark);
  for (const auto& [what, count] : figures.skipped) tell(std::to_string(count) + " messages left out: " + what);
  std::uint64_t played = 0;
  for (const auto& [topic, count] : figures.played) played += count;
  tell("the recording is over: " + std::to_string(played) + " messages");
}

void Playback::tell(const std::string& line) {
  const std::lock_guard lock(mutex_);
  news_.push_back(line);
}

std::vector<std::string> Playback::news() {
  const std::lock_guard lock(mutex_);
  return std::exchange(news_, {});
}

TemporaryFolder::TemporaryFolder() : path_((std::filesystem::temp_directory_path() / "citylearn-XXXXXX").string()) {
  if (!mkdtemp(path_.data())) throw Error(std::string("cannot be made: ") + std::strerror(errno), path_);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code none;
  std::filesystem::remove_all(path_, none);
}

}  // namespace citylearn
