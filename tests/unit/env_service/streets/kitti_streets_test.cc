// SPDX-License-Identifier: Apache-2.0
// Where drives of KITTI meet themselves, by a search through all pairs of frames.
#include <fstream>

#include "env_service/geometry/geometry.h"
#include "env_service/streets/drive_streets.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"

namespace citylearn::testing {
namespace {

/// What a search through all pairs of frames finds, of poses of KITTI.
struct Truth {
  std::vector<double> x, z, along;
  std::vector<std::pair<double, double>> ways;  ///< directions
  std::vector<int> earlier;                     ///< the nearest frame of the earlier way that each is on; -1: on none
  std::vector<std::pair<int, int>> crossings;   ///< frames behind which ways cross at 45 degrees or more

  explicit Truth(const std::string& path) {
    std::ifstream file(path);
    for (std::array<double, 12> pose; file >> pose[0];) {
      for (std::size_t i = 1; i < 12; ++i) file >> pose[i];
      along.push_back(x.empty() ? 0 : along.back() + std::hypot(pose[3] - x.back(), pose[11] - z.back()));
      x.push_back(pose[3]);
      z.push_back(pose[11]);
    }
    const std::size_t frames = x.size();
    std::vector<double> steps;
    for (std::size_t i = 0; i < frames; ++i) {
      if (i > 0) steps.push_back(along[i] - along[i - 1]);
      std::size_t before = i, after = i;
      while (before > 0 && along[i] - along[before] < 0.5) --before;
      while (after + 1 < frames && along[after] - along[i] < 0.5) ++after;
      const double length = std::hypot(x[after] - x[before], z[after] - z[before]);
      ways.emplace_back((x[after] - x[before]) / length, (z[after] - z[before]) / length);
    }
    std::sort(steps.begin(), steps.end());
    const double usual = steps[steps.size() / 2], reach = 4 * usual;
    for (std::size_t b = 0; b < frames; ++b) {
      double least = reach * (b > 0 && earlier.back() >= 0 ? 1.5 : 1);
      earlier.push_back(-1);
      for (std::size_t a = 0; a < b; ++a) {
        const double cosine = ways[a].first * ways[b].first + ways[a].second * ways[b].second;
        const double metres = std::hypot(x[a] - x[b], z[a] - z[b]), back = along[b] - along[a];
        const double ahead = (x[b] - x[a]) * ways[a].first + (z[b] - z[a]) * ways[a].second;
        const bool aligned = std::abs(cosine) >= std::sqrt(0.5);
        if (!aligned && back > 4 * reach && b + 1 < frames && parts(a, b) && parts(b, a)) crossings.emplace_back(a, b);
        if (!aligned || metres > least || back <= (cosine > 0 ? 4 : 1) * reach ||
            std::abs(ahead) > std::max(usual, along[a + 1] - along[a]))
          continue;
        least = metres;
        earlier[b] = static_cast<int>(a);
      }
    }
  }
  /// Returns whether the line of frames a and a + 1 has b and b + 1 on its two sides.
  bool parts(std::size_t a, std::size_t b) const {
    const auto side = [&](std::size_t i) {
      return (x[a + 1] - x[a]) * (z[i] - z[a]) - (z[a + 1] - z[a]) * (x[i] - x[a]);
    };
    return side(b) * side(b + 1) < 0;
  }
  /// Returns the frames at which the drive comes to its earlier way and leaves it, by turns.
  std::vector<int> ends() const {
    std::vector<int> found;
    for (std::size_t b = 1; b < x.size(); ++b)
      if ((earlier[b] < 0) != (earlier[b - 1] < 0)) found.push_back(static_cast<int>(b) - (earlier[b] < 0));
    if (earlier.back() >= 0) found.push_back(static_cast<int>(x.size()) - 1);
    return found;
  }
};

TEST(DriveStreets, KittiMeetsItselfWhereAllPairsOfFramesSaySo) {
  const std::string poses = real_data(CITYLEARN_SOURCE_DIR, "kitti-odometry-poses");
  if (poses.empty()) GTEST_SKIP() << "needs kitti-odometry-poses";
  for (const std::string name : {"00", "05", "06", "07"}) {
    const Truth truth(poses + "/" + name + ".txt");
    Drive drive{truth.x, truth.z};
    drive.along = metres_along_plane(drive.east, drive.north);
    const DriveStreets streets = streets_of(drive, name);
    std::vector<int> found;  // as ends()
    for (const DriveMeeting& one : streets.meetings) {
      if (!found.empty() && one.first == found.back() + 1)
        found.pop_back();  // it goes on where the earlier way was another one's
      else
        found.push_back(one.first);
      found.push_back(one.last);
    }
    const std::vector<int> expected = truth.ends();
    ASSERT_EQ(found.size(), expected.size()) << name;
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 2) << name;
    const auto place = [&](int frame) {
      return frame < 0 || frame >= streets.frames ? -1 : streets.places[static_cast<std::size_t>(frame)];
    };
    const auto one_place = [&](int a, int b) {
      for (int i = a - 2; i <= a + 2; ++i)
        for (int j = b - 2; j <= b + 2; ++j)
          if (place(i) >= 0 && place(i) == place(j)) return true;
      return false;
    };
    const auto stands = [&](std::size_t a) { return a >= 2 && truth.along[a + 2] - truth.along[a - 2] < 0.5; };
    for (std::size_t b = 0; b < truth.x.size(); ++b) {
      const int a = truth.earlier[b];
      EXPECT_TRUE(a < 0 || stands(static_cast<std::size_t>(a)) || one_place(a, static_cast<int>(b)))
          << name << " " << a << " " << b;
    }
    for (const auto& [a, b] : truth.crossings) EXPECT_TRUE(one_place(a, b)) << name << " " << a << " " << b;
    EXPECT_EQ(truth.crossings.size(), name == "05" ? 1u : 0u);
  }
}

}  // namespace
}  // namespace citylearn::testing
