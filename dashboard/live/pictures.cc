// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/pictures.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "dashboard/live/picture_shrink.h"

namespace citylearn {
namespace {

constexpr std::size_t kMostFetches = 4;  // under way: a picture may have 64 MiB
constexpr std::size_t kMostWork = 4;     // that wait to be made small
constexpr int kTries = 6;                // requests without an answer, then it does not come

}  // namespace

Pictures::Pictures(Node& node, const Options& options)
    : node_(node), options_(options), cache_(options.most_bytes), thread_([this] { work(); }) {}

Pictures::~Pictures() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void Pictures::want(const PictureKey& key, const Source& source) {
  if (fetches_.contains(key) || cache_.find(key)) return;
  std::erase_if(wanted_, [&](const auto& one) { return one.first == key; });
  wanted_.emplace_back(key, source);
  if (wanted_.size() > options_.most_wanted) wanted_.pop_front();
}

bool Pictures::coming(const PictureKey& key) {
  if (fetches_.contains(key)) return true;
  if (std::any_of(wanted_.begin(), wanted_.end(), [&](const auto& one) { return one.first == key; })) return true;
  const std::lock_guard lock(mutex_);
  return std::any_of(work_.begin(), work_.end(), [&](const Work& one) { return one.key == key; });
}

void Pictures::turn(Clock::time_point now) {
  while (listens_ && node_.take(chunk_)) hear(chunk_, now);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    if (!fetch->second.timer.is_due(now)) {
      ++fetch;
    } else if (fetch->second.timer.gave_up(now)) {
      spdlog::warn("frame {} of {:016x} does not come from '{}'", fetch->first.frame, fetch->first.hash,
                   fetch->second.source.environment);
      fetch = fetches_.erase(fetch);
    } else {
      ask(fetch->first, fetch->second, now);
      ++fetch;
    }
  }
  std::size_t work = 0;
  {
    const std::lock_guard lock(mutex_);
    work = work_.size();
  }
  if (wanted_.empty() || now < next_ || fetches_.size() >= kMostFetches || work >= kMostWork) return;
  newest_next_ = !newest_next_;
  const auto [key, source] = newest_next_ ? wanted_.back() : wanted_.front();
  newest_next_ ? wanted_.pop_back() : wanted_.pop_front();
  next_ = now + options_.between;
  Fetch& fetch = fetches_.try_emplace(key, Fetch{source, RequestTimer(options_.patience, kTries)}).first->second;
  ask(key, fetch, now);
}

Clock::time_point Pictures::due() const {
  Clock::time_point due = Clock::time_point::max();
  for (const auto& [key, fetch] : fetches_) due = std::min(due, fetch.timer.due());
  if (!wanted_.empty() && fetches_.size() < kMostFetches) due = std::min(due, next_);
  return due;
}

void Pictures::ask(const PictureKey& key, Fetch& fetch, Clock::time_point now) {
  if (!listens_) node_.create_reader<msg::ImageChunk>();
  listens_ = true;
  fetch.timer.sent(now, msg::MAX_CHUNKS_ASKED);
  msg::ImageRequest request;
  request.environment() = fetch.source.environment.c_str();
  request.hash() = key.hash;
  request.frames() = {key.frame};
  request.first_chunk() = fetch.file ? fetch.file->chunks.first_missing() : 0;
  node_.publish(request, fetch.source.run);
}

void Pictures::hear(const msg::ImageChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find({chunk.hash(), chunk.frame()});
  if (found == fetches_.end()) return;  // an encoder_service wants it
  Fetch& fetch = found->second;
  if (!fetch.file) fetch.file.emplace(chunk.total_bytes());
  if (fetch.file->total_bytes() != chunk.total_bytes()) return;
  if (fetch.file->take(chunk.chunk(), chunk.data()) != Taken::kYes) return;
  fetch.timer.answered(now);
  if (fetch.file->complete()) {
    hand_over(found->first, fetch.file->release(), chunk.name().c_str());
    fetches_.erase(found);
  } else if (fetch.timer.is_due(now)) {
    ask(found->first, fetch, now);
  }
}

void Pictures::hand_over(const PictureKey& key, Bytes file, const std::string& name) {
  if (file.empty()) {
    spdlog::warn("frame {} of {:016x}: {}", key.frame, key.hash, name);
    cache_.put(key, {});
    return;
  }
  {
    const std::lock_guard lock(mutex_);
    work_.push_back({key, std::move(file), name});
  }
  wake_.notify_one();
}

void Pictures::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stop_ || !work_.empty(); });
    if (stop_) return;
    const Work& one = work_.front();  // stays where it is, whatever comes behind it
    lock.unlock();
    PictureFile picture;
    try {
      picture = shrink(one.file, options_.widest, one.name);
    } catch (const std::exception& error) {
      spdlog::warn("{}", error.what());
    }
    cache_.put(one.key, std::move(picture));
    lock.lock();
    work_.pop_front();
  }
}

}  // namespace citylearn
