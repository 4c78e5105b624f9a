// SPDX-License-Identifier: Apache-2.0
#include "core/wire/transfer.h"

#include <algorithm>
#include <cmath>

#include "core/exchange/timing.h"

namespace citylearn {

std::uint32_t frames_per_object(std::uint32_t dimension) {
  return static_cast<std::uint32_t>(msg::MAX_RANGE / (1 + std::uint64_t{std::min(dimension, msg::MAX_DIMENSION)}));
}

std::shared_ptr<const ObjectBytes> traversal_object(
    const ObjectKey& key, std::span<const float> positions,
    const std::function<std::span<const float>(std::uint32_t frame)>& features) {
  const std::uint32_t most = frames_per_object(key.part);
  if (key.item >= positions.size() || key.item % most != 0) return nullptr;
  const std::span<const float> part =
      positions.subspan(key.item).first(std::min<std::size_t>(most, positions.size() - key.item));
  msg::Traversal object;
  object.position().assign(part.begin(), part.end());
  object.features().reserve(part.size() * key.part);
  for (std::size_t frame = 0; key.part > 0 && frame < part.size(); ++frame) {
    const std::span<const float> one = features(static_cast<std::uint32_t>(key.item + frame));
    object.features().insert(object.features().end(), one.begin(), one.end());
  }
  return std::make_shared<ObjectBytes>(key, encode_object(object));
}

Transfer::Transfer(const What& what)
    : what_(what), objects_({.hash = what.hash, .part = what.dimension, .retry = kObjectRetry}) {
  if (what_.count == 0) what_.count = what_.frames - what_.first;
  const std::uint32_t most = frames_per_object(what_.dimension);
  for (std::uint64_t begin = what_.first / most * most; begin < std::uint64_t{what_.first} + what_.count; begin += most)
    objects_.want(begin);
  positions.resize(what_.count);
  features.resize(std::size_t{what_.count} * what_.dimension);
}

Taken Transfer::take(const msg::TraversalChunk& chunk) {
  Taken taken = objects_.take(chunk, Clock::now());
  while (const auto object = objects_.next()) {
    if (put(*object)) continue;
    objects_.refuse(object->item);
    taken = Taken::kDamaged;
  }
  return taken;
}

/// Puts what has come to the rest. Returns false when it means nothing.
bool Transfer::put(const FetchedObject& object) {
  msg::Traversal sent;
  try {
    sent = decode_object<msg::Traversal>(object.bytes);
  } catch (const Error&) {
    return false;
  }
  const auto begin = static_cast<std::uint32_t>(object.item);
  const std::uint32_t count = std::min(frames_per_object(what_.dimension), what_.frames - begin);
  if (std::any_of(sent.position().begin(), sent.position().end(), [](float at) { return std::isinf(at); }))
    return false;
  if (sent.position().size() != count || sent.features().size() != std::size_t{count} * what_.dimension) return false;
  const std::uint32_t from = std::max(begin, what_.first), to = std::min(begin + count, what_.first + what_.count);
  const auto copy = [&](const std::vector<float>& source, std::vector<float>& target, std::size_t width) {
    std::copy_n(source.begin() + static_cast<std::ptrdiff_t>((from - begin) * width), (to - from) * width,
                target.begin() + static_cast<std::ptrdiff_t>((from - what_.first) * width));
  };
  copy(sent.position(), positions, 1);
  copy(sent.features(), features, what_.dimension);
  return true;
}

}  // namespace citylearn
