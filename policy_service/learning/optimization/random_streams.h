// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace citylearn {

/// The purposes for which a learner draws random numbers. (seed, purpose, update) names a stream of its own.
enum LearnerStream : std::uint64_t { kInitialise = 1, kShuffle = 2, kRelabel = 3 };

}  // namespace citylearn
