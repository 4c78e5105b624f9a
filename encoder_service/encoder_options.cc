// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoder_options.h"

#include <CLI/CLI.hpp>

#include "core/util/name.h"
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

void add_reduction_options(CLI::App& app, ReductionChoice& choice, const std::string& group) {
  const OptionGroup options(app, group);
  app.add_option("--reference", choice.reference, "Traversal that the encoder and the reduction learn from")
      ->capture_default_str()
      ->transform(name_from);
  app.add_option("--dimension", choice.reduction.dimension,
                 "Features a frame, by PCA; 0 keeps all that the encoder gives; the default is lower for a short "
                 "reference")
      ->capture_default_str()
      ->check(CLI::Range(0, 4096))
      ->each([&choice](const std::string&) { choice.cap_dimension = false; });
  app.add_option("--whitening", choice.reduction.whitening, "Exponent of the whitening: 0 none, 0.5 full")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 0.5));
  app.add_option("--centring", choice.centring,
                 "Mean that is subtracted first: of the reference, of the traversal's own frames, of its frames so far "
                 "(running), "
                 "or none")
      ->capture_default_str()
      ->check(CLI::IsMember({"reference", "own", "running", "none"}));
}

std::string list_encoders() {
  std::string text = "encoders (--encoder):\n";
  for (const auto* entry : EncoderRegistry::instance().entries())
    text += describe(entry->name, entry->help, entry->parameters, entry->name);
  return text;
}

}  // namespace citylearn
