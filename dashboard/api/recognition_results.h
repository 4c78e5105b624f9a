// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace citylearn {

/// What vpr wrote: the folder itself, and those below it, that hold a results.json. Looked at anew with each call,
/// since vpr may run meanwhile. May be used by several threads.
class RecognitionResults {
 public:
  /// An empty name: there are none.
  explicit RecognitionResults(std::string folder) : folder_(std::move(folder)) {}

  /// {"name", "file", "matrices": [names], ...the summary}, newest first. One that cannot be read has "error" instead
  /// of the summary.
  nlohmann::json list() const;
  /// Precision over recall, one curve a row; nothing when there is no such result, or it has none.
  std::optional<std::string> curves(const std::string& name) const;
  /// A similarity-*.png of it; the first one where `matrix` is empty.
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
