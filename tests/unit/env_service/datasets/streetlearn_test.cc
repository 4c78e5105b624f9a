// SPDX-License-Identifier: Apache-2.0
// StreetLearn.
#include <cmath>

#include "env_service/images/panorama.h"
#include "tests/support/data/layouts.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

/// A panorama of 8 sectors of 45 degrees: sector s, whose middle is s x 45 degrees right of the middle column, has the
/// colour (20 s, 255 - 20 s, s odd); above the horizon 40 darker in green.
cv::Mat sectors(int columns) {
  cv::Mat panorama(columns / 2, columns, CV_8UC3);
  for (int y = 0; y < panorama.rows; ++y)
    for (int x = 0; x < panorama.cols; ++x) {
      const double degrees = ((x + 0.5) / columns - 0.5) * 360;
      const int s = (static_cast<int>(std::floor((degrees + 22.5) / 45)) + 8) % 8;
      panorama.at<cv::Vec3b>(y, x) =
          cv::Vec3b(static_cast<uchar>(20 * s), static_cast<uchar>(255 - 20 * s - (y < panorama.rows / 2 ? 40 : 0)),
                    static_cast<uchar>(s % 2 ? 255 : 0));
    }
  return panorama;
}

TEST(Panorama, ViewsShowTheirHeading) {
  const cv::Mat panorama = sectors(720);
  for (int s = -3; s < 12; ++s) {
    const int sector = (s + 8) % 8;
    const cv::Mat view = crop_panorama(panorama, {45.0 * s, 90, 84});
    ASSERT_EQ(view.size(), cv::Size(84, 84));
    // The middle is this sector, the edges are the middles of its neighbours: 90 degrees; up is up.
    EXPECT_EQ(view.at<cv::Vec3b>(60, 42)[0], 20 * sector) << s;
    EXPECT_EQ(view.at<cv::Vec3b>(60, 2)[0], 20 * ((sector + 7) % 8)) << s;
    EXPECT_EQ(view.at<cv::Vec3b>(60, 81)[0], 20 * ((sector + 1) % 8)) << s;
    EXPECT_EQ(view.at<cv::Vec3b>(60, 42)[1], 255 - 20 * sector);
    EXPECT_EQ(view.at<cv::Vec3b>(20, 42)[1], 255 - 20 * sector - 40);
  }
}

TEST(Panorama, BordersLieWhereThePerspectivePutsThem) {
  // The border of the middle sector is 22.5 degrees to the right: in a view of 90 degrees and 200 pixels at
  // 100 + 100 tan(22.5) = 141.4; the seam of the panorama behind must not show.
  const cv::Mat view = crop_panorama(sectors(1440), {180, 90, 200});
  EXPECT_EQ(view.at<cv::Vec3b>(150, 139)[0], 80);
  EXPECT_EQ(view.at<cv::Vec3b>(150, 143)[0], 100);
  EXPECT_EQ(view.at<cv::Vec3b>(150, 99)[0], 80);
  EXPECT_EQ(view.at<cv::Vec3b>(150, 100)[0], 80);
  EXPECT_EQ(crop_panorama(sectors(1440), {0, 30, 200}).at<cv::Vec3b>(150, 1)[0], 0);  // 15 degrees: still the middle
}

/// Four panoramas in a street going east and one to the north of the third:   e
///                                                                       a b c d
class StreetLearn : public ::testing::Test {
 protected:
  void SetUp() override {
    // Their middle columns head south (180).
    make_file(folder_ / "nodes.txt",
              "a,180,0.0,0.000\nb,180,0.0,0.001\nc,180,0.0,0.002\nd,180,0.0,0.003\ne,180,0.0005,0.002\n");
    make_file(folder_ / "links.txt", "a,90,b\nb,270,a\nb,90,c\nc,270,b\nc,90,d\nd,270,c\nc,0,e\ne,180,c\n");
    for (const std::string id : {"a", "b", "c", "d", "e"}) {
      fs::create_directories(folder_ / "panos");
      ASSERT_TRUE(cv::imwrite(folder_ / ("panos/" + id + ".png"), sectors(720)));
    }
  }
  std::unique_ptr<Dataset> dataset(const std::map<std::string, double>& parameters = {{"size", 84}}) const {
    return make_dataset("streetlearn", folder_.path(), parameters);
  }
  static int sector(const Traversal& traversal, int frame) {
    return picture_of(traversal, frame).at<cv::Vec3b>(60, 42)[0] / 20;
  }
  Folder folder_;
};

TEST_F(StreetLearn, WalksTheGivenRoutesLookingAhead) {
  make_file(folder_ / "routes.txt", "corner,a,e\nthere and back,a,c,a\n");
  EXPECT_EQ(dataset()->names(), (std::vector<std::string>{"corner", "there and back"}));
  const Traversal corner = dataset()->load("corner");
  ASSERT_EQ(corner.frames, 4);  // a b c e
  EXPECT_NEAR(corner.positions[2], 0.002 * kDegree, 0.05);
  EXPECT_NEAR(corner.positions[3], 0.0025 * kDegree, 0.05);
  EXPECT_EQ(corner.latitude[3], 0.0005);
  // East is 90 degrees left of south: sector 6. North is behind: sector 4; the last frame looks on.
  EXPECT_EQ(sector(corner, 0), 6);
  EXPECT_EQ(sector(corner, 1), 6);
  EXPECT_EQ(sector(corner, 2), 4);
  EXPECT_EQ(sector(corner, 3), 4);
  const Traversal back = dataset()->load("there and back");
  ASSERT_EQ(back.frames, 5);  // a b c b a
  EXPECT_EQ(sector(back, 2), 2);
  EXPECT_NEAR(back.positions[4], 0.004 * kDegree, 0.05);
  // The same panorama, another look.
  EXPECT_NE(back.images->fingerprint(1), back.images->fingerprint(3));
  EXPECT_EQ(back.images->fingerprint(1), corner.images->fingerprint(1));
  EXPECT_NE(dataset({{"size", 100}})->load("corner").images->fingerprint(1), corner.images->fingerprint(1));
  EXPECT_NE(dataset({{"size", 84}, {"fov", 60}})->load("corner").images->fingerprint(1), corner.images->fingerprint(1));
  EXPECT_EQ(picture_of(dataset({{"size", 512}})->load("corner"), 0).size(), cv::Size(512, 512));
}

TEST_F(StreetLearn, FindsFarRoutesItself) {
  const auto found = dataset();
  ASSERT_FALSE(found->names().empty());
  EXPECT_EQ(found->names()[0], "route-1");
  const Traversal route = found->load("route-1");
  ASSERT_EQ(route.frames, 4);  // from one end of the street to the other
  EXPECT_NEAR(route.positions[3], 0.003 * kDegree, 0.05);
  EXPECT_EQ(route.hash(), dataset()->load("route-1").hash());
  EXPECT_EQ(dataset({{"routes", 1}})->names().size(), 1u);
}

TEST_F(StreetLearn, ShowsTheWholeMapStateByState) {
  make_file(folder_ / "routes.txt", "street,a,d\n");
  const auto city = [&](StateRule rule) {
    const auto map = dataset();
    map->walk_by(rule);
    EXPECT_EQ(map->names(), std::vector<std::string>{rule == StateRule::kLine ? "street" : "streets"});
    return map->load(map->names()[0]);
  };
  // By place and heading: a-b, b-c, b-a, c-e, c-d, c-b, d-c, e-c; the middle columns look south.
  const Traversal links = city(StateRule::kStreet);
  ASSERT_EQ(links.frames, 8);
  EXPECT_EQ(links.longitude[3], 0.002);
  const std::vector<int> heading{90, 90, 270, 0, 90, 270, 270, 180};
  for (int state = 0; state < 8; ++state)
    EXPECT_EQ(sector(links, state), (heading[static_cast<std::size_t>(state)] / 45 + 4) % 8) << state;
  EXPECT_NE(links.images->fingerprint(1), links.images->fingerprint(2));
  const Traversal headings = city(StateRule::kStreetFixed);
  ASSERT_EQ(headings.frames, 80);
  for (int state = 16; state < 32; state += 2) EXPECT_EQ(sector(headings, state), ((state - 16) / 2 + 4) % 8) << state;
  EXPECT_EQ(city(StateRule::kLine).streets, nullptr);
}

TEST_F(StreetLearn, TellsWhatIsMissingOrBroken) {
  fs::remove(folder_ / "panos/b.png");
  make_file(folder_ / "panos/c.png", "broken");
  make_file(folder_ / "routes.txt", "street,a,d\n");
  const Traversal street = dataset()->load("street");
  EXPECT_TRUE(holds(street.images->name(1), "panos/b.jpg"));
  EXPECT_NE(street.images->fault(1), "");
  EXPECT_NE(street.images->fault(2), "");
  Bytes bytes;
  EXPECT_TRUE(holds(error_of([&] { street.images->read(2, bytes); }), "panos/c.png"));

  make_file(folder_ / "routes.txt", "street,a,d\nother,a,z\n");
  const auto one = dataset();
  for (int again = 0; again < 2; ++again) EXPECT_TRUE(holds(error_of([&] { one->names(); }), "routes.txt:2: id z"));
  make_file(folder_ / "routes.txt", "street,a,d\nstreet,d,a\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "routes.txt:2: a second route street"));
  make_file(folder_ / "routes.txt", "street,a,a\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->load("street"); }), "has 0 frames"));
  fs::remove(folder_ / "routes.txt");
  make_file(folder_ / "links.txt", "a,90,b\nb,east,c\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links.txt:2"));
  make_file(folder_ / "links.txt", "a,90,b\nb,90,q\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links.txt:2: id q"));
  make_file(folder_ / "links.txt", "a,90,b\n");
  make_file(folder_ / "routes.txt", "back,b,a\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->load("back"); }), "no way from b to a"));
  make_file(folder_ / "nodes.txt", "a,180,0.0,0.000\na,180,0.0,0.001\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "nodes.txt:2"));
  make_file(folder_ / "nodes.txt", "a,180,0.0,0.000\nb,180,0.0,0.001\n");
  make_file(folder_ / "links.txt", "a,90,b\nb,270,b\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links.txt:2: b is linked with itself"));
  make_file(folder_ / "links.txt", "a,nan,b\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links.txt:1"));
  make_file(folder_ / "links.txt", "");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links no two panoramas"));
  make_file(folder_ / "nodes.txt", "a,180,0.0,0.000\nb,180,91,0.001\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "nodes.txt:2: the coordinates of b"));
  fs::remove_all(folder_ / "panos");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "panos"));
  fs::remove(folder_ / "links.txt");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "links.txt"));
}

}  // namespace
}  // namespace citylearn::testing
