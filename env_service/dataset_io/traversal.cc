// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/traversal.h"

#include <utility>

#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"

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

}  // namespace

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
