// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "encoder_service/encoding/encoder.h"

namespace CLI {
class App;
}

namespace citylearn {

/// "hog, onnx, vlad": all encoders, for --help.
std::string encoder_names();

/// --model, --layer, --preset, --head under `group`, and one --ENCODER-PARAMETER each; those given end up in
/// `parameters`, by encoder.
void add_encoder_options(CLI::App& app, EncoderFiles& files,
                         std::map<std::string, std::map<std::string, double>>& parameters, const std::string& group);

/// Text of `--list`.
std::string list_encoders();

}  // namespace citylearn
