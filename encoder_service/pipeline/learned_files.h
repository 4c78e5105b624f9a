// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "encoder_service/encoding/reduction.h"

namespace citylearn {

/// Mixes the characters of a text into one number.
std::uint64_t mix_text(const std::string& text);

/// Returns the folder for files that can be made again (XDG Base Directory Specification), or "none".
std::string default_store();

/// Returns the file of `store` for what was learned by this recipe; `suffix`: "encoder", "reduction".
std::string learned_path(const std::string& store, const std::string& recipe, const std::string& suffix);

/// Returns the file of `store` with the reduction that was learned on the traversal with this hash.
std::string reduction_path(const std::string& store, const std::string& encoder, std::uint64_t traversal,
                           const ReductionOptions& options);

/// Describes how features are made of pictures: TraversalInfo.encoder.
struct FeatureRecipe {
  std::string encoder;    ///< Encoder::Spec::name
  std::string reduction;  ///< "64 running 0.2", dimension as wanted; or the name of a file
  /// Hash of the traversal that the reduction was learned on, or of that file's bytes; 0: of none, or not known.
  std::uint64_t learned_on = 0;

  std::string text() const;  ///< "ENCODER | REDUCTION of LEARNED_ON", at most 256 characters
  /// Returns the name that --encoder takes: "patchnorm" of "patchnorm-1 height=32".
  std::string encoder_option() const;
  /// Returns whether both make the same features of a picture, as far as is known.
  bool agrees(const FeatureRecipe& other) const;
  /// Returns nothing when `text` is something else.
  static std::optional<FeatureRecipe> parse(const std::string& text);
};
/// Returns FeatureRecipe::reduction for options; options_of() reads it, and returns nothing when it names a file.
std::string recipe_of(const ReductionOptions& options);
std::optional<ReductionOptions> options_of(const std::string& reduction);

}  // namespace citylearn
