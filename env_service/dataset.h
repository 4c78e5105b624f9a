#pragma once

#include <string>
#include <vector>

#include "core/registry.h"
#include "env_service/traversal.h"

namespace citylearn {

inline constexpr int kMaxDimension = 4096;  ///< features a frame

/// Where traversals come from. A dataset is one file of datasets/ that ends in a static Registration.
class Dataset {
 public:
  virtual ~Dataset() = default;
  /// Names of its traversals, sorted unless the dataset has an order of its own. Throws Error when they cannot be
  /// listed.
  virtual std::vector<std::string> names() = 0;
  /// Reads or generates one: 2..msg::MAX_FRAMES frames, each of the same 1..kMaxDimension finite features.
  /// Throws Error: an unknown name (listing the known ones), or data that are not so (naming file and line).
  virtual Traversal load(const std::string& name) = 0;
};

/// Factories get the folder given by --data; it is empty when none was.
using DatasetRegistry = Registry<Dataset, const std::string&>;

/// Error for `name` that is not among `known`.
Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known);

}  // namespace citylearn
