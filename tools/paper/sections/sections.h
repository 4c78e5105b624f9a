// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// A part of the report. report/report.py names the function that makes its figures, tables and text.
struct Section {
  std::string name;   ///< for --only: "figure-7"
  std::string title;  ///< "Fig. 7: training curves"
  /// Adds the units of work that it needs and returns what that function has to know about them. A unit is referred to
  /// by its number, which is its place in results.json.
  Json (*plan)(const Context& context);
  /// Adds to that what is known only after the work. Throws Error.
  void (*complete)(const Context& context, Json& data) = nullptr;
};

/// Returns all sections, in the order of the report.
const std::vector<Section>& sections();

/// Traversals of the sections that try policies in many ways: the one learned from and two others.
inline constexpr std::size_t kFewTraversals = 3;

Json plan_figure_2(const Context& context);
Json plan_figure_6(const Context& context);
Json plan_figure_7(const Context& context);
Json plan_figure_8_9(const Context& context);
Json plan_figure_10(const Context& context);
void complete_figure_10(const Context& context, Json& data);
Json plan_tables(const Context& context);
/// The paper's main finding, tried: agents that learn from more and fewer features of the same encoder.
Json plan_dimensions(const Context& context);
Json plan_longer_routes(const Context& context);
Json plan_transfer(const Context& context);
Json plan_viewpoint(const Context& context);
/// Agents that learned from one traversal beside agents that learned from two, on those that neither knows.
Json plan_experiences(const Context& context);
/// Actions slip, frames are dropped and agents are carried elsewhere, in training and in trials.
Json plan_imperfect_world(const Context& context);
/// On recordings that cross themselves, else on the drawn city, laid on a drawn map.
Json plan_map(const Context& context);

}  // namespace citylearn::paper
