// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/tables.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <type_traits>

#include "core/files/csv.h"
#include "dashboard/api/parameters.h"

namespace citylearn {
namespace {

/// Appends a float; nothing (CSV) or null (JSON) where there is none.
void append_float(std::string& text, double value, bool csv) {
  if (std::isfinite(value)) {
    append_number(text, static_cast<float>(value));
  } else if (!csv) {
    text += "null";
  }
}

/// Appends fields, of JSON with their names.
struct Fields {
  std::string& text;
  bool csv;
  bool first = true;
  template <class Value>
  void operator()(const char* name, const char*, const Value& value) {
    if (!csv)
      text += std::string(first ? "{\"" : ",\"") + name + "\":";
    else if (!first)
      text += ',';
    first = false;
    if constexpr (std::is_same_v<Value, std::string>)
      csv ? append_csv(text, value) : append_json(text, value);
    else if constexpr (std::is_same_v<Value, bool>)
      text += csv ? (value ? "1" : "0") : (value ? "true" : "false");
    else if constexpr (std::is_same_v<Value, float>)
      append_float(text, value, csv);
    else
      append_number(text, value);
  }
};

}  // namespace

// Spreadsheets take what begins like a formula as one, and run it; an apostrophe makes it text.
void append_csv(std::string& text, std::string value) {
  if (!value.empty() && std::string_view("=+-@\t\r").find(value.front()) != std::string_view::npos)
    value.insert(0, "'");
  text += csv_field(value);
}

void append_json(std::string& text, const std::string& value) { text += text_of(value); }

void append_figure(std::string& text, const TrainingFigure& figure, double value, bool csv) {
  if (std::isfinite(value) && figure.type == TrainingFigure::kCount)
    append_number(text, static_cast<std::int64_t>(value));
  else if (std::isfinite(value) && figure.type == TrainingFigure::kDouble)
    append_number(text, value);
  else
    append_float(text, value, csv);
}

void open_json_episode(std::string& text, const EpisodeRow& row) { visit_episode(row, Fields{text, false}); }

void append_json_episode(std::string& text, const EpisodeRow& row) {
  open_json_episode(text, row);
  text += '}';
}

void append_csv_episode(std::string& text, const EpisodeRow& row) { visit_episode(row, Fields{text, true}); }

void append_csv_episode_header(std::string& text) {
  const auto name_only = [&text, first = true](const char* name, const char*, const auto&) mutable {
    text += (first ? "" : ",") + std::string(name);
    first = false;
  };
  const EpisodeRow none;
  visit_episode(none, name_only);
}

}  // namespace citylearn
