// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/parts.h"

namespace citylearn::drawn {

const std::vector<Look>& looks() {
  static const std::vector<Look> all = [] {
    std::vector<Look> looks(7);
    Look& summer = looks[0];
    summer.name = "summer";
    summer.sun_azimuth = 0.9f;
    summer.sun_elevation = 0.95f;

    Look& fall = looks[1];
    fall.name = "fall";
    fall.leaves = 1;
    fall.sun_azimuth = 0.2f;
    fall.sun_elevation = 0.6f;
    fall.light = {215, 238, 255};
    fall.zenith = {205, 150, 100};
    fall.horizon = {205, 222, 240};
    fall.clouds = 0.55f;
    fall.gain = {0.92f, 0.98f, 1.04f};
    fall.sway = 1.5f;
    fall.lateral = 0.1f;

    Look& winter = looks[2];
    winter.name = "winter";
    winter.leaves = 2;
    winter.snow = 0.9f;
    winter.sun = 0.3f;
    winter.sun_azimuth = -0.6f;
    winter.sun_elevation = 0.35f;
    winter.light = {236, 226, 216};
    winter.zenith = {206, 186, 164};
    winter.horizon = {232, 226, 220};
    winter.cloud = {225, 222, 220};
    winter.clouds = 0.7f;
    winter.sight = 95;
    winter.noise = 5;
    winter.snowfall = 1;
    winter.gain = {1.04f, 0.99f, 0.95f};
    winter.sway = 4.5f;
    winter.lateral = -0.15f;

    Look& night = looks[3];
    night.name = "night";
    night.night = true;
    night.sun = 0;
    night.light = {78, 62, 52};
    night.zenith = {44, 22, 12};
    night.horizon = {74, 50, 36};
    night.cloud = {54, 42, 36};
    night.clouds = 0.4f;
    night.sight = 200;
    night.noise = 12;
    night.sway = 5;
    night.lateral = 0.15f;

    Look& overcast = looks[4];
    overcast.name = "overcast";
    overcast.sun = 0.05f;
    overcast.light = {214, 212, 208};
    overcast.zenith = {196, 190, 184};
    overcast.horizon = {220, 218, 214};
    overcast.cloud = {178, 174, 170};
    overcast.clouds = 0.9f;
    overcast.sight = 190;
    overcast.sway = 1.5f;
    overcast.lateral = -0.1f;

    Look& rain = looks[5];
    rain.name = "rain";
    rain.sun = 0;
    rain.wet = 0.75f;
    rain.rain = 1.5f;
    rain.light = {160, 156, 148};
    rain.zenith = {150, 142, 134};
    rain.horizon = {172, 168, 162};
    rain.cloud = {124, 118, 112};
    rain.clouds = 0.9f;
    rain.sight = 85;
    rain.noise = 8;
    rain.sway = 4.5f;
    rain.lateral = 0.2f;

    Look& shifted = looks[6];
    shifted.name = "shifted";
    shifted.sun_azimuth = -1.1f;
    shifted.sun_elevation = 0.7f;
    shifted.clouds = 0.25f;
    shifted.light = {246, 252, 255};
    shifted.sway = 1.5f;
    shifted.yaw = -0.035f;
    return looks;
  }();
  return all;
}

}  // namespace citylearn::drawn
