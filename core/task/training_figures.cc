// SPDX-License-Identifier: Apache-2.0
#include "core/task/training_figures.h"

#include <algorithm>
#include <type_traits>

#include "idl/training.h"

namespace citylearn {
namespace {

template <class Number>
constexpr TrainingFigure::Type number_type(Number) {
  return std::is_integral_v<Number>      ? TrainingFigure::kCount
         : std::is_same_v<Number, float> ? TrainingFigure::kFloat
                                         : TrainingFigure::kDouble;
}

const TrainingFigure kFigures[] = {
#define FIGURE(name, unit, title, help, tag, format) \
  {#name,                                            \
   unit,                                             \
   title,                                            \
   help,                                             \
   tag,                                              \
   "{:" format "}",                                  \
   number_type(msg::TrainingStat().name()),          \
   [](const msg::TrainingStat& stat) { return static_cast<double>(stat.name()); }},
#define LEARNED FIGURE
#include "core/task/training_figures.inc"
};

}  // namespace

std::span<const TrainingFigure> training_figures() { return kFigures; }

const TrainingFigure* find_training_figure(std::string_view name) {
  const auto found = std::find_if(std::begin(kFigures), std::end(kFigures),
                                  [&](const TrainingFigure& figure) { return figure.name == name; });
  return found == std::end(kFigures) ? nullptr : found;
}

}  // namespace citylearn
