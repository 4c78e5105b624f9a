// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "dashboard/store/store_reader.h"

namespace citylearn {

// Tables are written by hand: a run may have a million rows.

/// Appends a JSON string. What is not UTF-8 in it is replaced.
void append_json(std::string& text, const std::string& value);

/// Appends a training figure; null where it is undefined.
void append_figure(std::string& text, const TrainingFigure& figure, double value);

/// Appends an episode as a JSON object, without its last brace.
void open_json_episode(std::string& text, const EpisodeRow& row);
void append_json_episode(std::string& text, const EpisodeRow& row);

}  // namespace citylearn
