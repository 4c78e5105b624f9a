// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// A part of the report. Its figures, tables and text are made by the module of the same name in report/sections/.
struct Section {
  std::string name;   ///< for --only: "figure-7"
  std::string title;  ///< "Fig. 7: training curves"
  /// Adds the units of work that it needs and returns what its module has to know about them. A unit is referred to by
  /// its number, which is its place in results.json.
  Json (*plan)(const Context& context);
  /// Adds to that what is known only after the work. Throws Error.
  void (*complete)(const Context& context, Json& data) = nullptr;
};

/// All of them, in the order of the report.
const std::vector<Section>& sections();

}  // namespace citylearn::paper
