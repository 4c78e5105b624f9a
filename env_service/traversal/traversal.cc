// SPDX-License-Identifier: Apache-2.0
#include "traversal.h"

#include <cmath>
#include <utility>

#include "core/util/error.h"
#include "core/util/name.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

/// Keeps the values of `frames`, `width` a frame; empty values stay empty.
template <class Number>
void pick(std::vector<Number>& values, const std::vector<int>& frames, std::size_t width = 1) {
  if (values.empty()) return;
  std::vector<Number> kept;
  kept.reserve(frames.size() * width);
  for (const int frame : frames) {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(frame) * width);
    kept.insert(kept.end(), begin, begin + static_cast<std::ptrdiff_t>(width));
  }
  values = std::move(kept);
}

/// Adds `more` of as many frames behind the values of `frames`; where either is empty its values are `unknown`.
template <class Number>
void add(std::vector<Number>& values, int frames, const std::vector<Number>& more, int more_frames, Number unknown) {
  if (values.empty() && more.empty()) return;
  values.resize(static_cast<std::size_t>(frames), unknown);
  values.insert(values.end(), more.begin(), more.end());
  values.resize(static_cast<std::size_t>(frames + more_frames), unknown);
}

}  // namespace

void Traversal::join(const Traversal& other) {
  const std::string both = name + "+" + other.name;
  if (streets || other.streets)
    throw Error("each has the views of a map of streets already", "traversal '" + both + "'", "name one of them");
  if (!images != !other.images || dimension != other.dimension)
    throw Error("one has pictures or features that the other lacks", "traversal '" + both + "'",
                "join recordings of one kind");
  if (both.size() > kMaxNameLength)
    throw Error("the name may have " + std::to_string(kMaxNameLength) + " characters", "traversal '" + both + "'",
                "give the recordings shorter names, or join fewer");
  if (images) images = joined({images, other.images});
  features.insert(features.end(), other.features.begin(), other.features.end());
  for (const auto member : {&Traversal::latitude, &Traversal::longitude, &Traversal::x, &Traversal::y,
                            &Traversal::height, &Traversal::times})
    add(this->*member, frames, other.*member, other.frames, std::nan(""));
  add(positions, frames, other.positions, other.frames, std::nanf(""));
  add(unmatched, frames, other.unmatched, other.frames, false);
  if (begins.empty()) begins.push_back(0);
  begins.push_back(frames);
  frames += other.frames;
  name = both;
  if (condition != other.condition) condition.clear();
}

void Traversal::keep(const std::vector<int>& kept) {
  pick(features, kept, static_cast<std::size_t>(dimension));
  pick(positions, kept);
  pick(latitude, kept);
  pick(longitude, kept);
  pick(x, kept);
  pick(y, kept);
  pick(height, kept);
  pick(times, kept);
  pick(unmatched, kept);
  begins.clear();
  frames = static_cast<int>(kept.size());
}

std::shared_ptr<const StateMap> Traversal::states() const {
  if (!streets) return nullptr;
  auto map = std::make_shared<const StateMap>(*streets, rule, msg::MAX_FRAMES);
  if (map->states() != frames)
    throw Error("has " + std::to_string(frames) + " frames for " + std::to_string(map->states()) + " states",
                "traversal '" + name + "'");
  return map;
}

std::uint64_t Traversal::hash() const {
  Sha256 sha;
  sha.add(dataset);
  sha.add(static_cast<std::uint64_t>(frames));
  sha.add(static_cast<std::uint64_t>(dimension));
  sha.add(features);
  sha.add(positions);
  if (images)
    for (int frame = 0; frame < frames; ++frame) sha.add(images->fingerprint(frame));
  if (streets) {
    sha.add(streets->hash());
    sha.add(static_cast<std::uint64_t>(rule));
  }
  return sha.first_8_bytes();
}

}  // namespace citylearn
