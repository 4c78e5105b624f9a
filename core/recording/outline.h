// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

namespace citylearn {

/// What a timeline shows of recordings that are played one after the other.
struct RecordingOutline {
  static constexpr std::size_t kParts = 100;  ///< equally long ones, in which messages are counted
  double seconds = 0;                         ///< their length, as RecordingClock measures it
  std::array<std::uint64_t, kParts> updates{}, episodes{};
};

/// Reads the files once, without decoding messages. A damaged file counts up to where it is damaged; playing it
/// reports the damage. Returns early, with what was read so far, when `stop` is requested.
RecordingOutline outline_of(const std::vector<std::string>& files, const std::stop_token& stop);

}  // namespace citylearn
