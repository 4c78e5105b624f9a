// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Returns all that --encoder takes for --help: "hog, onnx, vlad, or FILE.py".
std::string encoder_names();

/// What --encoder names.
struct ChosenEncoder {
  const EncoderRegistry::Entry& entry;
  EncoderFiles files;
};
/// Returns the encoder of this name. FILE.py stands for the encoder `python` with that file instead of --model. Throws
/// Error when it is unknown.
ChosenEncoder choose_encoder(const std::string& name, EncoderFiles files);

/// Adds --model, --layer and --preset under `group`, and --ENCODER-PARAMETER for each parameter of each encoder; those
/// given end up in `parameters`, by encoder.
void add_encoder_options(CLI::App& app, EncoderFiles& files,
                         std::map<std::string, std::map<std::string, double>>& parameters, const std::string& group);

/// The reduction of an encoder's descriptors, as given on the command line.
struct ReductionChoice {
  std::string reference = "summer";  ///< traversal that the encoder and the reduction learn from
  ReductionOptions reduction;        ///< but for its centring
  std::string centring = "running";
  bool dimension_given = false, centring_given = false;
};
/// Adds --reference, --dimension, --whitening and --centring under `group`.
void add_reduction_options(CLI::App& app, ReductionChoice& choice, const std::string& group);
/// Returns the chosen reduction, with what the encoder recommends in place of defaults. Warns in the log of what was
/// given otherwise. Throws Error when the encoder is unknown.
ReductionOptions reduction_for(const std::string& encoder, const ReductionChoice& choice);
/// Takes the reduction that the encoder recommends, but for what was given. Returns a warning of what was given
/// otherwise; empty where nothing was. Throws Error when the encoder is unknown.
std::string take_recommended(const std::string& encoder, ReductionOptions& reduction, bool dimension_given,
                             bool centring_given);

/// Returns the text of `--list`.
std::string list_encoders();

}  // namespace citylearn
