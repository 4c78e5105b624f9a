// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/camera.h"

#include <cmath>

namespace citylearn::drawn {
namespace {

constexpr float kStep = 2, kBehind = 26;  // metres: between surveyed points of the route, and behind the camera
constexpr float kNear = 0.6f, kLane = 1.6f;
constexpr float kFade = 40;  // over so many metres things appear

}  // namespace

Camera::Camera(const DrawnOptions& options, const Look& look, std::uint64_t look_index)
    : options_(options),
      look_(look),
      look_index_(look_index),
      world_(options, look, look_index),
      width_(2 * options.width),
      height_(2 * options.height),
      level_(static_cast<int>(0.92 * options.height)),
      horizon_(level_),
      focal_(1.3f * static_cast<float>(options.width)),
      centre_(static_cast<float>(options.width)) {
  for (int metre = 0; metre <= 256; ++metre) {
    const float share = 1 - std::exp(-std::pow(static_cast<float>(metre) / look.sight, 1.4f));
    haze_.push_back(static_cast<int>(256 * share));
    fade_.push_back(static_cast<int>(std::clamp((kAhead - static_cast<float>(metre)) / kFade, 0.f, 1.f) * 256));
  }
  Random random{42};
  for (int k = 0; k < 256; ++k) grain_.push_back(static_cast<int>(std::lround(look.noise * random.normal())));
  buffer_.create(height_, width_, CV_8UC4);
  picture_.create(options.height, options.width, CV_8UC3);
  for (std::uint64_t k = 0; k < traffic_.size(); ++k)
    traffic_[k] = world_.painter().car(k < 3 ? Painter::View::kBack : Painter::View::kFront, Random{44, look_index, k});
  paint_sky();
}

const cv::Mat& Camera::draw(float s) {
  Random random{43, options_.seed, look_index_, static_cast<std::uint64_t>(std::llround(s * 1000.0))};
  survey(s);
  draw_sky(s);
  draw_ground(s);
  draw_things(s);
  if (look_.wet > 0) mirror();
  if (look_.rain > 0 || look_.snowfall > 0) fall(random);
  develop(random);
  return picture_;
}

void Camera::survey(float s) {
  const auto sway = [&](std::uint64_t what, float length) {
    return look_.sway * noise(mix_seeds({kSway, look_index_, what}), s / length);
  };
  const float yaw = look_.yaw + 0.010f * sway(1, 23) + 0.006f * sway(2, 7);
  const float lateral = kLane + look_.lateral + 0.12f * sway(3, 35);
  horizon_ = level_ + static_cast<int>(std::lround(focal_ * 0.006f * sway(4, 6)));
  begin_ = s - kBehind;
  heading_ = world_.heading(s) + yaw;
  const int count = static_cast<int>((kBehind + kAhead) / kStep) + 2, here = static_cast<int>(kBehind / kStep);
  route_.resize(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k)
    route_[static_cast<std::size_t>(k)].turn = world_.heading(begin_ + kStep * static_cast<float>(k)) - heading_;
  Place& place = route_[static_cast<std::size_t>(here)];
  place.x = -lateral * std::cos(place.turn);
  place.z = lateral * std::sin(place.turn);
  for (int k = here + 1; k < count; ++k) {
    const Place& last = route_[static_cast<std::size_t>(k - 1)];
    Place& next = route_[static_cast<std::size_t>(k)];
    const float turn = 0.5f * (last.turn + next.turn);
    next.x = last.x + kStep * std::sin(turn);
    next.z = last.z + kStep * std::cos(turn);
  }
  for (int k = here - 1; k >= 0; --k) {
    const Place& last = route_[static_cast<std::size_t>(k + 1)];
    Place& next = route_[static_cast<std::size_t>(k)];
    const float turn = 0.5f * (last.turn + next.turn);
    next.x = last.x - kStep * std::sin(turn);
    next.z = last.z - kStep * std::cos(turn);
  }
}

Camera::Place Camera::at(float s) const {
  const float at = std::clamp((s - begin_) / kStep, 0.f, static_cast<float>(route_.size()) - 1.001f);
  const auto k = static_cast<std::size_t>(at);
  const float share = at - static_cast<float>(k);
  const Place &a = route_[k], &b = route_[k + 1];
  Place place;
  place.x = a.x + (b.x - a.x) * share;
  place.z = a.z + (b.z - a.z) * share;
  place.turn = a.turn + (b.turn - a.turn) * share;
  return place;
}

Camera::Point Camera::beside(float s, float lateral) const {
  const Place place = at(s);
  return {place.x + lateral * std::cos(place.turn), place.z - lateral * std::sin(place.turn)};
}

cv::Vec3i Camera::light(float direct, Point at) const {
  const float share = 1 - look_.sun + 1.5f * look_.sun * direct;
  Colour light = look_.light * share;
  if (look_.night) {
    const float aside = at.x / (2.5f + 0.16f * at.z);
    light += Colour(150, 190, 205) * (1.15f * std::exp(-std::max(0.f, at.z) / 24 - aside * aside));
  }
  return {static_cast<int>(light[0] * 256 / 255), static_cast<int>(light[1] * 256 / 255),
          static_cast<int>(light[2] * 256 / 255)};
}

void Camera::draw_things(float s) {
  const long first = static_cast<long>(std::floor((s - 14) / kCell)),
             last = static_cast<long>(std::floor((s + kAhead - 14) / kCell));
  for (long index = last; index >= first; --index) {
    const Cell& cell = world_.cell(index);
    for (const Thing& thing : cell.things) draw_shadow(thing);
    draw_traffic(s, index);
    for (const Thing& thing : cell.things) draw_thing(thing);
  }
}

/// Draws a dark patch under trees, bushes and cars.
void Camera::draw_shadow(const Thing& thing) {
  if (look_.night || look_.sun < 0.2f) return;
  Point middle;
  float wide = 0, deep = 0;
  if (thing.face == Thing::kUpright && thing.lateral_end > 1.5f) {
    const float reach = 0.5f * thing.top / std::tan(look_.sun_elevation), turn = look_.sun_azimuth - heading_;
    middle = beside(thing.s, thing.lateral);
    middle.x -= reach * std::sin(turn);
    middle.z -= reach * std::cos(turn);
    wide = thing.lateral_end * 0.42f, deep = wide * 0.9f;
  } else if (thing.face == Thing::kAcross && thing.top < 2) {
    middle = beside(thing.s + 2.1f, 0.5f * (thing.lateral + thing.lateral_end));
    wide = 1.3f, deep = 2.8f;
  } else {
    return;
  }
  if (middle.z + deep < 3 || middle.z > 120) return;
  const int top = horizon_ + static_cast<int>(focal_ * kEye / (middle.z + deep));
  const int bottom = middle.z - deep < 1 ? height_ : horizon_ + static_cast<int>(focal_ * kEye / (middle.z - deep));
  for (int y = std::max(top, horizon_ + 1); y < std::min(bottom, height_); ++y) {
    const float z = focal_ * kEye / static_cast<float>(y - horizon_), off = (z - middle.z) / deep;
    const float half = wide * std::sqrt(std::max(0.f, 1 - off * off));
    const int left = static_cast<int>(centre_ + focal_ * (middle.x - half) / z),
              right = static_cast<int>(centre_ + focal_ * (middle.x + half) / z);
    auto* out = buffer_.ptr<cv::Vec4b>(y);
    for (int x = std::max(0, left); x < std::min(width_, right); ++x)
      if (out[x][3] > 0)
        for (int k = 0; k < 3; ++k) out[x][k] = static_cast<uchar>(out[x][k] * 168 >> 8);
  }
}

/// Draws a car ahead for some of the time, and others that come towards the camera.
void Camera::draw_traffic(float s, long cell) {
  const std::uint64_t stream = mix_seeds({kTraffic, options_.seed, look_index_});
  const auto draw = [&](float at, float lateral, const Skin& skin) {
    if (static_cast<long>(std::floor(at / kCell)) != cell || at < s + 3) return;
    draw_thing({Thing::kUpright, at, 0, lateral, 1.8f, 0, 1.5f, 1, skin});
  };
  const float ahead = noise(stream, s / 90);
  if (ahead > -0.1f) draw(s + 48 - 36 * ahead, kLane, traffic_[static_cast<std::size_t>(std::floor(s / 400)) % 3]);
  // One meets the camera in every second stretch or so, at a place that the recording decides.
  constexpr float kStretch = 70;
  for (float stretch = std::floor(s / kStretch); stretch < (s + kAhead) / kStretch; ++stretch) {
    const std::uint64_t stretch_bits = static_cast<std::uint64_t>(static_cast<std::int64_t>(stretch));
    Random random{stream, stretch_bits};
    const float meeting = kStretch * (stretch + static_cast<float>(random.uniform()));
    if (random.uniform() < 0.6) draw(s + 2 * (meeting - s), -kLane, traffic_[3 + random.below(3)]);
  }
}

void Camera::draw_thing(const Thing& thing) {
  const float turn = look_.sun_azimuth - heading_;
  switch (thing.face) {
    case Thing::kAlong: {
      const Point a = beside(thing.s, thing.lateral), b = beside(thing.s_end, thing.lateral);
      // It faces the route.
      const float side = std::sin(turn - at(thing.s).turn) * (thing.lateral > 0 ? -1.f : 1.f);
      draw_wall(thing, a, b, std::clamp(0.35f + 0.75f * side, 0.1f, 1.f));
      break;
    }
    case Thing::kAcross: {
      const Point a = beside(thing.s, thing.lateral), b = beside(thing.s, thing.lateral_end);
      draw_wall(thing, a, b, std::clamp(0.3f - 0.7f * std::cos(turn), 0.05f, 0.9f));
      break;
    }
    case Thing::kUpright: {
      Point a = beside(thing.s, thing.lateral), b = a;
      a.x -= 0.5f * thing.lateral_end;
      b.x += 0.5f * thing.lateral_end;
      draw_wall(thing, a, b, 0.55f - 0.2f * std::cos(turn));
      break;
    }
  }
}

void Camera::draw_wall(const Thing& thing, Point a, Point b, float direct) {
  float from = 0, to = 1;
  if (a.z < kNear && b.z < kNear) return;
  if (a.z > kAhead && b.z > kAhead) return;
  const Point middle{0.5f * (a.x + b.x), 0.5f * (a.z + b.z)};
  if (a.z < kNear) {
    from = (kNear - a.z) / (b.z - a.z);
    a = {a.x + (b.x - a.x) * from, kNear};
  } else if (b.z < kNear) {
    to = (kNear - a.z) / (b.z - a.z);
    b = {a.x + (b.x - a.x) * to, kNear};
  }
  float left = centre_ + focal_ * a.x / a.z, right = centre_ + focal_ * b.x / b.z;
  float near_left = 1 / a.z, near_right = 1 / b.z;  // linear across the screen, as is u / z
  if (left > right) {
    std::swap(left, right);
    std::swap(near_left, near_right);
    std::swap(from, to);
  }
  const int first = std::max(0, static_cast<int>(std::ceil(left - 0.5f))),
            end = std::min(width_, static_cast<int>(std::ceil(right - 0.5f)));
  if (first >= end) return;
  const Texture& skin = *thing.skin;
  const bool shines = skin.glows;
  const cv::Vec3i lit = light(direct, middle);
  const cv::Vec3i shade(static_cast<int>(static_cast<float>(lit[0]) * thing.tint),
                        static_cast<int>(static_cast<float>(lit[1]) * thing.tint),
                        static_cast<int>(static_cast<float>(lit[2]) * thing.tint));
  for (int x = first; x < end; ++x) {
    const float share = (static_cast<float>(x) + 0.5f - left) / (right - left);
    const float near = near_left + (near_right - near_left) * share;
    const float u = (from * near_left + (to * near_right - from * near_left) * share) / near;
    const auto metre = static_cast<std::size_t>(std::min(1 / near, 255.f));
    const int fade = fade_[metre], haze = haze_[metre], keep = 256 - haze;
    if (fade == 0) continue;
    const float top = static_cast<float>(horizon_) - focal_ * (thing.top - kEye) * near;
    const float bottom = static_cast<float>(horizon_) + focal_ * (kEye - thing.bottom) * near;
    const int y0 = std::max(0, static_cast<int>(std::ceil(top - 0.5f))),
              y1 = std::min(height_, static_cast<int>(std::ceil(bottom - 0.5f)));
    if (y0 >= y1) continue;
    std::size_t level = 0;
    for (float texels = static_cast<float>(skin.levels[0].rows) / (bottom - top);
         texels > 1.3f && level + 1 < skin.levels.size(); texels /= 2)
      ++level;
    const cv::Mat& picture = skin.levels[level];
    const auto stride = static_cast<std::size_t>(picture.cols);
    const auto* column = picture.ptr<cv::Vec4b>() +
                         std::clamp(static_cast<int>(u * static_cast<float>(picture.cols)), 0, picture.cols - 1);
    const float rows = static_cast<float>(picture.rows) / (bottom - top);
    const int dv = static_cast<int>(rows * 65536);
    int v = static_cast<int>((static_cast<float>(y0) + 0.5f - top) * rows * 65536);
    const std::array<int, 3> mist{static_cast<int>(look_.horizon[0]) * haze, static_cast<int>(look_.horizon[1]) * haze,
                                  static_cast<int>(look_.horizon[2]) * haze};
    auto* out = buffer_.ptr<cv::Vec4b>(y0) + x;
    for (int y = y0; y < y1; ++y, v += dv, out += width_) {
      const int row = std::clamp(v >> 16, 0, picture.rows - 1);
      const cv::Vec4b texel = column[static_cast<std::size_t>(row) * stride];
      int cover = texel[3];
      if (cover < 12) continue;
      const bool glowing = shines && cover > kGlow - 60 && cover < 230;
      if (glowing || cover > 240) cover = 256;
      cover = cover * fade >> 8;
      for (int k = 0; k < 3; ++k) {
        const int own = glowing ? texel[k] : std::min(255, texel[k] * shade[k] >> 8);
        const int hazy = (own * keep + mist[static_cast<std::size_t>(k)]) >> 8;
        (*out)[k] = static_cast<uchar>((*out)[k] + (((hazy - (*out)[k]) * cover) >> 8));
      }
      if (cover > 128) (*out)[3] = 0;
    }
  }
}

void Camera::mirror() {
  for (int y = horizon_ + 1; y < height_; ++y) {
    const int from = std::max(0, 2 * horizon_ - y);
    const auto* above = buffer_.ptr<cv::Vec4b>(from);
    auto* out = buffer_.ptr<cv::Vec4b>(y);
    const float grazing = 1 - 0.55f * static_cast<float>(y - horizon_) / static_cast<float>(height_ - horizon_);
    const int share = static_cast<int>(256 * look_.wet * 0.6f * grazing);
    for (int x = 0; x < width_; ++x) {
      const int cover = out[x][3] * share >> 8;
      for (int k = 0; k < 3; ++k)
        out[x][k] = static_cast<uchar>(out[x][k] + (((above[x][k] - out[x][k]) * cover) >> 8));
    }
  }
}

void Camera::fall(Random& random) {
  const int streaks = static_cast<int>(look_.rain * 170.f * static_cast<float>(width_ * height_) / 61440);
  for (int k = 0; k < streaks; ++k) {
    const int length = 6 + static_cast<int>(random.below(16)), bright = 14 + static_cast<int>(random.below(34));
    int x = static_cast<int>(random.below(static_cast<std::uint64_t>(width_))),
        y = static_cast<int>(random.below(static_cast<std::uint64_t>(height_)));
    for (int drop = 0; drop < length && y < height_; ++drop, ++y) {
      if (drop % 5 == 4 && ++x >= width_) break;
      for (int c = 0; c < 3; ++c) buffer_.at<cv::Vec4b>(y, x)[c] = byte(buffer_.at<cv::Vec4b>(y, x)[c] + bright);
    }
  }
  const int flakes = static_cast<int>(look_.snowfall * 260.f * static_cast<float>(width_ * height_) / 61440);
  for (int k = 0; k < flakes; ++k) {
    const int size = 1 + static_cast<int>(random.below(3));
    const int x0 = static_cast<int>(random.below(static_cast<std::uint64_t>(width_ - size))),
              y0 = static_cast<int>(random.below(static_cast<std::uint64_t>(height_ - size)));
    for (int y = y0; y < y0 + size; ++y)
      for (int x = x0; x < x0 + size; ++x)
        for (int c = 0; c < 3; ++c) buffer_.at<cv::Vec4b>(y, x)[c] = byte(buffer_.at<cv::Vec4b>(y, x)[c] / 3 + 166);
  }
}

/// Reduces four pixels to one and applies the exposure and the sensor's noise.
void Camera::develop(Random& random) {
  const cv::Vec3i gain(static_cast<int>(look_.gain[0] * 64), static_cast<int>(look_.gain[1] * 64),
                       static_cast<int>(look_.gain[2] * 64));
  for (int y = 0; y < picture_.rows; ++y) {
    const auto *a = buffer_.ptr<cv::Vec4b>(2 * y), *b = buffer_.ptr<cv::Vec4b>(2 * y + 1);
    auto* out = picture_.ptr<cv::Vec3b>(y);
    std::uint64_t bits = 0;
    for (int x = 0; x < picture_.cols; ++x, bits >>= 8) {
      if (x % 8 == 0) bits = random.next();
      const int grain = grain_[bits & 255];
      for (int k = 0; k < 3; ++k)
        out[x][k] = byte(((a[2 * x][k] + a[2 * x + 1][k] + b[2 * x][k] + b[2 * x + 1][k]) * gain[k] >> 8) + grain);
    }
  }
}

}  // namespace citylearn::drawn
