// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/route_archive.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxFailed = 10'000;  // remembered

}  // namespace

void RouteArchive::poll() {
  const Clock::time_point now = Clock::now();
  if (now < due_) return;
  due_ = now + options_.between;
  try {
    request_ ? take_picture() : take_next();
  } catch (const Error& error) {  // a full disk, perhaps, which the recorder reports
    spdlog::debug("maps and pictures are not stored: {}", error.what());
    request_.reset();
    due_ = now + options_.retry_after;
  }
}

void RouteArchive::take_next() {
  const std::vector<TraversalRow> hosted = source_.hosted();
  auto next = std::find_if(hosted.begin(), hosted.end(), [this](const TraversalRow& row) { return row.hash > last_; });
  if (next == hosted.end()) next = hosted.begin();
  if (next == hosted.end()) return;
  if (complete_ >= hosted.size()) {
    complete_ = 0;
    due_ = Clock::now() + options_.look_again;
    return;
  }
  last_ = next->hash;
  complete_ = store_gap(*next) ? 0 : complete_ + 1;
}

/// Begins to store something of a traversal. Returns false when nothing is missing that can be had.
bool RouteArchive::store_gap(const TraversalRow& traversal) {
  const Clock::time_point now = Clock::now();
  const RouteStore::Gaps gaps = store_.gaps(traversal);
  if (gaps.map) {
    const auto map = source_.route_map(traversal.hash);
    if (map) store_.keep(traversal.hash, *map);
    return true;
  }
  for (const RouteStore::Gaps::Place& place : gaps.places) {
    const PictureKey key{traversal.hash, place.frame};
    const auto failed = failed_.find(key);
    if (failed != failed_.end() && now < failed->second) continue;
    request_ = {key, place, now + options_.look_again};
    take_picture();
    return true;
  }
  return false;
}

void RouteArchive::take_picture() {
  const auto [picture, coming] = source_.spare_picture(request_->key);
  if (coming) {
    request_->coming = true;
    due_ = Clock::now() + options_.poll_after;
    return;
  }
  // While others are fetched it waits, but not for an env_service that is gone.
  if (!picture && !request_->coming && Clock::now() < request_->patience) return;
  const Request request = *std::exchange(request_, std::nullopt);
  if (!picture && !request.coming) return;
  bool kept = false;
  if (picture && !picture->bytes.empty()) {
    const auto* bytes = reinterpret_cast<const std::byte*>(picture->bytes.data());
    kept = store_.keep(request.key.hash, request.place,
                       shrink(Bytes(bytes, bytes + picture->bytes.size()), options_.limits, "a picture of a route"));
  }
  if (failed_.size() >= kMaxFailed) failed_.clear();
  if (!kept) failed_[request.key] = Clock::now() + options_.retry_after;
}

}  // namespace citylearn
