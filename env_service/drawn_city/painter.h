// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "core/util/random.h"
#include "env_service/drawn_city/look.h"

namespace citylearn::drawn {

/// A picture for an upright surface, with ever smaller copies. BGR and coverage.
struct Texture {
  explicit Texture(cv::Mat picture, bool glows = false);
  std::vector<cv::Mat> levels;
  bool glows;  ///< coverage of kGlow means: opaque, and shines by itself
};
inline constexpr int kGlow = 180;
using Skin = std::shared_ptr<const Texture>;

/// Paints the textures of one look.
class Painter {
 public:
  Painter(const Look& look, std::uint64_t seed);
  /// `shape` draws what stays from one recording to the next, `mood` what does not.
  Skin building(float width, float height, Random shape, Random mood) const;
  Skin house(float width, float height, Random shape, Random mood) const;
  Skin gable(bool pitched, Random shape) const;
  Skin sign(Random shape) const;
  enum class View { kSide, kBack, kFront };
  Skin car(View view, Random mood) const;
  const Skin& tree(Random& shape) const { return trees_[shape.below(trees_.size())]; }
  const Skin& conifer(Random& shape) const { return conifers_[shape.below(conifers_.size())]; }
  const Skin& bush(Random& shape) const { return bushes_[shape.below(bushes_.size())]; }
  const Skin& fence() const { return fence_; }
  const Skin& hedge() const { return hedge_; }
  const Skin& lamp() const { return lamp_; }
  const Skin& pole() const { return pole_; }
  const Skin& tower() const { return tower_; }

 private:
  Colour leaf(Random& random) const;
  Skin draw_tree(Random random) const;
  Skin draw_conifer(Random random) const;
  Skin draw_bush(Random random) const;
  void draw_street_furniture();

  const Look& look_;
  std::vector<Skin> trees_, conifers_, bushes_;
  Skin fence_, hedge_, lamp_, pole_, tower_;
};

}  // namespace citylearn::drawn
