// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace citylearn {

/// Keeps the descriptors of one traversal by one encoder in one file, so that a frame is encoded once, ever. Any number
/// of processes may have the file open; each sees a frame as soon as another has written it, and frames survive kill
/// -9. A frame torn by a crash of the machine fails its checksum and counts as absent. Used by any number of threads.
///
/// On NFS (4, or 3 with its lock daemon) no process ever reads wrong numbers and claims hold between machines, but a
/// frame written on one machine may appear on another seconds later, and until then be encoded twice.
class FeatureStore {
 public:
  struct Key {
    std::string encoder;          ///< Encoder::Spec::name
    int dimension = 0;            ///< D
    std::uint64_t traversal = 0;  ///< Traversal::hash
    int frames = 0;               ///< F
  };
  /// Opens or creates the file for `key` in `folder` (created when missing). Throws Error when the folder cannot be
  /// made, a file is not a store or belongs to another key (it is never overwritten), or the disk is full.
  FeatureStore(const std::string& folder, const Key& key);
  ~FeatureStore();
  FeatureStore(const FeatureStore&) = delete;
  FeatureStore& operator=(const FeatureStore&) = delete;

  /// Reads the frame's D numbers into `descriptor`; returns false when it is absent (`descriptor` then holds anything).
  /// Throws Error on an input/output fault.
  bool read(int frame, std::span<float> descriptor) const;
  /// Writes a frame, unless it is there already: two reads give the same numbers. Throws Error when the disk is full
  /// (frames already there stay).
  void write(int frame, std::span<const float> descriptor);
  /// Returns which frames are there. Reads the index alone, so read() may still find a frame torn.
  std::vector<bool> present() const;

  /// Reserves frames first .. first + count - 1 for this object until the claim is destroyed or the process ends,
  /// however it ends; null when any of them is reserved already. It is a file lock, and binds only those that ask for
  /// claims.
  class Claim {
   public:
    virtual ~Claim() = default;
  };
  std::unique_ptr<Claim> claim(int first, int count);

  const std::string& path() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;  ///< claims hold it weakly
};

}  // namespace citylearn
