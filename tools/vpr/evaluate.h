// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "env_service/dataset_io/selection.h"
#include "tools/lab/recognition/methods.h"

namespace citylearn::vpr {

struct Options {
  std::string command;  ///< as typed, for the record
  // Recordings.
  Source source;  ///< its traversal is the reference
  std::vector<std::string> queries;
  // Encoding.
  std::vector<std::string> encoders;  ///< empty: the default one, where there are pictures
  std::map<std::string, std::map<std::string, double>> parameters;  ///< those given, by encoder
  EncoderFiles files;
  std::string store;
  // Features.
  std::vector<int> dimensions = {0};
  std::vector<std::string> centrings = {"running"};
  double whitening = 0.2;
  // Matching and evaluation.
  std::vector<std::string> methods = {"nearest"};
  lab::MatchingOptions matching;
  int tolerance = 2;
  double radius = 0;  ///< metres within which a frame is a right answer; 0: frames within `tolerance` are
  bool pictures = true;
  std::string output;
};

/// Every encoder x centring x dimension x query x method, a row each. results.csv and results.json in `output` are
/// whole after each row; Ctrl-C ends after the rows that are complete. Returns the exit status. Throws Error.
int evaluate(const Options& options);

}  // namespace citylearn::vpr
