// SPDX-License-Identifier: Apache-2.0
#include "core/exchange/object_fetch.h"

#include <algorithm>
#include <utility>

namespace citylearn {

void ObjectFetch::want(std::uint64_t item) {
  wanted_.push_back(item);
  if (asked_ == 0) timer_.ask_now();
}

void ObjectFetch::remove(const std::deque<std::uint64_t>::iterator& place) {
  parts_.erase(*place);
  if (place < wanted_.begin() + static_cast<std::ptrdiff_t>(asked_) && --asked_ == 0) timer_.ask_now();
  wanted_.erase(place);
}

void ObjectFetch::drop(std::uint64_t item) {
  const auto place = std::find(wanted_.begin(), wanted_.end(), item);
  if (place == wanted_.end()) return;
  remove(place);
  damaged_ = 0;
  if (asked_ == 0) timer_ = RequestTimer(options_.retry, options_.most_tries);
}

bool ObjectFetch::wants(const msg::ObjectChunk& chunk) const {
  return chunk.hash() == options_.hash && chunk.part() == options_.part &&
         std::find(wanted_.begin(), wanted_.end(), chunk.item()) != wanted_.end();
}

Taken ObjectFetch::take(const msg::ObjectChunk& chunk, Clock::time_point now) {
  if (chunk.hash() != options_.hash || chunk.part() != options_.part) return Taken::kNotWanted;
  const auto place = std::find(wanted_.begin(), wanted_.end(), chunk.item());
  if (place == wanted_.end()) return Taken::kNotWanted;
  FetchedObject object{chunk.item(), {}};
  if (chunk.total_bytes() > options_.max_bytes) {
    ++damaged_;
    return Taken::kDamaged;
  }
  if (chunk.total_bytes() > 0) {
    auto part = parts_.try_emplace(object.item, Part{chunk.checksum(), Blob(chunk.total_bytes())}).first;
    Blob& blob = part->second.blob;
    if (blob.total_bytes() != chunk.total_bytes() || part->second.checksum != chunk.checksum())
      part->second = {chunk.checksum(), Blob(chunk.total_bytes())};  // its server has written it anew
    if (const Taken taken = blob.take(chunk.chunk(), chunk.data()); taken != Taken::kYes) return taken;
    timer_.answered(now);
    if (!blob.complete()) return Taken::kYes;
    object.bytes = blob.release();
    if (object_checksum(object.bytes) != chunk.checksum()) {
      parts_.erase(part);
      ++damaged_;
      return Taken::kDamaged;
    }
  } else {
    timer_.answered(now);
  }
  complete_.push_back(std::move(object));
  remove(place);
  return Taken::kYes;
}

std::optional<FetchedObject> ObjectFetch::next() {
  if (complete_.empty()) return std::nullopt;
  FetchedObject object = std::move(complete_.front());
  complete_.pop_front();
  return object;
}

void ObjectFetch::refuse(std::uint64_t item) {
  ++damaged_;
  want(item);
}

bool ObjectFetch::ask(Clock::time_point now, msg::ObjectRequest& request) {
  if (wanted_.empty() || !timer_.is_due(now)) return false;
  asked_ = std::min(wanted_.size(), options_.max_items);
  request.hash() = options_.hash;
  request.part() = options_.part;
  request.items().assign(wanted_.begin(), wanted_.begin() + static_cast<std::ptrdiff_t>(asked_));
  request.chunks().clear();
  std::size_t answers = msg::MAX_CHUNKS_ASKED;
  if (const auto begun = parts_.find(wanted_.front()); begun != parts_.end()) {
    request.chunks() = begun->second.blob.first_missing(msg::MAX_CHUNKS_ASKED);
    if (asked_ == 1) answers = request.chunks().size();
  }
  timer_.sent(now, answers);
  return true;
}

}  // namespace citylearn
