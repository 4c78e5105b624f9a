// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/plugin/registry.h"
#include "env_service/dataset_io/traversal.h"

namespace citylearn {

inline constexpr int kMaxDimension = 4096;  ///< features a frame

/// How frames of two traversals of a route find each other.
enum class Correspondence {
  kIndex,     ///< frame i is frame i
  kMatches,   ///< by the dataset's own match file
  kDistance,  ///< by metres along the route, both starting at the same place
  kGps,       ///< by the nearest latitude and longitude
};

/// Where traversals come from. A dataset is one file of datasets/ that ends in a static Registration.
class Dataset {
 public:
  virtual ~Dataset() = default;
  /// Names of its traversals, sorted unless the dataset has an order of its own; each at most 64 characters. Throws
  /// Error when the folder does not look like this dataset (saying what is missing), so this also recognises it.
  virtual std::vector<std::string> names() = 0;
  /// Reads or generates a whole recording: 2..msg::MAX_FRAMES frames, each of the same 1..kMaxDimension finite features
  /// or with images; positions are always filled. Reads no picture as a whole; broken ones are told by Images::fault.
  /// Throws Error: an unknown name (listing the known ones), or data that are not so (naming file and line).
  virtual Traversal load(const std::string& name) = 0;
  /// The condition load() would tell, without reading the frames.
  virtual std::string condition(const std::string& name) { return name; }
  /// How its traversals correspond unless a person says otherwise.
  virtual Correspondence correspondence() const { return Correspondence::kIndex; }
  /// For Correspondence::kMatches: pairs (frame of a, frame of b), in any order. Throws Error when it has none.
  virtual std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b);
};

/// Factories get the folder given by --data; it is empty when none was. Entry::about tells where the data are to be
/// had: "paper", "address", "licence", "size".
using DatasetRegistry = Registry<Dataset, const std::string&>;

/// Error for `name` that is not among `known`.
Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known);

}  // namespace citylearn
