// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// Descriptors of one traversal by one encoder, kept in one file, so that a frame is encoded once, ever. Any number of
/// processes may have the file open; each frame written is there for the others at once and survives kill -9. A frame
/// torn by a crash of the machine fails its checksum and counts as absent. Used by any number of threads.
///
/// On NFS (4, or 3 with its lock daemon) no process ever reads wrong numbers and claims hold between machines, but
/// frames written on one machine may be seen on another seconds later, and until then be encoded twice.
class FeatureStore {
 public:
  struct Key {
    std::string encoder;          ///< Encoder::Spec::name
    int dimension = 0;            ///< D
    std::uint64_t traversal = 0;  ///< Traversal::hash
    int frames = 0;               ///< F
  };
  /// Opens or creates the file for `key` in `folder` (created when missing). Throws Error: no such folder can be made,
  /// a file that is not a store or belongs to another key (named, never overwritten), no space.
  FeatureStore(const std::string& folder, const Key& key);
  ~FeatureStore();
  FeatureStore(const FeatureStore&) = delete;
  FeatureStore& operator=(const FeatureStore&) = delete;

  /// The frame's D numbers into `descriptor`; false when it is absent (`descriptor` then holds anything). Throws Error
  /// on an input/output fault.
  bool read(int frame, std::span<float> descriptor) const;
  /// A frame that is there already stays as it is: whoever reads it twice reads the same numbers. Throws Error when the
  /// disk is full (what was there stays).
  void write(int frame, std::span<const float> descriptor);
  /// One for each frame that is there. Reads the index alone: read() still may find a frame torn.
  std::vector<bool> present() const;

  /// Frames first .. first + count - 1, reserved for this object until released, destroyed, or the process ends however
  /// it ends; null when any of them is reserved already, by whomever. A file lock: it binds those who ask for claims.
  class Claim {
   public:
    virtual ~Claim() = default;
  };
  std::unique_ptr<Claim> claim(int first, int count);

  const std::string& path() const;

 private:
  struct Parts;
  std::shared_ptr<Parts> parts_;  ///< claims know it weakly
};

}  // namespace citylearn
