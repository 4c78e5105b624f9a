// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback/playback.h"

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

void Timeline::read(const std::stop_token& stop) {
  auto outline = std::make_shared<const RecordingOutline>(outline_of(files_, stop));
  const std::lock_guard lock(mutex_);
  outline_ = std::move(outline);
}

std::shared_ptr<const RecordingOutline> Timeline::outline() const {
  const std::lock_guard lock(mutex_);
  return outline_;
}

Playback::Playback(std::uint32_t domain, const ReplayOptions& options, std::uint64_t generation,
                   const Timeline& timeline)
    : options_(options),
      generation_(generation),
      timeline_(timeline),
      middleware_(inprocess(domain)),
      replayer_(*middleware_, options),
      asked_(options.start > 0 ? 1 : 0) {}

ReplayState Playback::state() const {
  const std::lock_guard lock(mutex_);
  ReplayState state = restart_ ? restart_->begin() : replayer_.clock().state();
  state.seeking = state.seeking || restart_ || shown_ != asked_;
  return state;
}

std::optional<std::uint64_t> Playback::arrived() const {
  const std::lock_guard lock(mutex_);
  if (restart_ || shown_ == asked_ || replayer_.clock().state().seeking) return std::nullopt;
  return asked_;
}

void Playback::show(std::uint64_t arrival) {
  const std::lock_guard lock(mutex_);
  shown_ = arrival;
}

void Playback::change(const PlaybackChange& change) {
  const std::lock_guard lock(mutex_);
  ReplayClock& clock = replayer_.clock();
  const ReplayState now = clock.state();
  if (change.position && (restart_ || *change.position < now.position)) {
    if (!restart_) restart_ = options_;
    restart_->speed = now.speed;
    restart_->paused = now.paused;
    restart_->start = *change.position;
  } else if (change.position) {
    clock.seek(*change.position);
    ++asked_;
  }
  if (change.paused) clock.pause(*change.paused);
  if (change.speed) clock.set_speed(*change.speed);
  if (restart_ && change.paused) restart_->paused = *change.paused;
  if (restart_ && change.speed) restart_->speed = *change.speed;
}

std::optional<ReplayOptions> Playback::restart() const {
  const std::lock_guard lock(mutex_);
  return restart_;
}

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
