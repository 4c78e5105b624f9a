// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoder_options.h"

#include <CLI/CLI.hpp>

#include "core/util/text.h"
#include "core/wire/service.h"

namespace citylearn {

std::string encoder_names() { return joined(EncoderRegistry::instance().entries(), &EncoderRegistry::Entry::name); }

void add_encoder_options(CLI::App& app, EncoderFiles& files,
                         std::map<std::string, std::map<std::string, double>>& parameters, const std::string& group) {
  const OptionGroup options(app, group);
  app.add_option("--model", files.model, "Network of the encoder, an ONNX file")->type_name("FILE");
  app.add_option("--layer", files.layer, "Name of its output layer; the last one by default");
  app.add_option("--preset", files.preset, "Input size, mean, deviation and layer of a known network");
  app.add_option("--head", files.head, "Weights of the NetVLAD layer that follows the network (encoder netvlad)")
      ->type_name("FILE");
  for (const auto* entry : EncoderRegistry::instance().entries())
    add_parameters(app, entry->name, entry->parameters, parameters[entry->name]);
}

std::string list_encoders() {
  std::string text = "encoders (--encoder):\n";
  for (const auto* entry : EncoderRegistry::instance().entries())
    text += describe(entry->name, entry->help, entry->parameters, entry->name);
  return text;
}

}  // namespace citylearn
