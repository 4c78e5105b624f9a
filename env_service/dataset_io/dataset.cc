// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/dataset.h"

#include "core/util/text.h"

namespace citylearn {

Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known) {
  if (known.empty()) return Error("no traversals found; expected NAME/, NAME.mp4 or NAME.csv", where);
  return Error("no traversal '" + name + "'", where, "there are: " + joined(known));
}

std::vector<std::pair<int, int>> Dataset::matches(const std::string& a, const std::string& b) {
  throw Error("no match file for '" + a + "' and '" + b + "'", "", "align by index, distance or gps");
}

}  // namespace citylearn
