// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace citylearn {

/// What a learner draws random numbers for; (seed, purpose, update) names a stream of its own.
enum LearnerStream : std::uint64_t { kInitialise = 1, kShuffle = 2, kRelabel = 3 };

}  // namespace citylearn
