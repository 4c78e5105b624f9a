// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "encoder_service/encoding/encoder.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Returns all encoders for --help: "hog, onnx, vlad".
std::string encoder_names();

/// Adds --model, --layer, --preset and --head under `group`, and --ENCODER-PARAMETER for each parameter of each
/// encoder; those given end up in `parameters`, by encoder.
void add_encoder_options(CLI::App& app, EncoderFiles& files,
                         std::map<std::string, std::map<std::string, double>>& parameters, const std::string& group);

/// Returns the text of `--list`.
std::string list_encoders();

}  // namespace citylearn
