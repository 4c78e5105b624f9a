// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/traversal.h"

#include "core/util/sha256.h"

namespace citylearn {

std::uint64_t Traversal::hash() const {
  Sha256 sha;
  sha.add(dataset);
  sha.add(static_cast<std::uint64_t>(frames));
  sha.add(static_cast<std::uint64_t>(dimension));
  sha.add(features);
  sha.add(positions);
  if (images)
    for (int frame = 0; frame < frames; ++frame) sha.add(images->fingerprint(frame));
  for (const int place : turns) sha.add(static_cast<std::uint64_t>(place));
  return sha.first_8_bytes();
}

}  // namespace citylearn
