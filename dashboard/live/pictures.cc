// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/pictures.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <span>
#include <utility>

#include "dashboard/live/picture_shrink.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxFetches = 4;    // at once: a picture may have 64 MiB
constexpr std::size_t kMaxOriginals = 4;  // that wait to be shrunk

}  // namespace

Pictures::Pictures(Node& node, const Options& options) : node_(node), options_(options), cache_(options.most_bytes) {}

void Pictures::fetch(const PictureKey& key, const Source& source) {
  if (fetches_.contains(key) || cache_.find(key)) return;
  std::erase_if(waiting_, [&](const auto& one) { return one.first == key; });
  waiting_.emplace_back(key, source);
  if (waiting_.size() > options_.most_waiting) waiting_.pop_front();
}

bool Pictures::fetch_spare(const PictureKey& key, const Source& source, bool idle) {
  const Clock::time_point now = Clock::now();
  if (!waiting_.empty() || !fetches_.empty() || now < std::max(next_, next_spare_)) return false;
  begin(key, source, now, idle ? options_.idle_pause : options_.spare_pause);
  return true;
}

void Pictures::begin(const PictureKey& key, const Source& source, Clock::time_point now, int pause) {
  ObjectFetch object({.hash = key.hash,
                      .retry = options_.patience,
                      .most_tries = RequestTimer::kDefaultTries,
                      .max_bytes = msg::MAX_IMAGE + 1024});
  object.want(key.frame);
  node_.create_reader_at<msg::ImageChunk>(node_.options().id, source.session);
  request(fetches_.try_emplace(key, Fetch{source, std::move(object), now, pause}).first->second, now);
}

bool Pictures::fetching(const PictureKey& key) {
  if (fetches_.contains(key)) return true;
  if (std::any_of(waiting_.begin(), waiting_.end(), [&](const auto& one) { return one.first == key; })) return true;
  const std::lock_guard lock(mutex_);
  return std::any_of(originals_.begin(), originals_.end(), [&](const Original& one) { return one.key == key; });
}

void Pictures::poll(Clock::time_point now) {
  while (node_.take(chunk_)) on_message(chunk_, now);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    if (fetch->second.object.gave_up(now)) {
      spdlog::log(fetch->second.pause > 0 ? spdlog::level::debug : spdlog::level::warn,
                  "frame {} of {:016x} does not arrive from '{}'", fetch->first.frame, fetch->first.hash,
                  fetch->second.source.environment);
      fetch = fetches_.erase(fetch);
    } else {
      request(fetch->second, now);
      ++fetch;
    }
  }
  std::size_t originals = 0;
  {
    const std::lock_guard lock(mutex_);
    originals = originals_.size();
  }
  if (waiting_.empty() || now < next_ || fetches_.size() >= kMaxFetches || originals >= kMaxOriginals) return;
  newest_next_ = !newest_next_;
  const auto [key, source] = newest_next_ ? waiting_.back() : waiting_.front();
  newest_next_ ? waiting_.pop_back() : waiting_.pop_front();
  next_ = now + options_.between;
  begin(key, source, now, 0);
}

Clock::time_point Pictures::due() const {
  Clock::time_point due = Clock::time_point::max();
  for (const auto& [key, fetch] : fetches_) due = std::min(due, fetch.object.due());
  if (!waiting_.empty() && fetches_.size() < kMaxFetches) due = std::min(due, next_);
  return due;
}

void Pictures::request(Fetch& fetch, Clock::time_point now) {
  request_.server() = fetch.source.environment.c_str();
  if (fetch.object.ask(now, request_)) node_.publish(request_, fetch.source.session);
}

void Pictures::on_message(const msg::ImageChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find({chunk.hash(), static_cast<std::uint32_t>(chunk.item())});
  if (found == fetches_.end()) return;
  Fetch& fetch = found->second;
  if (!std::exchange(fetch.arrives, true) && fetch.pause > 0)
    next_spare_ = now + std::chrono::milliseconds(1000 * std::uint64_t{chunk.total_bytes()} / options_.spare_rate);
  if (fetch.object.take(chunk, now) == Taken::kDamaged) ++node_.traffic.rejected;
  const auto object = fetch.object.next();
  if (!object) {
    request(fetch, now);
    return;
  }
  try {
    const auto image = decode_object<msg::Image>(object->bytes);
    if (fetch.pause > 0)
      next_spare_ =
          std::max(next_spare_, now + std::min<Clock::duration>(fetch.pause * (now - fetch.begun), kPauseMax));
    shrink_later(found->first, image);
    fetches_.erase(found);
  } catch (const Error&) {  // there is none, or it means nothing
    ++node_.traffic.rejected;
    fetch.object.refuse(object->item);
  }
}

void Pictures::shrink_later(const PictureKey& key, const msg::Image& image) {
  const std::string name = image.name().c_str();
  if (image.file().empty()) {
    spdlog::warn("frame {} of {:016x}: {}", key.frame, key.hash, name);
    cache_.put(key, {});
    return;
  }
  const auto file = std::as_bytes(std::span(image.file()));
  {
    const std::lock_guard lock(mutex_);
    originals_.push_back({key, Bytes(file.begin(), file.end()), name});
  }
  wake_.notify_one();
}

void Pictures::shrink_all(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (wake_.wait(lock, stop, [this] { return !originals_.empty(); }) && !stop.stop_requested()) {
    const Original& one = originals_.front();  // stays where it is, whatever comes behind it
    lock.unlock();
    PictureFile picture;
    try {
      picture = shrink(one.file, {options_.widest}, one.name);
    } catch (const std::exception& error) {
      spdlog::warn("{}", error.what());
    }
    cache_.put(one.key, std::move(picture));
    lock.lock();
    originals_.pop_front();
  }
}

}  // namespace citylearn
