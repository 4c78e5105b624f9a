// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/dataset.h"

namespace citylearn {

Error unknown_traversal(const std::string& name, const std::string& where, const std::vector<std::string>& known) {
  std::string list;
  for (const std::string& one : known) list += (list.empty() ? "" : ", ") + one;
  return Error("no traversal '" + name + "'", where, list.empty() ? "there is none at all" : "there are: " + list);
}

std::vector<std::pair<int, int>> Dataset::matches(const std::string& a, const std::string& b) {
  throw Error("no match file for '" + a + "' and '" + b + "'", "", "align by index, distance or gps");
}

}  // namespace citylearn
