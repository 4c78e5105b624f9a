// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/painter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace citylearn::drawn {
namespace {

constexpr float kDetail = 8;  // texels a metre of a facade

float in(Random& random, double low, double high) { return static_cast<float>(low + (high - low) * random.uniform()); }
int whole(double value) { return static_cast<int>(std::lround(value)); }
cv::Scalar opaque(const Colour& c, int coverage = 255) { return {c[0], c[1], c[2], static_cast<double>(coverage)}; }
Colour mix(const Colour& a, const Colour& b, float share) { return a + (b - a) * share; }
const Colour kSnow{250, 246, 242};
const Colour kLit{110, 190, 255};

/// Returns a transparent picture of this colour, so that edges blend into it.
cv::Mat canvas(int width, int height, const Colour& colour) {
  return cv::Mat(std::max(1, height), std::max(1, width), CV_8UC4, opaque(colour, 0));
}

void box(cv::Mat& picture, float x, float y, float width, float height, const cv::Scalar& colour) {
  const int left = whole(x), top = whole(y);
  const int right = std::max(left + 1, whole(x + width)), bottom = std::max(top + 1, whole(y + height));
  cv::rectangle(picture, cv::Point(left, top), cv::Point(right - 1, bottom - 1), colour, cv::FILLED);
}

void triangle(cv::Mat& picture, cv::Point a, cv::Point b, cv::Point c, const cv::Scalar& colour) {
  const std::array<cv::Point, 3> corners{a, b, c};
  cv::fillConvexPoly(picture, corners.data(), 3, colour);
}

Colour wall_colour(Random& shape) {
  static const std::array<Colour, 10> kWalls{{{70, 82, 150},
                                              {92, 112, 172},
                                              {176, 204, 222},
                                              {150, 160, 166},
                                              {112, 170, 208},
                                              {198, 212, 216},
                                              {86, 104, 128},
                                              {150, 186, 172},
                                              {190, 172, 152},
                                              {140, 160, 214}}};
  return kWalls[shape.below(kWalls.size())] * in(shape, 0.85, 1.1);
}

Colour bright(Random& random) {
  static const std::array<Colour, 7> kPaints{
      {{60, 60, 200}, {170, 90, 40}, {60, 150, 60}, {50, 180, 235}, {190, 190, 60}, {160, 60, 150}, {230, 230, 230}}};
  return kPaints[random.below(kPaints.size())];
}

/// A pane of glass: the sky in it by day, a lamp behind it on some evenings.
cv::Scalar pane(const Look& look, Random& mood, float lit) {
  const float gleam = in(mood, 0, 1);
  if (look.night) return gleam < lit ? opaque(kLit * in(mood, 0.55, 1), kGlow) : opaque({42, 36, 32});
  return opaque(mix({72, 62, 54}, look.horizon * 0.75f, gleam * gleam * 0.8f));
}

}  // namespace

Texture::Texture(cv::Mat picture, bool shines) : glows(shines) {
  levels.push_back(std::move(picture));
  while (levels.back().rows > 4 && levels.size() < 6) {
    const cv::Mat& last = levels.back();
    cv::Mat half;
    cv::resize(last, half, cv::Size(std::max(1, last.cols / 2), last.rows / 2), 0, 0, cv::INTER_AREA);
    levels.push_back(half);
  }
}

Painter::Painter(const Look& look, std::uint64_t seed) : look_(look) {
  for (std::uint64_t kind = 0; kind < 8; ++kind) trees_.push_back(draw_tree(Random{21, seed, 1, kind}));
  for (std::uint64_t kind = 0; kind < 4; ++kind) conifers_.push_back(draw_conifer(Random{21, seed, 2, kind}));
  for (std::uint64_t kind = 0; kind < 4; ++kind) bushes_.push_back(draw_bush(Random{21, seed, 3, kind}));
  draw_street_furniture();
}

Colour Painter::leaf(Random& random) const {
  if (look_.leaves == 1) {
    static const std::array<Colour, 4> kAutumn{{{30, 120, 215}, {40, 160, 225}, {36, 72, 178}, {50, 140, 150}}};
    return kAutumn[random.below(kAutumn.size())];
  }
  return Colour(48, 118, 72) + Colour(in(random, -10, 14), in(random, -16, 18), in(random, -16, 26));
}

Skin Painter::draw_tree(Random random) const {
  constexpr int kSize = 96;
  const Colour bark{52, 66, 84}, crown = leaf(random);
  cv::Mat picture = canvas(kSize, kSize, look_.leaves == 2 ? bark : crown);
  const float middle = kSize / 2.f, trunk = in(random, 5, 8), fork = kSize * in(random, 0.55, 0.68);
  box(picture, middle - trunk / 2, fork, trunk, kSize - fork, opaque(bark));
  const float width = in(random, 0.30, 0.42), height = in(random, 0.24, 0.32), centre = in(random, 0.34, 0.42);
  // Branches, of which leaves hide most.
  struct Branch {
    float x, y, angle, length;
    int order;
  };
  std::vector<Branch> branches{{middle, fork + 4, 0, kSize * 0.2f, 0}};
  for (std::size_t k = 0; k < branches.size(); ++k) {
    const Branch branch = branches[k];
    const float x = branch.x + branch.length * std::sin(branch.angle),
                y = branch.y - branch.length * std::cos(branch.angle);
    const int thick = std::max(1, 4 - branch.order);
    cv::line(picture, cv::Point2f(branch.x, branch.y), cv::Point2f(x, y),
             opaque(bark * (1 - 0.08f * static_cast<float>(branch.order))), thick);
    if (look_.snow > 0 && branch.order > 0 && branch.order < 4)
      cv::line(picture, cv::Point2f(branch.x, branch.y - 1), cv::Point2f(x, y - 1), opaque(kSnow), 1);
    if (branch.order == (look_.leaves == 2 ? 5 : 2)) continue;  // leaves hide the finer ones
    for (int child = 0; child < (branch.order < 2 ? 3 : 2); ++child)
      branches.push_back(
          {x, y, branch.angle + in(random, -0.75, 0.75), branch.length * in(random, 0.62, 0.85), branch.order + 1});
  }
  if (look_.leaves == 2) return std::make_shared<Texture>(picture);
  // Tufts from the back and dark ones below to the front and bright ones above.
  for (int tuft = 0; tuft < 90; ++tuft) {
    const float turn = in(random, 0, 6.283), away = std::sqrt(in(random, 0, 1));
    const float x = middle + kSize * width * away * std::cos(turn),
                y = kSize * (centre + height * away * std::sin(turn));
    const float above = 0.5f - (y / kSize - centre) / (2 * height), beside = (x - middle) / (kSize * 2 * width);
    const float light = 0.5f + 0.48f * above + 0.2f * beside * (look_.sun > 0.2f ? 1.f : 0.f);
    const float share = static_cast<float>(tuft) / 90;
    cv::circle(picture, cv::Point2f(x, y), whole(in(random, 3, 9.5) * (1.25f - 0.55f * share)),
               opaque(crown * (0.62f + share * 0.2f) * (0.55f + light * in(random, 0.6, 1))), cv::FILLED);
  }
  return std::make_shared<Texture>(picture);
}

Skin Painter::draw_conifer(Random random) const {
  constexpr int kWidth = 56, kHeight = 96;
  const Colour needles = Colour(52, 82, 46) * in(random, 0.8, 1.1);
  cv::Mat picture = canvas(kWidth, kHeight, needles);
  box(picture, kWidth / 2.f - 2, kHeight * 0.88f, 4, kHeight * 0.12f, opaque({44, 56, 72}));
  const int tiers = 6 + static_cast<int>(random.below(3));
  for (int tier = tiers; tier-- > 0;) {
    const float share = (static_cast<float>(tier) + 1) / static_cast<float>(tiers);
    const int top = whole(kHeight * 0.86f * (share - 1.f / static_cast<float>(tiers))),
              bottom = whole(kHeight * 0.1f + kHeight * 0.82f * share);
    const float half = kWidth * 0.48f * share * in(random, 0.85, 1.05);
    const cv::Point tip(kWidth / 2, top), left(whole(kWidth / 2.f - half), bottom),
        right(whole(kWidth / 2.f + half), bottom);
    const Colour shade = needles * (0.7f + 0.4f * (1 - share));
    triangle(picture, tip, left, right, opaque(shade));
    triangle(picture, tip, cv::Point(kWidth / 2, bottom), right, opaque(shade * 1.22f));
    if (look_.snow > 0)
      triangle(picture, tip, {left.x + whole(half * 0.2f), bottom - 4}, {kWidth / 2 + whole(half * 0.3f), bottom - 6},
               opaque(mix(shade, kSnow, 0.8f)));
  }
  return std::make_shared<Texture>(picture);
}

Skin Painter::draw_bush(Random random) const {
  constexpr int kWidth = 48, kHeight = 32;
  const Colour colour = look_.leaves == 2 ? Colour(70, 84, 96) : leaf(random) * 0.85f;
  cv::Mat picture = canvas(kWidth, kHeight, colour);
  for (int tuft = 0; tuft < 34; ++tuft) {
    const float x = in(random, 7, kWidth - 7), y = in(random, 9, kHeight - 4);
    Colour shade = colour * (0.6f + 0.6f * (1 - y / kHeight)) * in(random, 0.8, 1.15);
    if (look_.snow > 0 && y < 15) shade = mix(shade, kSnow, 0.8f);
    cv::circle(picture, cv::Point2f(x, y), whole(in(random, 2, 6)), opaque(shade), cv::FILLED);
  }
  box(picture, 4, kHeight - 6, kWidth - 8, 6, opaque(colour * 0.5f));
  return std::make_shared<Texture>(picture);
}

void Painter::draw_street_furniture() {
  cv::Mat fence = canvas(96, 12, {90, 110, 130});
  for (int post = 0; post < 96; post += 16) box(fence, static_cast<float>(post), 0, 2, 12, opaque({70, 92, 116}));
  for (int rail = 2; rail < 10; rail += 4) box(fence, 0, static_cast<float>(rail), 96, 1, opaque({96, 120, 146}));
  if (look_.snow > 0) box(fence, 0, 1, 96, 1, opaque(kSnow));
  fence_ = std::make_shared<Texture>(fence);

  Random random{22};
  const Colour green = look_.leaves == 2 ? Colour(62, 78, 84) : Colour(44, 92, 58);
  cv::Mat hedge(14, 96, CV_8UC4, opaque(green * 0.8f));
  for (int tuft = 0; tuft < 130; ++tuft) {
    const float y = in(random, 0, 14);
    cv::circle(hedge, cv::Point2f(in(random, 0, 96), y), 2,
               opaque(green * (0.65f + 0.6f * (1 - y / 14)) * in(random, 0.85, 1.15)), cv::FILLED);
  }
  if (look_.snow > 0) box(hedge, 0, 0, 96, 3, opaque(kSnow));
  hedge_ = std::make_shared<Texture>(hedge);

  const Colour steel{92, 90, 86};
  cv::Mat lamp = canvas(40, 96, steel);
  box(lamp, 33, 6, 3, 90, opaque(steel));
  box(lamp, 8, 6, 27, 2, opaque(steel));
  box(lamp, 6, 6, 12, 5, look_.night ? opaque({170, 230, 255}, kGlow) : opaque({200, 205, 205}));
  lamp_ = std::make_shared<Texture>(lamp, look_.night);

  cv::Mat pole = canvas(24, 96, {60, 80, 98});
  box(pole, 11, 0, 3, 96, opaque({60, 80, 98}));
  box(pole, 2, 8, 20, 2, opaque({52, 70, 88}));
  box(pole, 4, 16, 16, 2, opaque({52, 70, 88}));
  pole_ = std::make_shared<Texture>(pole);

  const Colour stone{150, 166, 176};
  cv::Mat tower = canvas(48, 192, stone);
  box(tower, 8, 70, 32, 122, opaque(stone));
  box(tower, 28, 70, 12, 122, opaque(stone * 0.85f));
  triangle(tower, {24, 2}, {4, 70}, {44, 70}, opaque(look_.snow > 0 ? kSnow : Colour(88, 92, 74)));
  for (const float y : {80.f, 120.f, 150.f})
    box(tower, 20, y, 8, 16, look_.night ? opaque(kLit, kGlow) : opaque({60, 60, 60}));
  cv::circle(tower, {24, 106}, 7, look_.night ? opaque({210, 240, 255}, kGlow) : opaque({230, 240, 240}), cv::FILLED);
  tower_ = std::make_shared<Texture>(tower, look_.night);
}

Skin Painter::building(float width, float height, Random shape, Random mood) const {
  const Colour wall = wall_colour(shape), trim = mix(wall, {235, 240, 240}, in(shape, 0.15, 0.7));
  const int columns = whole(width * kDetail), rows = whole(height * kDetail);
  cv::Mat picture(rows, columns, CV_8UC4, opaque(wall));
  const float floor = kDetail * in(shape, 2.9, 3.7), ground = kDetail * in(shape, 3.4, 4.4);
  const int windows = std::max(2, whole(width / in(shape, 1.7, 3.6)));
  const float pitch = static_cast<float>(columns) / static_cast<float>(windows), share = in(shape, 0.35, 0.72);
  const float tall = floor * in(shape, 0.42, 0.66), cornice = kDetail * in(shape, 0.4, 0.9);
  const bool bands = shape.uniform() < 0.5, sills = shape.uniform() < 0.6, balconies = shape.uniform() < 0.2;
  for (float base = static_cast<float>(rows) - ground; base - floor > cornice * 0.6f; base -= floor) {
    if (bands) box(picture, 0, base - 1, static_cast<float>(columns), 1.5f, opaque(trim));
    for (int k = 0; k < windows; ++k) {
      const float x = pitch * (static_cast<float>(k) + 0.5f - share / 2), y = base - floor * 0.2f - tall;
      box(picture, x - 1, y - 1, pitch * share + 2, tall + 2, opaque(trim));
      box(picture, x, y, pitch * share, tall, pane(look_, mood, 0.36f));
      if (pitch * share > 8) box(picture, x + pitch * share / 2, y, 1, tall, opaque(trim));
      if (sills) box(picture, x - 1, y + tall, pitch * share + 2, 1.5f, opaque(look_.snow > 0 ? kSnow : trim * 0.8f));
      if (balconies)
        box(picture, x - 2, y + tall * 0.6f, pitch * share + 4, 3, opaque(look_.snow > 0 ? kSnow : Colour(60, 60, 60)));
    }
  }
  // The ground floor: a shop under its sign, or a door among windows.
  const float top = static_cast<float>(rows) - ground;
  if (shape.uniform() < 0.55) {
    const Colour paint = bright(shape);
    box(picture, 0, top, static_cast<float>(columns), ground, opaque(wall * 0.6f));
    box(picture, 3, top + 2, static_cast<float>(columns) - 6, ground * 0.2f,
        look_.night ? opaque(paint * 0.8f, kGlow) : opaque(paint));
    const int parts = 2 + static_cast<int>(shape.below(4));
    const float part = (static_cast<float>(columns) - 6) / static_cast<float>(parts);
    for (int k = 0; k < parts; ++k)
      box(picture, 4 + part * static_cast<float>(k), top + ground * 0.32f, part - 3, ground * 0.58f,
          pane(look_, mood, 0.5f));
  } else {
    const int door = static_cast<int>(shape.below(static_cast<std::uint64_t>(windows)));
    const Colour paint = bright(shape) * 0.6f;
    box(picture, 0, top, static_cast<float>(columns), ground, opaque(mix(wall, {110, 116, 120}, 0.5f)));
    for (int k = 0; k < windows; ++k) {
      const float x = pitch * (static_cast<float>(k) + 0.5f - share / 2);
      if (k == door)
        box(picture, x, top + ground * 0.35f, kDetail * 1.1f, ground * 0.65f, opaque(paint));
      else
        box(picture, x, top + ground * 0.28f, pitch * share, ground * 0.42f, pane(look_, mood, 0.3f));
    }
  }
  box(picture, 0, 0, static_cast<float>(columns), cornice, opaque(trim * 0.9f));
  box(picture, 0, cornice, static_cast<float>(columns), 1, opaque(wall * 0.6f));
  if (look_.snow > 0) box(picture, 0, 0, static_cast<float>(columns), cornice * 0.7f, opaque(kSnow));
  return std::make_shared<Texture>(picture, look_.night);
}

Skin Painter::house(float width, float height, Random shape, Random mood) const {
  const Colour wall = wall_colour(shape), trim = mix(wall, {240, 244, 244}, 0.8f);
  static const std::array<Colour, 4> kRoofs{{{58, 70, 140}, {70, 72, 78}, {60, 84, 112}, {84, 96, 90}}};
  const Colour tiles = kRoofs[shape.below(kRoofs.size())] * in(shape, 0.85, 1.15);
  const Colour roof = mix(tiles, kSnow, look_.snow);
  const int columns = whole(width * kDetail), rows = whole(height * kDetail);
  const int eaves = whole(static_cast<float>(rows) * in(shape, 0.34, 0.46));
  cv::Mat picture = canvas(columns, rows, roof);
  box(picture, 3, static_cast<float>(eaves), static_cast<float>(columns) - 6, static_cast<float>(rows - eaves),
      opaque(wall));
  const bool gabled = shape.uniform() < 0.45;
  if (gabled) {
    triangle(picture, {columns / 2, 0}, {0, eaves + 3}, {columns - 1, eaves + 3}, opaque(roof));
    triangle(picture, {columns / 2, 8}, {8, eaves + 3}, {columns - 9, eaves + 3}, opaque(wall));
    box(picture, static_cast<float>(columns) / 2 - 4, static_cast<float>(eaves) * 0.6f, 8, 8, pane(look_, mood, 0.3f));
  } else {
    const std::array<cv::Point, 4> corners{
        {{whole(columns * 0.12), 5}, {whole(columns * 0.88), 5}, {columns - 1, eaves + 2}, {0, eaves + 2}}};
    cv::fillConvexPoly(picture, corners.data(), 4, opaque(roof));
    box(picture, static_cast<float>(columns) * in(shape, 0.2, 0.75), 0, 6, 12, opaque({80, 90, 130}));
  }
  box(picture, 0, static_cast<float>(eaves) + 2, static_cast<float>(columns), 1, opaque(tiles * 0.6f));
  const int windows = 2 + static_cast<int>(shape.below(4)), storeys = rows - eaves > 36 ? 2 : 1;
  const float pitch = static_cast<float>(columns - 10) / static_cast<float>(windows);
  const int door = static_cast<int>(shape.below(static_cast<std::uint64_t>(windows)));
  const float storey = static_cast<float>(rows - eaves) / static_cast<float>(storeys);
  for (int level = 0; level < storeys; ++level)
    for (int k = 0; k < windows; ++k) {
      const float x = 5 + pitch * (static_cast<float>(k) + 0.2f),
                  y = static_cast<float>(eaves) + storey * (static_cast<float>(level) + 0.25f);
      if (level == storeys - 1 && k == door) {
        box(picture, x, y, 8, storey * 0.75f, opaque(bright(shape) * 0.7f));
      } else {
        box(picture, x - 1, y - 1, pitch * 0.6f + 2, storey * 0.45f + 2, opaque(trim));
        box(picture, x, y, pitch * 0.6f, storey * 0.45f, pane(look_, mood, 0.4f));
      }
    }
  return std::make_shared<Texture>(picture, look_.night);
}

Skin Painter::gable(bool pitched, Random shape) const {
  const Colour wall = wall_colour(shape) * 0.92f;
  cv::Mat picture = canvas(32, 32, wall);
  box(picture, 0, pitched ? 14.f : 0.f, 32, 32, opaque(wall));
  if (pitched) triangle(picture, {16, 0}, {0, 14}, {31, 14}, opaque(wall));
  if (look_.snow > 0 && !pitched) box(picture, 0, 0, 32, 1, opaque(kSnow));
  box(picture, 10, 18, 4, 5, opaque({60, 56, 52}));
  return std::make_shared<Texture>(picture);
}

Skin Painter::sign(Random shape) const {
  cv::Mat picture = canvas(24, 64, {150, 150, 150});
  box(picture, 11, 20, 2, 44, opaque({130, 130, 130}));
  const Colour paint = bright(shape);
  const std::uint64_t kind = shape.below(3);
  if (kind == 0) {
    cv::circle(picture, {12, 12}, 10, opaque({50, 50, 210}), cv::FILLED);
    cv::circle(picture, {12, 12}, 7, opaque({235, 235, 235}), cv::FILLED);
  } else if (kind == 1) {
    triangle(picture, {12, 2}, {1, 21}, {23, 21}, opaque({50, 50, 210}));
    triangle(picture, {12, 7}, {6, 18}, {18, 18}, opaque({235, 235, 235}));
  } else {
    box(picture, 1, 2, 22, 18, opaque({235, 235, 235}));
    box(picture, 2, 3, 20, 16, opaque(paint));
  }
  return std::make_shared<Texture>(picture);
}

Skin Painter::car(View view, Random mood) const {
  const bool side = view == View::kSide;
  static const std::array<Colour, 7> kPaints{
      {{50, 50, 56}, {190, 190, 190}, {230, 230, 230}, {50, 45, 165}, {140, 80, 45}, {110, 110, 110}, {70, 100, 60}}};
  const Colour &paint = kPaints[mood.below(kPaints.size())], glass{70, 60, 52},
               roof = mix(paint, kSnow, look_.snow * 0.9f);
  const int width = side ? 80 : 36;
  cv::Mat picture = canvas(width, 28, paint);
  const cv::Scalar tyre = opaque({34, 34, 34});
  if (side) {
    const std::array<cv::Point, 4> cabin{{{22, 1}, {58, 1}, {68, 11}, {13, 11}}},
        panes{{{25, 3}, {56, 3}, {62, 10}, {18, 10}}};
    cv::fillConvexPoly(picture, cabin.data(), 4, opaque(roof));
    cv::fillConvexPoly(picture, panes.data(), 4, opaque(glass));
    box(picture, 40, 2, 2, 9, opaque(paint));
    box(picture, 1, 11, 78, 11, opaque(paint));
    box(picture, 1, 18, 78, 4, opaque(paint * 0.75f));
    for (const int x : {17, 63}) {
      cv::circle(picture, {x, 21}, 6, tyre, cv::FILLED);
      cv::circle(picture, {x, 21}, 3, opaque({150, 150, 150}), cv::FILLED);
    }
  } else {
    box(picture, 6, 1, 24, 10, opaque(roof));
    box(picture, 8, 3, 20, 8, opaque(glass));
    box(picture, 2, 11, 32, 12, opaque(paint));
    const bool front = view == View::kFront;
    const cv::Scalar lights = look_.night ? (front ? opaque({225, 245, 255}, kGlow) : opaque({40, 40, 235}, kGlow))
                                          : (front ? opaque({225, 230, 230}) : opaque({40, 40, 200}));
    box(picture, 3, 13, 6, 4, lights);
    box(picture, 27, 13, 6, 4, lights);
    box(picture, 13, 16, 10, 3, opaque({220, 220, 220}));
    box(picture, 4, 23, 5, 5, tyre);
    box(picture, 27, 23, 5, 5, tyre);
  }
  return std::make_shared<Texture>(picture, look_.night && !side);
}

}  // namespace citylearn::drawn
