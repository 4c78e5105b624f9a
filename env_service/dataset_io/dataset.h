// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/plugin/registry.h"
#include "env_service/traversal/traversal.h"

namespace citylearn {

class StreetGraph;

inline constexpr int kMaxDimension = 4096;  ///< features a frame

/// Ways to match frames of two traversals of a route.
enum class Correspondence {
  kIndex,     ///< frame i is frame i
  kMatches,   ///< by the dataset's own match file
  kDistance,  ///< by metres along the route, both starting at the same place
  kGps,       ///< by the nearest latitude and longitude
  kSight,     ///< by what the frames look like
};

/// What load() does not take of a traversal's files, a line each.
struct LeftOut {
  std::vector<std::string> on_purpose;
  std::vector<std::string> faults;  ///< damaged, missing, cut short
};

/// A source of traversals. A dataset is one file of datasets/ that ends in a static Registration.
class Dataset {
 public:
  virtual ~Dataset() = default;
  /// Returns the names of its traversals, sorted unless the dataset has an order of its own; each at most 64
  /// characters. Throws Error that says what is missing when the folder is not of this dataset, so this also recognises
  /// it.
  virtual std::vector<std::string> names() = 0;
  /// Returns whether its folder can be nothing else. If not, recognised() has "plain" first, which reads the user's own
  /// recordings in a folder like it.
  virtual bool distinctive() { return true; }
  /// Reads or generates a whole recording: 2..msg::MAX_FRAMES frames, each of the same 1..kMaxDimension finite features
  /// or with images; positions are always filled. Reads no picture as a whole; Images::fault reports broken ones.
  /// Throws Error when the name is unknown (listing the known ones) or the data are not so (naming file and line).
  virtual Traversal load(const std::string& name) = 0;
  /// Returns the condition of a traversal without reading its frames.
  virtual std::string condition(const std::string& name) { return name; }
  /// Returns how its traversals are matched by default.
  virtual Correspondence correspondence() const { return Correspondence::kIndex; }
  /// Returns pairs (frame of a, frame of b) for Correspondence::kMatches, in any order. Throws Error when it has none.
  virtual std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b);
  /// Returns the map of streets that it has; null where it has none.
  virtual std::shared_ptr<const StreetGraph> streets() { return nullptr; }
  /// Returns lines for a person about that map: what there is, what may be wrong, what recordings show of it.
  virtual std::vector<std::string> describe_streets();
  /// Makes load() return what is seen in each state under `rule`, where there is a map, or frames in a line. Unset: as
  /// the frames fit. Datasets without a map ignore it, and select() makes streets of where a recording drove.
  void walk_by(std::optional<StateRule> rule) { rule_ = rule; }
  std::optional<StateRule> rule() const { return rule_; }
  bool on_streets() const { return rule_ && *rule_ != StateRule::kLine; }
  /// Returns what is not taken of a traversal that was loaded, where files hold more than frames.
  virtual LeftOut left_out(const std::string& /*name*/) { return {}; }

 protected:
  std::optional<StateRule> rule_;
};

/// Factories get the folder given by --data, or an empty text. Entry::about says where to get the data: "paper",
/// "address", "licence", "size".
using DatasetRegistry = Registry<Dataset, const std::string&>;

/// Returns the datasets that `folder` may be: distinctive ones, "plain", others; without generated ones and "live",
/// which reads what "plain" does.
std::vector<std::string> recognised(const std::string& folder);

/// Warns where arrays lie beside recordings, as NumPy writes them, which no dataset reads.
void warn_of_arrays(const std::string& folder);
/// Returns the Error for a `name` that is not among `known`.
Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known);

}  // namespace citylearn
