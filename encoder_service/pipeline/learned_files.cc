// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/learned_files.h"

#include <spdlog/fmt/fmt.h>

#include <cstdlib>
#include <sstream>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

constexpr const char* kSeparator = " | ";
constexpr const char* kLearnedOn = " of ";
constexpr std::size_t kHashDigits = 16;
constexpr std::size_t kMaxRecipeLength = 256;  // of TraversalInfo.encoder

}  // namespace

std::uint64_t mix_text(const std::string& text) {
  std::uint64_t hash = 0;
  for (const char c : text) hash = mix_seeds({hash, static_cast<unsigned char>(c)});
  return hash;
}

std::string default_store() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value ? value : "");
  };
  if (const std::string cache = variable("XDG_CACHE_HOME"); !cache.empty()) return cache + "/citylearn";
  if (const std::string home = variable("HOME"); !home.empty()) return home + "/.cache/citylearn";
  return "none";
}

std::string learned_path(const std::string& store, const std::string& recipe, const std::string& suffix) {
  return fmt::format("{}/{:016x}.{}", store, mix_text(recipe), suffix);
}

std::string reduction_path(const std::string& store, const std::string& encoder, std::uint64_t traversal,
                           const ReductionOptions& options) {
  return learned_path(store,
                      fmt::format("{} {:016x} {} {} {:g}", encoder, traversal, options.dimension,
                                  static_cast<int>(options.centring), options.whitening),
                      "reduction");
}

std::string FeatureRecipe::text() const {
  const std::string source = learned_on == 0 ? "" : fmt::format("{}{:016x}", kLearnedOn, learned_on);
  return (encoder + kSeparator + reduction).substr(0, kMaxRecipeLength - source.size()) + source;
}

std::string FeatureRecipe::encoder_option() const {
  const std::string versioned = encoder.substr(0, encoder.find(' '));
  return versioned.substr(0, versioned.rfind('-'));
}

bool FeatureRecipe::agrees(const FeatureRecipe& other) const {
  return encoder == other.encoder && reduction == other.reduction &&
         (learned_on == 0 || other.learned_on == 0 || learned_on == other.learned_on);
}

std::optional<FeatureRecipe> FeatureRecipe::parse(const std::string& text) {
  const std::size_t at = text.rfind(kSeparator);
  if (at == text.npos) return std::nullopt;
  FeatureRecipe recipe{text.substr(0, at), text.substr(at + std::string(kSeparator).size())};
  const std::size_t of = recipe.reduction.rfind(kLearnedOn), hash = of + std::string(kLearnedOn).size();
  if (of == recipe.reduction.npos || recipe.reduction.size() != hash + kHashDigits ||
      recipe.reduction.find_first_not_of("0123456789abcdef", hash) != recipe.reduction.npos)
    return recipe;
  recipe.learned_on = std::strtoull(recipe.reduction.c_str() + hash, nullptr, 16);
  recipe.reduction.resize(of);
  return recipe;
}

std::string recipe_of(const ReductionOptions& options) {
  return fmt::format("{} {} {:g}", options.dimension, name_of(options.centring), options.whitening);
}

std::optional<ReductionOptions> options_of(const std::string& reduction) {
  ReductionOptions options;
  std::istringstream in(reduction);
  std::string centring, more;
  if (!(in >> options.dimension >> centring >> options.whitening) || in >> more) return std::nullopt;
  try {
    options.centring = centring_of(centring);
  } catch (const Error&) {
    return std::nullopt;
  }
  return options;
}

}  // namespace citylearn
