// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "dashboard/store/store_reader.h"

namespace citylearn {

// Tables are written by hand, as JSON or CSV: a run may have a million rows.

/// Appends a JSON string. What is not UTF-8 in it is replaced.
void append_json(std::string& text, const std::string& value);

/// Appends a text as a field of CSV. What a spreadsheet would take for a formula begins with an apostrophe.
void append_csv(std::string& text, std::string value);

/// Appends a training figure. One that is undefined is null in JSON and empty in CSV.
void append_figure(std::string& text, const TrainingFigure& figure, double value, bool csv);

/// Appends an episode as a JSON object, without its last brace.
void open_json_episode(std::string& text, const EpisodeRow& row);
void append_json_episode(std::string& text, const EpisodeRow& row);

/// Appends a line without its end.
void append_csv_episode(std::string& text, const EpisodeRow& row);
void append_csv_episode_header(std::string& text);

}  // namespace citylearn
