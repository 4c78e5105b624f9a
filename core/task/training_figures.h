// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

namespace citylearn {

namespace msg {
class TrainingStat;
}

/// A figure of one training update: a field of TrainingStat, and how it is shown.
struct TrainingFigure {
  enum Type { kCount, kFloat, kDouble };

  const char* name;  ///< of the field, and of the column in metrics.csv, the store and the API
  const char* unit;  ///< "" where it has none
  const char* title;
  const char* help;
  const char* tag;     ///< in TensorBoard; "" where it is not shown there
  const char* format;  ///< of the number in metrics.csv, as std::format's
  Type type;
  double (*value)(const msg::TrainingStat&);
};

/// Returns all figures, in the order of training_figures.inc.
std::span<const TrainingFigure> training_figures();
/// Returns null where there is none of this name.
const TrainingFigure* find_training_figure(std::string_view name);

}  // namespace citylearn
