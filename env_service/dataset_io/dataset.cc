// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/dataset.h"

#include "core/task/live.h"
#include "core/util/text.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

enum class Fit { kNone, kPossible, kDistinctive };

Fit fit_of(const DatasetRegistry::Entry& entry, const std::string& folder) {
  try {
    const auto dataset = entry.create(Parameters("dataset " + entry.name, entry.parameters, {}), folder);
    return dataset->names().empty() ? Fit::kNone : dataset->distinctive() ? Fit::kDistinctive : Fit::kPossible;
  } catch (const Error&) {
    // What "plain" says of a folder, as of one name twice, goes before what others take of it.
    return entry.name == "plain" && is_folder(folder) ? Fit::kPossible : Fit::kNone;
  }
}

}  // namespace

std::vector<std::string> recognised(const std::string& folder) {
  std::vector<std::string> distinctive, possible;
  for (const auto* entry : DatasetRegistry::instance().entries()) {
    const Fit fit = entry->name == kLive || fit_of(*entry, "") != Fit::kNone ? Fit::kNone : fit_of(*entry, folder);
    if (fit == Fit::kDistinctive) distinctive.push_back(entry->name);
    if (fit == Fit::kPossible) possible.insert(entry->name == "plain" ? possible.begin() : possible.end(), entry->name);
  }
  distinctive.insert(distinctive.end(), possible.begin(), possible.end());
  return distinctive;
}

Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known) {
  if (known.empty()) return Error("no traversals found; expected NAME/, NAME.mp4 or NAME.csv", where);
  return Error("no traversal '" + name + "'", where, "there are: " + joined(known));
}

std::vector<std::pair<int, int>> Dataset::matches(const std::string& a, const std::string& b) {
  throw Error("no match file for '" + a + "' and '" + b + "'", "", "align by index, distance or gps");
}

}  // namespace citylearn
