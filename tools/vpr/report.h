// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/lab/recognition/evaluation.h"
#include "tools/vpr/evaluate.h"

namespace citylearn::vpr {

/// One line of the table: an encoder's features of one dimension, matched by one method, under one condition.
struct Row {
  /// What results.json has of it, in that order. "radius" is in metres; 0: frames within "tolerance" are right.
  /// "encode_seconds" is for both traversals, of frames that were not in the store; "seconds" is reduction and
  /// matching.
  nlohmann::ordered_json facts;
  PrecisionRecall curve;
  std::string matches;  ///< file of the picture that shows some; empty: none
};

/// Returns a table for people with aligned columns.
std::string table(const std::vector<Row>& rows);
/// Returns one line a row, with a header; fields that need it are quoted (RFC 4180).
std::string results_csv(const std::vector<Row>& rows);
/// Returns JSON with facts about all rows, the meaning of the figures, and the rows.
std::string results_json(const Options& options, const std::vector<Row>& rows);

/// Returns precision over recall, at most 2,000 points a row: {"curves": [{encoder .. query, auc, recall, precision,
/// file}]}, with the name of the picture that shows the curve.
std::string curves_json(const std::vector<Row>& rows);

/// Returns the row as part of a file's name: "hog-64-own-winter-nearest".
std::string slug_of(const Row& row);

/// `text` as part of a file's name: everything but letters, digits, '.', '_' becomes '-'.
std::string slug(const std::string& text);

}  // namespace citylearn::vpr
