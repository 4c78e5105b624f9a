// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace citylearn {

/// Reads what vpr wrote: the folder itself, and those below it, that hold a results.json. Each call reads them anew, as
/// vpr may run meanwhile. May be used by several threads.
class RecognitionResults {
 public:
  /// An empty name gives no results.
  explicit RecognitionResults(std::string folder) : folder_(std::move(folder)) {}

  /// Returns {"name", "file", "matrices": [names], ...the summary}, newest first. One that cannot be read has "error"
  /// instead of the summary.
  nlohmann::json list() const;
  /// Returns precision over recall, one curve per row; nothing for an unknown result or one without curves.
  std::optional<std::string> curves(const std::string& name) const;
  /// Returns a similarity-*.png of a result; the first one if `matrix` is empty.
  std::optional<std::string> matrix(const std::string& name, const std::string& matrix) const;

 private:
  struct Folder {
    std::string name, path;
    std::vector<std::string> matrices;
    double time = 0;
  };
  std::vector<Folder> folders() const;
  std::optional<Folder> find(const std::string& name) const;

  std::string folder_;
};

}  // namespace citylearn
