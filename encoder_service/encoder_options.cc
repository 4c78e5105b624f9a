// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoder_options.h"

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>

#include "core/util/name.h"
#include "core/util/text.h"
#include "core/wire/service.h"

namespace citylearn {

std::string encoder_names() {
  return joined(EncoderRegistry::instance().entries(), &EncoderRegistry::Entry::name) + ", or FILE.py";
}

ChosenEncoder choose_encoder(const std::string& name, EncoderFiles files) {
  const bool file = name.ends_with(".py");
  if (file) files.model = name;
  return {EncoderRegistry::instance().find("encoder", file ? "python" : name), std::move(files)};
}

void add_encoder_options(CLI::App& app, EncoderFiles& files,
                         std::map<std::string, std::map<std::string, double>>& parameters, const std::string& group) {
  const OptionGroup options(app, group);
  app.add_option("--model", files.model, "Network of the encoder, an ONNX file")->type_name("FILE");
  app.add_option("--layer", files.layer, "Name of its output layer; the last one by default");
  app.add_option("--preset", files.preset, "Input size, mean, deviation and layer of a known network");
  for (const auto* entry : EncoderRegistry::instance().entries())
    add_parameters(app, entry->name, entry->parameters, parameters[entry->name]);
}

void add_reduction_options(CLI::App& app, ReductionChoice& choice, const std::string& group) {
  const OptionGroup options(app, group);
  app.add_option("--reference", choice.reference, "Traversal that the encoder and the reduction learn from")
      ->capture_default_str()
      ->transform(name_from);
  app.add_option("--dimension", choice.reduction.dimension,
                 "Features a frame, by PCA; 0 keeps all that the encoder gives; the default is lower "
                 "for a short reference, and 0 where the encoder recommends it (--list)")
      ->capture_default_str()
      ->check(CLI::Range(0, 4096))
      ->each([&choice](const std::string&) { choice.dimension_given = true; });
  app.add_option("--whitening", choice.reduction.whitening, "Exponent of the whitening: 0 none, 0.5 full")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 0.5));
  app.add_option("--centring", choice.centring,
                 "Mean that is subtracted first: of the reference, of the traversal's own frames, of its frames so far "
                 "(running), or none; the default is none where the encoder recommends it (--list)")
      ->capture_default_str()
      ->each([&choice](const std::string&) { choice.centring_given = true; })
      ->check(CLI::IsMember({"reference", "own", "running", "none"}));
}

namespace {

/// Returns "--dimension 0 --centring none": what an encoder recommends; empty where it recommends nothing.
std::string recommendation(const EncoderRegistry::Entry& entry) {
  std::string text;
  for (const auto& [name, value] : entry.recommended)
    text += (text.empty() ? "--" : " --") + name + " " +
            (name == "centring" ? name_of(static_cast<Centring>(static_cast<int>(value)))
                                : std::to_string(static_cast<int>(value)));
  return text;
}

}  // namespace

std::string take_recommended(const std::string& encoder, ReductionOptions& reduction, bool dimension_given,
                             bool centring_given) {
  const EncoderRegistry::Entry& entry = EncoderRegistry::instance().find("encoder", encoder);
  ReductionOptions taken = reduction;
  if (const auto found = entry.recommended.find("dimension"); found != entry.recommended.end())
    taken.dimension = static_cast<int>(found->second);
  if (const auto found = entry.recommended.find("centring"); found != entry.recommended.end())
    taken.centring = static_cast<Centring>(static_cast<int>(found->second));
  const bool other = (dimension_given && reduction.dimension != taken.dimension) ||
                     (centring_given && reduction.centring != taken.centring);
  if (!dimension_given) reduction.dimension = taken.dimension;
  if (!centring_given) reduction.centring = taken.centring;
  if (other)
    return "encoder " + encoder + " recommends " + recommendation(entry) + ", not --dimension " +
           std::to_string(reduction.dimension) + " --centring " + name_of(reduction.centring) +
           ": a network that learns to see may learn nothing from such features; leave these options out";
  if (!entry.recommended.empty() && !(dimension_given && centring_given))
    spdlog::info("reduction: {}, as encoder {} recommends", recommendation(entry), encoder);
  return "";
}

ReductionOptions reduction_for(const std::string& encoder, const ReductionChoice& choice) {
  ReductionOptions reduction = choice.reduction;
  reduction.centring = centring_of(choice.centring);
  const std::string warning = take_recommended(encoder, reduction, choice.dimension_given, choice.centring_given);
  if (!warning.empty()) spdlog::warn("{}", warning);
  return reduction;
}

std::string list_encoders() {
  std::string text = "encoders (--encoder):\n";
  for (const auto* entry : EncoderRegistry::instance().entries())
    text += describe(entry->name, entry->help, entry->parameters, entry->name) +
            (entry->recommended.empty() ? "" : "      recommends " + recommendation(*entry) + "\n");
  return text;
}

}  // namespace citylearn
