// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/image_fetch.h"

#include <algorithm>
#include <cstring>

namespace citylearn {
namespace {

constexpr auto kAskAgain = std::chrono::milliseconds(300);

}  // namespace

void ImageFetch::want(const std::vector<int>& frames) {
  wanted_.insert(wanted_.end(), frames.begin(), frames.end());
  if (asked_ == 0) again_ = Clock::now();
}

void ImageFetch::on_chunk(const msg::ImageChunk& chunk, std::vector<FetchedImage>& images) {
  if (chunk.hash() != hash_ || chunk.frame() >= static_cast<std::uint32_t>(frames_)) return;
  const int frame = static_cast<int>(chunk.frame());
  const auto place = std::find(wanted_.begin(), wanted_.end(), frame);
  if (place == wanted_.end()) return;
  Part& part = parts_[frame];
  if (part.file.size() != chunk.total_bytes() || part.chunks.empty()) {
    part.left = std::max<std::uint32_t>(1, (chunk.total_bytes() + msg::MAX_CHUNK - 1) / msg::MAX_CHUNK);
    part.chunks.assign(part.left, false);
    part.file.resize(chunk.total_bytes());
  }
  if (part.chunks[chunk.chunk()]) return;  // came twice
  part.chunks[chunk.chunk()] = true;
  if (!chunk.data().empty())
    std::memcpy(part.file.data() + std::size_t{chunk.chunk()} * msg::MAX_CHUNK, chunk.data().data(),
                chunk.data().size());
  --expected_;
  if (--part.left == 0) {
    images.push_back({frame, chunk.name().c_str(), std::move(part.file)});
    parts_.erase(frame);
    if (place - wanted_.begin() < asked_) --asked_;
    wanted_.erase(place);
  }
  // All that was asked for has come, or as much as one request brings: ask for more at once.
  if (asked_ == 0 || expected_ <= 0) again_ = Clock::now();
}

void ImageFetch::ask(const std::string& environment) {
  const Clock::time_point now = Clock::now();
  if (wanted_.empty() || now < again_) return;
  asked_ = static_cast<int>(std::min<std::size_t>(wanted_.size(), msg::MAX_FRAMES_ASKED));
  expected_ = msg::MAX_CHUNKS_ASKED;
  request_.environment() = environment.c_str();
  request_.hash() = hash_;
  request_.frames().assign(wanted_.begin(), wanted_.begin() + asked_);
  request_.first_chunk() = 0;
  if (const auto part = parts_.find(wanted_.front()); part != parts_.end())
    request_.first_chunk() = static_cast<std::uint32_t>(
        std::find(part->second.chunks.begin(), part->second.chunks.end(), false) - part->second.chunks.begin());
  node_.publish(request_);
  again_ = now + kAskAgain;
}

}  // namespace citylearn
