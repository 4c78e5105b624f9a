// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/image_fetch.h"

#include <algorithm>

namespace citylearn {

void ImageFetch::want(const std::vector<int>& frames) {
  wanted_.insert(wanted_.end(), frames.begin(), frames.end());
  if (asked_ == 0) timer_.ask_now();
}

void ImageFetch::drop(const std::vector<int>& frames) {
  for (const int frame : frames) {
    const auto place = std::find(wanted_.begin(), wanted_.end(), frame);
    if (place == wanted_.end()) continue;
    files_.erase(frame);
    if (place - wanted_.begin() < asked_ && --asked_ == 0) timer_.ask_now();
    wanted_.erase(place);
  }
}

void ImageFetch::on_chunk(const msg::ImageChunk& chunk, std::vector<FetchedImage>& images) {
  if (chunk.hash() != hash_ || chunk.frame() >= static_cast<std::uint32_t>(frames_)) return;
  const int frame = static_cast<int>(chunk.frame());
  const auto place = std::find(wanted_.begin(), wanted_.end(), frame);
  if (place == wanted_.end()) return;
  Blob& file = files_.try_emplace(frame, chunk.total_bytes()).first->second;
  if (file.total_bytes() != chunk.total_bytes()) file = Blob(chunk.total_bytes());
  if (file.take(chunk.chunk(), chunk.data()) != Taken::kYes) return;
  timer_.answered(Clock::now());
  if (!file.complete()) return;
  images.push_back({frame, chunk.name().c_str(), file.release()});
  files_.erase(frame);
  if (place - wanted_.begin() < asked_ && --asked_ == 0) timer_.ask_now();
  wanted_.erase(place);
}

void ImageFetch::ask(const std::string& environment) {
  const Clock::time_point now = Clock::now();
  if (wanted_.empty() || !timer_.is_due(now)) return;
  asked_ = static_cast<int>(std::min<std::size_t>(wanted_.size(), msg::MAX_FRAMES_ASKED));
  request_.environment() = environment.c_str();
  request_.hash() = hash_;
  request_.frames().assign(wanted_.begin(), wanted_.begin() + asked_);
  const auto begun = files_.find(wanted_.front());
  request_.first_chunk() = begun == files_.end() ? 0 : begun->second.chunks.first_missing();
  node_.publish(request_);
  timer_.sent(now, msg::MAX_CHUNKS_ASKED);
}

}  // namespace citylearn
