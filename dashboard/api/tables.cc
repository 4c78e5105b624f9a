// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/tables.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "dashboard/api/parameters.h"

namespace citylearn {
namespace {

/// Appends a float, or null where there is none.
void append_float(std::string& text, double value) {
  if (std::isfinite(value))
    append_number(text, static_cast<float>(value));
  else
    text += "null";
}

/// Appends fields with their names.
struct Fields {
  std::string& text;
  bool first = true;
  template <class Value>
  void operator()(const char* name, const char*, const Value& value) {
    text += std::string(first ? "{\"" : ",\"") + name + "\":";
    first = false;
    if constexpr (std::is_same_v<Value, std::string>)
      append_json(text, value);
    else if constexpr (std::is_same_v<Value, bool>)
      text += value ? "true" : "false";
    else if constexpr (std::is_same_v<Value, float>)
      append_float(text, value);
    else
      append_number(text, value);
  }
};

}  // namespace

void append_json(std::string& text, const std::string& value) { text += text_of(value); }

void append_figure(std::string& text, const TrainingFigure& figure, double value) {
  if (std::isfinite(value) && figure.type == TrainingFigure::kCount)
    append_number(text, static_cast<std::int64_t>(value));
  else if (std::isfinite(value) && figure.type == TrainingFigure::kDouble)
    append_number(text, value);
  else
    append_float(text, value);
}

void open_json_episode(std::string& text, const EpisodeRow& row) { visit_episode(row, Fields{text}); }

void append_json_episode(std::string& text, const EpisodeRow& row) {
  open_json_episode(text, row);
  text += '}';
}

}  // namespace citylearn
