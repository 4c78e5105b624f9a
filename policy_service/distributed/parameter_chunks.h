// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/exchange/blob.h"
#include "core/wire/messages.h"
#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Parameters of one version as they travel: cut into PolicyParameters.
class ParameterChunks {
 public:
  ParameterChunks(std::uint64_t version, const Vector<float>& parameters);
  std::uint64_t version() const { return version_; }
  std::uint64_t total_bytes() const { return values_.size() * sizeof(float); }
  std::uint64_t hash() const { return hash_; }
  std::uint32_t chunks() const;
  /// Fills all fields but header and agent.
  void fill(std::uint32_t chunk, msg::PolicyParameters& message) const;

 private:
  std::uint64_t version_, hash_;
  std::vector<float> values_;
};

/// A network's parameters and the number of updates that made them.
struct VersionedParameters {
  std::uint64_t version = 0;
  Vector<float> values;
};

/// Puts the chunks of one learner together again. A version counts once it is complete and its hash is right. Works on
/// two at most: the one it began with, so that a learner that is faster than the wire does not keep it from ever being
/// complete, and the newest.
class ParameterAssembly {
 public:
  explicit ParameterAssembly(std::ptrdiff_t parameters) : parameters_(parameters) {}

  /// Notes that this version exists. Returns false when it is not of this network.
  bool expect(std::uint64_t version, std::uint64_t total_bytes, std::uint64_t hash, std::uint32_t chunks);
  /// Returns false when it does not fit. A chunk that is known already changes nothing.
  bool take(const msg::PolicyParameters& chunk);
  /// Returns the newest complete version, null before the first.
  std::shared_ptr<const VersionedParameters> newest() const { return newest_; }

  struct Missing {
    std::uint64_t version;
    std::vector<std::uint32_t> chunks;  ///< at most MAX_PARTS_ASKED
  };
  /// Returns the chunks to request.
  std::optional<Missing> missing() const;
  /// Gives up the version asked for: the learner has forgotten it.
  void give_up();

 private:
  struct Part {
    std::uint64_t hash;
    Blob blob;
  };
  std::ptrdiff_t parameters_;
  std::map<std::uint64_t, Part> parts_;
  std::shared_ptr<const VersionedParameters> newest_;
};

}  // namespace citylearn
