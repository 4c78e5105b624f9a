// SPDX-License-Identifier: Apache-2.0
// Sky, hills and ground.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "env_service/drawn_city/camera.h"

namespace citylearn::drawn {
namespace {

cv::Vec4b pixel(const Colour& c) {
  return {cv::saturate_cast<uchar>(c[0]), cv::saturate_cast<uchar>(c[1]), cv::saturate_cast<uchar>(c[2]), 0};
}

}  // namespace

void Camera::paint_sky() {
  const int around = static_cast<int>(2 * std::numbers::pi_v<float> * focal_);
  sky_.create(level_ + 1, around, CV_8UC4);
  const std::uint64_t clouds = mix_seeds({kClouds, options_.seed, look_index_});
  Random stars{kStars, options_.seed};
  for (int y = 0; y < sky_.rows; ++y) {
    const float elevation = static_cast<float>(level_ - y) / focal_;
    const Colour clear =
        look_.horizon + (look_.zenith - look_.horizon) * std::min(1.f, std::pow(2.1f * elevation, 0.7f));
    for (int x = 0; x < around; ++x) {
      const float azimuth = static_cast<float>(x) / focal_ - std::numbers::pi_v<float>;
      const float deep = 1 / (elevation + 0.12f);  // clouds lie in a plane
      const float u = azimuth * 2.6f + 3, v = deep;
      const float thick = 0.55f * noise(clouds, u, v) + 0.28f * noise(clouds + 1, 2.3f * u, 2.1f * v) +
                          0.17f * noise(clouds + 2, 5.1f * u, 4.3f * v);
      const float cover =
          std::clamp(2.2f * (thick + 1.5f * look_.clouds - 0.85f), 0.f, 1.f) * std::min(1.f, elevation * 9);
      Colour colour = clear + (look_.cloud * (1 - 0.14f * std::max(0.f, thick)) - clear) * (cover * 0.9f);
      const float away = std::hypot(azimuth - look_.sun_azimuth, elevation - look_.sun_elevation);
      if (look_.sun > 0.2f)
        colour +=
            (Colour(225, 250, 255) - colour) * std::min(1.f, 0.8f * std::exp(-away * 5) + (away < 0.05f ? 1.f : 0.f));
      if (look_.night && stars.uniform() < 0.004)
        colour += Colour(150, 150, 150) * ((1 - cover) * static_cast<float>(stars.uniform()));
      if (look_.night && std::hypot(azimuth + 0.35f, elevation - 0.3f) < 0.035f) colour = {200, 232, 240};
      sky_.at<cv::Vec4b>(y, x) = pixel(colour);
    }
  }
}

void Camera::draw_sky(float s) {
  const int start = static_cast<int>((heading_ + std::numbers::pi_v<float>)*focal_ - centre_);
  const int left = ((start % sky_.cols) + sky_.cols) % sky_.cols, first = std::min(width_, sky_.cols - left);
  for (int y = 0; y < height_; ++y) {
    const auto* row = sky_.ptr<cv::Vec4b>(std::clamp(y - horizon_ + level_, 0, level_));
    auto* out = buffer_.ptr<cv::Vec4b>(y);
    std::copy_n(row + left, first, out);
    std::copy_n(row, width_ - first, out + first);
  }
  // Two ranges of hills; the nearer one passes by more quickly.
  const Colour wood = look_.leaves == 1   ? Colour(60, 110, 150)
                      : look_.leaves == 2 ? Colour(170, 165, 165)
                                          : Colour(82, 122, 84);
  for (int range = 0; range < 2; ++range) {
    const float haze = range == 0 ? 0.72f : 0.45f;
    Colour lit = wood.mul(look_.light) * (1 / 255.f);
    const cv::Vec4b colour = pixel(lit + (look_.horizon - lit) * haze);
    const std::uint64_t stream = mix_seeds({kHills, options_.seed, static_cast<std::uint64_t>(range)});
    for (int x = 0; x < width_; ++x) {
      const float azimuth = heading_ + (static_cast<float>(x) - centre_) / focal_;
      const float way = s / (range == 0 ? 2500.f : 900.f);
      const float height =
          range == 0
              ? 0.045f + 0.045f * noise(stream, azimuth * 4, way) + 0.012f * noise(stream + 9, azimuth * 17, way)
              : 0.022f + 0.028f * noise(stream, azimuth * 7, way) + 0.008f * noise(stream + 9, azimuth * 40, way);
      const int top = horizon_ - static_cast<int>(focal_ * std::max(0.f, height));
      for (int y = top; y <= horizon_; ++y) buffer_.at<cv::Vec4b>(y, x) = colour;
    }
  }
}

void Camera::draw_ground(float s) {
  const Colour far = look_.horizon;
  float along = s + 1;
  const auto lit = [&](float share) {
    return cv::Vec3i(static_cast<int>(look_.light[0] * share), static_cast<int>(look_.light[1] * share),
                     static_cast<int>(look_.light[2] * share));
  };
  const cv::Vec3i dim = lit(1 - look_.sun),
                  sunlit = lit(1 - look_.sun + 1.35f * look_.sun * std::sin(look_.sun_elevation));
  const float reach = 1 / std::tan(look_.sun_elevation);
  for (int y = height_ - 1; y > horizon_; --y) {
    const float z = focal_ * kEye / (static_cast<float>(y - horizon_) - 0.3f);
    if (z >= kAhead - 4) break;
    while (along < s + kAhead - 4 && at(along).z < z) along += z > 40 ? 1.f : 0.2f;
    const Place centre = at(along);
    const float cosine = std::cos(centre.turn), sine = std::sin(centre.turn);
    const long index = static_cast<long>(std::floor(along / kCell));
    const float beat = 0.5f + 0.5f * std::cos((along - 1) * std::numbers::pi_v<float> / 6);  // from lamp to lamp
    // Two cells may meet in a row of pixels; the one in its middle decides, except for what depends on s itself.
    const Cell& cell = world_.cell(index);
    const float side = std::sin(look_.sun_azimuth - heading_ - centre.turn);
    const std::size_t sunny = side > 0 ? 1 : 0;
    const float edge = cell.front[sunny], shade = edge - cell.roof[sunny] * reach * std::abs(side);
    const cv::Vec3i haze = cv::Vec3i(static_cast<int>(far[0]), static_cast<int>(far[1]), static_cast<int>(far[2])) *
                           haze_[static_cast<std::size_t>(z)];
    const int keep = 256 - haze_[static_cast<std::size_t>(z)];
    const float rough = std::min(1.f, 18 / z) * (look_.snow > 0 ? 8.f : 14.f);
    auto* out = buffer_.ptr<cv::Vec4b>(y);
    const float across = z / focal_, ahead = 1.15f * std::exp(-z / 24);
    for (int x = 0; x < width_; ++x) {
      const float aside = (static_cast<float>(x) + 0.5f - centre_) * across, dx = aside - centre.x;
      const float lateral = dx * cosine, way = along + dx * sine;
      const int step =
          std::clamp(static_cast<int>((lateral + kGroundReach) * kGroundSteps), 0, 2 * kGroundReach * kGroundSteps - 1);
      cv::Vec4b c = cell.ground[static_cast<std::size_t>(step)];
      const float away = std::abs(lateral);
      const int metre = static_cast<int>(std::floor(way));
      bool marked = away < 0.1f && (metre % 9 + 9) % 9 < 4;
      if (cell.crossing && away < 3.3f) {
        const float within = way - static_cast<float>(index) * kCell;
        marked = within > 4 && within < 7.5f && (static_cast<int>((lateral + 10) * 2) & 1) != 0;
      }
      if (marked && look_.snow < 0.5f) c = {222, 226, 226, c[3]};
      const unsigned grain = static_cast<unsigned>(static_cast<int>(std::floor(lateral * 6))) * 73856093u ^
                             static_cast<unsigned>(static_cast<int>(std::floor(way * 3))) * 19349663u;
      const int bump = static_cast<int>(rough * (static_cast<float>((grain * 2654435761u) >> 24) * 0x1p-7f - 1));
      const float toward = sunny == 1 ? lateral : -lateral;
      const bool shaded = toward > shade && toward < edge;
      cv::Vec3i l = shaded ? dim : sunlit;
      if (look_.night) {
        const float off = aside / (2.5f + 0.16f * z);
        const float beam = off * off < 6 ? ahead * std::exp(-off * off) : 0.f;
        l += cv::Vec3i(static_cast<int>(150 * beam), static_cast<int>(190 * beam), static_cast<int>(205 * beam));
        if (cell.zone != Zone::kCountry) {
          const float pool = 90 * beat * beat * std::exp(-(away - 3.6f) * (away - 3.6f) / 9);
          l += cv::Vec3i(static_cast<int>(pool * 0.55f), static_cast<int>(pool * 0.85f), static_cast<int>(pool));
        }
      }
      for (int k = 0; k < 3; ++k) out[x][k] = byte(((((c[k] + bump) * l[k]) >> 8) * keep + haze[k]) >> 8);
      out[x][3] = c[3];
    }
  }
}

}  // namespace citylearn::drawn
