// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/live_images.h"

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {

int LiveImages::add(const Bytes& file) {
  live_.push_back(file);
  if (live_.size() > kMaxPictures) {
    live_.pop_front();
    ++dropped_;
  }
  return frames() - 1;
}

void LiveImages::read(int frame, Bytes& bytes) {
  if (!is_live(frame)) return DerivedImages::read(frame, bytes);
  const int index = frame - images_->frames() - dropped_;
  if (index < 0) throw Error("is no longer kept", name(frame));
  bytes = live_.at(static_cast<std::size_t>(index));
}

std::string LiveImages::name(int frame) const {
  return is_live(frame) ? name_ + ", picture " + std::to_string(frame - images_->frames()) : DerivedImages::name(frame);
}

std::uint64_t LiveImages::fingerprint(int frame) const {
  return mix_seeds({session_, is_live(frame) ? static_cast<std::uint64_t>(frame) : DerivedImages::fingerprint(frame)});
}

}  // namespace citylearn
