// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <list>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <unordered_map>
#include <vector>

#include "core/util/random.h"
#include "env_service/drawn_city/world.h"

// Inside of drawn_world.h. Lengths are metres; lateral ones grow to the right of the route. Colours are BGR, 0..255.

namespace citylearn::drawn {

using Colour = cv::Vec3f;

/// What a recording makes of the world.
struct Look {
  std::string name;
  int leaves = 0;               ///< 0 green, 1 of autumn, 2 none
  float snow = 0;               ///< 0..1, on ground and roofs
  float wet = 0;                ///< 0..1, how the ground mirrors
  bool night = false;           ///< lamps, lit windows, headlights
  float sun_azimuth = 0;        ///< radians; 0 is the direction in which the route begins, positive to the right
  float sun_elevation = 0.7f;   ///< radians
  float sun = 0.6f;             ///< share of direct light
  Colour light{255, 255, 255};  ///< colour of what lights a white surface
  Colour zenith{230, 150, 80}, horizon{245, 225, 200}, cloud{250, 250, 250};
  float clouds = 0.4f;           ///< share of the sky
  float sight = 260;             ///< metres at which things are mostly haze
  float noise = 3;               ///< standard deviation of a pixel, of 255
  Colour gain{1, 1, 1};          ///< white balance and exposure
  float rain = 0, snowfall = 0;  ///< streaks and flakes, 0..1
  float sway = 1;                ///< how unsteadily it is driven
  float lateral = 0, yaw = 0;    ///< of the camera: metres, radians
};
const std::vector<Look>& looks();

/// A picture to be put onto an upright surface, with ever smaller copies. BGR and coverage.
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

/// An upright surface of the world.
struct Thing {
  enum Face {
    kAlong,   ///< beside the route from s to s_end
    kAcross,  ///< across it at s, from lateral to lateral_end
    kUpright  ///< turned to the camera, around (s, lateral), lateral_end wide
  };
  Face face = kUpright;
  float s = 0, s_end = 0, lateral = 0, lateral_end = 0, bottom = 0, top = 0;
  float tint = 1;
  Skin skin;
};

enum class Zone { kCentre, kSuburb, kPark, kCountry };
inline constexpr float kCell = 12;  ///< metres of a cell

/// Some metres of the route with all that stands beside them.
struct Cell {
  Zone zone = Zone::kCentre;
  std::vector<Thing> things;             ///< the farthest first
  std::array<float, 2> front{}, roof{};  ///< left and right: distance and height of what throws shadows
  std::array<Colour, 2> field;           ///< what grows beyond the verge
  bool crossing = false;                 ///< zebra
  std::vector<cv::Vec4b> ground;         ///< by lateral, kGroundSteps a metre; the last channel is how it mirrors
};
inline constexpr int kGroundSteps = 8, kGroundReach = 40;  // metres to either side

class World {
 public:
  World(const DrawnOptions& options, const Look& look, std::uint64_t look_index);
  /// Direction of the route, radians.
  float heading(float s) const;
  Zone zone(long cell) const;
  /// Valid until the next call.
  const Cell& cell(long index);
  const Painter& painter() const { return painter_; }

 private:
  Cell make(long index) const;
  void lay_ground(Cell& cell) const;
  void centre(Cell& cell, long index, int side) const;
  void suburb(Cell& cell, long index, int side) const;
  void green(Cell& cell, long index, int side) const;
  void roadside(Cell& cell, long index, int side) const;
  Random shape(long cell, int side, int purpose) const;
  Random mood(long cell, int side, int purpose) const;

  DrawnOptions options_;
  const Look& look_;
  std::uint64_t look_index_;
  Painter painter_;
  std::list<std::pair<long, Cell>> recent_;  // the newest first
  std::unordered_map<long, std::list<std::pair<long, Cell>>::iterator> cells_;
};

/// Smooth noise, -1..1, that changes over a distance of 1.
float noise(std::uint64_t stream, float x);
float noise(std::uint64_t stream, float x, float y);

/// Draws what a camera on the route sees. The buffer is twice as wide and high as the picture.
class Camera {
 public:
  Camera(const DrawnOptions& options, const Look& look, std::uint64_t look_index);
  /// Valid until the next call.
  const cv::Mat& draw(float s);

 private:
  struct Point {
    float x = 0, z = 0;
  };
  struct Place : Point {  // of the route
    float turn = 0;       // relative to the camera
  };
  /// The light that falls onto something, of 256 a channel; `direct` is how much of the sun, 0..1.
  cv::Vec3i light(float direct, Point at) const;
  void survey(float s);
  Place at(float s) const;
  Point beside(float s, float lateral) const;
  void paint_sky();
  void draw_sky(float s);
  void draw_ground(float s);
  void draw_things(float s);
  void draw_shadow(const Thing& thing);
  void draw_traffic(float s, long cell);
  void draw_thing(const Thing& thing);
  void draw_wall(const Thing& thing, Point a, Point b, float direct);
  void mirror();
  void fall(Random& random);
  void develop(Random& random);

  const DrawnOptions options_;
  const Look& look_;
  const std::uint64_t look_index_;
  World world_;
  int width_, height_, level_, horizon_;  // of the buffer; the horizon of a level camera, and now
  float focal_, centre_;
  float begin_ = 0, heading_ = 0;
  std::vector<Place> route_;
  std::vector<int> haze_, fade_;  // by metres, of 256
  std::vector<int> grain_;
  std::array<Skin, 6> traffic_;  // from behind three times, from the front three times
  cv::Mat sky_, buffer_, picture_;
};

}  // namespace citylearn::drawn
