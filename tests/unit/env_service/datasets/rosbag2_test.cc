// SPDX-License-Identifier: Apache-2.0
// Bags of ROS 2: fifteen that other tools wrote of the same messages, and small ones with values worked out by hand.
#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "core/recording/mcap_writer.h"
#include "core/util/sha256.h"
#include "env_service/images/image_sources.h"
#include "tests/paths.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Values = std::map<std::string, double>;
using Lines = std::vector<std::string>;

cv::Mat picture_of(const Traversal& traversal, int frame) {
  Bytes bytes;
  traversal.images->read(frame, bytes);
  return decode_image(bytes, "");
}

class ForeignBags : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    folder_ = real_data(CITYLEARN_SOURCE_DIR, "formats/rosbag2-2026");
    if (folder_.empty()) GTEST_SKIP() << "skipped: no bags of other tools; CITYLEARN_DATA names their folder";
  }
  Traversal load(const Values& options) const { return make_dataset("rosbag2", folder_, options)->load(GetParam()); }
  static std::string digest(const void* bytes, std::size_t size) {
    return sha256({static_cast<const char*>(bytes), size}).substr(0, 16);
  }
  std::string folder_;
};
INSTANTIATE_TEST_SUITE_P(All, ForeignBags,
                         ::testing::Values("chunks-lz4", "chunks-zstd-small", "mcap-ros2-support", "no-chunks",
                                           "no-index", "v4-db3", "v5-db3", "v6-db3", "v7-db3", "v8-db3-file-zstd",
                                           "v8-db3-messages-zstd", "v9-db3", "v9-mcap", "v9-mcap-chunks-zstd",
                                           "v9-mcap-messages-zstd"));

/// The digests are of what rosbags 0.11.9 reads.
TEST_P(ForeignBags, GivePicturesTimesAndPositions) {
  const Traversal traversal = load({});  // of the front camera, and of odometry, which has the most messages
  ASSERT_EQ(traversal.frames, 20);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_NEAR(traversal.times[i], 1790000000 + .2 * static_cast<double>(i), 1e-6);
    EXPECT_NEAR(traversal.positions[i], .5 * static_cast<double>(i), 1e-5);
    const cv::Mat picture = picture_of(traversal, static_cast<int>(i));
    EXPECT_EQ(picture.size(), cv::Size(64, 48));
    EXPECT_EQ(picture.at<cv::Vec3b>(7, 7),
              cv::Vec3b(128, cv::saturate_cast<uchar>(255 - 10 * i), cv::saturate_cast<uchar>(10 * i)));
  }
  EXPECT_EQ(digest(picture_of(traversal, 0).data, 64 * 48 * 3), "6b622387f9090e71");
  EXPECT_EQ(digest(picture_of(traversal, 19).data, 64 * 48 * 3), "b61ffb6eb0ea66d9");
}

/// Its pictures are taken .02 s, fixes .05 s after each fifth of a second: .85 of the way from one fix to the next.
/// Where the eighth has no fix, the way from the seventh to the ninth is twice as long and takes twice the time.
TEST_P(ForeignBags, GiveTheOtherCameraAndFixes) {
  const Traversal traversal = load({{"camera", 2}, {"position", 1}});
  ASSERT_EQ(traversal.frames, 20);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_NEAR(traversal.times[i], 1790000000.02 + .2 * static_cast<double>(i), 1e-6);
    EXPECT_NEAR(traversal.latitude[i], 48.2, 1e-9);
    EXPECT_NEAR(traversal.longitude[i], 11.5 + .5 * std::max(0., static_cast<double>(i) - .15) / 74200, 1e-9);
  }
  Bytes bytes;
  traversal.images->read(0, bytes);
  EXPECT_EQ(digest(bytes.data(), bytes.size()), "7a2728a4b6b4bb0a");
  traversal.images->read(19, bytes);
  EXPECT_EQ(digest(bytes.data(), bytes.size()), "ba0475342baae1e9");
  EXPECT_NEAR(load({{"stamp", 1}}).times[1], 1790000000.212, 1e-6);
}

/// A message in CDR of either byte order.
struct BagSample {
  std::string topic, type;
  std::int64_t time;  ///< of the recorder, milliseconds
  bool big = false;
  std::string data = {};

  template <class Number>
  BagSample& number(Number value) {
    data.resize((data.size() + sizeof value - 1) / sizeof value * sizeof value);  // both are multiples without the head
    std::string part(reinterpret_cast<const char*>(&value), sizeof value);
    data += big ? std::string(part.rbegin(), part.rend()) : part;
    return *this;
  }
  BagSample& text(const std::string& value) {
    number(static_cast<std::uint32_t>(value.size()));
    data += value;
    return *this;
  }
  /// `stamp`: milliseconds.
  BagSample& header(int stamp) {
    return number(stamp / 1000).number(stamp % 1000 * 1'000'000).text(std::string("front\0", 6));
  }
  std::string bytes() const { return std::string({0, static_cast<char>(!big), 0, 0}) + data; }
};

BagSample image(int stamp, const std::string& pixels, bool big = false, unsigned width = 2,
                const std::string& topic = "/camera", const std::string& encoding = "rgb8") {
  BagSample sample{topic, "sensor_msgs/msg/Image", stamp + 5, big};
  sample.header(stamp).number(1u).number(width).text(encoding + '\0').number('\0').number(3 * width).text(pixels);
  return sample;
}
BagSample pose(int stamp, double x, double y, bool big = false) {
  BagSample sample{"/pose", "geometry_msgs/msg/PoseStamped", stamp + 1, big};
  sample.header(stamp).number(x).number(y);
  for (int i = 0; i < 5; ++i) sample.number(0.0);
  return sample;
}
BagSample fix(int stamp, char status, double latitude, double longitude) {
  BagSample sample{"/fix", "sensor_msgs/msg/NavSatFix", stamp + 1};
  sample.header(stamp).number(status).number(std::uint16_t{1}).number(latitude).number(longitude);
  for (int i = 0; i < 10; ++i) sample.number(0.0);
  return sample.number('\0');
}

void write_bag_mcap(const std::string& path, const std::vector<BagSample>& samples, bool close = true) {
  McapWriter writer(path, {"test", {}, 100, 1'000'000'000, "ros2"});
  std::map<std::string, std::uint16_t> channels;
  for (const BagSample& one : samples) {
    std::uint16_t& channel = channels[one.topic];
    if (channel == 0) channel = writer.add({one.topic, one.type, "ros2msg", "", "cdr"});
    const std::string bytes = one.bytes();
    writer.write(channel, static_cast<std::uint64_t>(one.time) * 1'000'000, std::as_bytes(std::span(bytes)));
  }
  close ? writer.close() : writer.flush();
}

/// Writes the tables of rosbag2's first versions.
void write_bag_db3(const std::string& path, const std::vector<BagSample>& samples) {
  SQLite::Database database(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  database.exec("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT UNIQUE, type TEXT, serialization_format TEXT)");
  database.exec("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)");
  for (const BagSample& one : samples) {
    database.exec("INSERT OR IGNORE INTO topics VALUES (NULL, '" + one.topic + "', '" + one.type + "', 'cdr')");
    SQLite::Statement insert(database, "INSERT INTO messages SELECT NULL, id, ?, ? FROM topics WHERE name = ?");
    insert.bind(1, one.time * 1'000'000);
    const std::string bytes = one.bytes();
    insert.bind(2, bytes.data(), static_cast<int>(bytes.size()));
    insert.bind(3, one.topic);
    insert.exec();
  }
}

class Rosbag2 : public ::testing::Test {
 protected:
  std::unique_ptr<Dataset> bags(const Values& options = {}) const {
    return make_dataset("rosbag2", folder_.path(), options);
  }
  std::string error_of_loading(const std::string& name, const Values& options = {}) const {
    return error_of([&] { bags(options)->load(name); });
  }
  Folder folder_;
  const std::string red_blue_{"\xff\0\0\0\0\xff", 6}, green_{"\0\x80\0\0\x80\0", 6};
};

/// Frames come in the order of their stamps. Positions: 3 and 4 m along x and y, from one second to the next.
TEST_F(Rosbag2, BothByteOrdersAndStorages) {
  for (const bool big : {false, true}) {
    const std::vector<BagSample> samples = {image(11'000, green_, big), image(10'000, red_blue_, big),
                                            pose(10'000, 1, 2, big), pose(11'000, 4, 6, big)};
    big ? write_bag_db3(folder_ / "drive.db3", samples) : write_bag_mcap(folder_ / "drive.mcap", samples);
    const auto dataset = bags();
    const Traversal traversal = dataset->load(big ? "drive.db3" : "drive");  // both are there then
    EXPECT_EQ(traversal.times, (std::vector<double>{10, 11}));
    EXPECT_EQ(traversal.positions, (std::vector<float>{0, 5}));
    EXPECT_EQ(traversal.x, (std::vector<double>{1, 4}));
    EXPECT_EQ(picture_of(traversal, 0).at<cv::Vec3b>(0, 0), cv::Vec3b(0, 0, 255));
    EXPECT_EQ(picture_of(traversal, 0).at<cv::Vec3b>(0, 1), cv::Vec3b(255, 0, 0));
    EXPECT_EQ(picture_of(traversal, 1).at<cv::Vec3b>(0, 0), cv::Vec3b(0, 128, 0));
    EXPECT_EQ(dataset->correspondence(), Correspondence::kDistance);
    EXPECT_EQ(traversal.images->name(1), std::string(big ? "drive.db3" : "drive.mcap") + ", frame 1 of /camera");
  }
  EXPECT_EQ(bags()->names(), (Lines{"drive.db3", "drive.mcap"}));
}

TEST_F(Rosbag2, AStampOfAnotherDayIsLeftOutWithAWord) {
  std::vector<BagSample> samples;
  for (int i = 0; i < 5; ++i) {
    samples.push_back(image((i == 1 ? 96'400'000 : 10'000'000) + 1000 * i, red_blue_));
    samples.push_back(pose((i == 3 ? 1000 : 10'000'000) + 1000 * i, i, 0));
    for (BagSample* sample : {&samples.end()[-2], &samples.end()[-1]}) sample->time = 1000 * (i + 1);
  }
  write_bag_mcap(folder_ / "a.mcap", samples);
  const auto dataset = bags();
  const Traversal traversal = dataset->load("a");
  EXPECT_EQ(traversal.times, (std::vector<double>{10'000, 10'002, 10'003, 10'004}));
  EXPECT_EQ(traversal.x, (std::vector<double>{0, 2, 3, 4}));
  const std::string why = " not taken: each is stamped an hour or more from all others (see --rosbag2-stamp)";
  ASSERT_EQ(dataset->left_out("a").faults.size(), 2u);
  EXPECT_TRUE(contains(dataset->left_out("a").faults[0], "1 of /camera (sensor_msgs/msg/Image, 5 messages)" + why));
  EXPECT_TRUE(
      contains(dataset->left_out("a").faults[1], "1 of /pose (geometry_msgs/msg/PoseStamped, 5 messages)" + why));
  EXPECT_EQ(bags({{"stamp", 1}})->load("a").frames, 5);
}

/// Stamps of a bag that was played twice, of a driver that stamps nothing anew, and of a clock that runs backwards in
/// small steps, would mix up frames and places.
TEST_F(Rosbag2, StampsThatGoBackOrStandAreRefused) {
  for (const auto& [name, stamps] : std::map<std::string, std::vector<int>>{{"a", {10'000, 10'000, 10'000, 10'000}},
                                                                            {"b", {10'000, 11'000, 12'000, 10'000}},
                                                                            {"c", {10'900, 10'500, 10'100, 9'700}}}) {
    std::vector<BagSample> samples;
    for (int i = 0; i < 4; ++i) {
      samples.push_back(image(stamps[static_cast<std::size_t>(i)], red_blue_));
      samples.back().time = 10'000 + 1000 * i;
    }
    write_bag_mcap(folder_ / (name + ".mcap"), samples);
    EXPECT_TRUE(contains(error_of_loading(name), name + ".mcap: /camera: its messages' stamps go back or stand still"));
    EXPECT_EQ(bags({{"stamp", 1}})->load(name).times, (std::vector<double>{10, 11, 12, 13}));
  }
}

TEST_F(Rosbag2, PicturesOfAnotherCameraOnTheTopicAreLeftOutWithAWord) {
  std::vector<BagSample> samples = {image(10'000, red_blue_), image(10'500, green_), image(11'000, red_blue_)};
  samples[1].data.replace(samples[1].data.find("front"), 5, "right");
  write_bag_mcap(folder_ / "a.mcap", samples);
  const auto dataset = bags();
  EXPECT_EQ(dataset->load("a").times, (std::vector<double>{10, 11}));
  EXPECT_EQ(dataset->left_out("a").faults,
            Lines{"1 of /camera (sensor_msgs/msg/Image, 3 messages) not taken: each is in frame 'right', others in "
                  "'front'"});
}

TEST_F(Rosbag2, NoFixIsNoPosition) {
  std::vector<BagSample> samples = {fix(10'000, 0, 48, 11), fix(11'000, -1, std::nan(""), std::nan("")),
                                    fix(12'000, -1, 0, 0), fix(13'500, 0, 48.00001, 11)};
  for (int i = 0; i < 5; ++i) samples.push_back(image(10'000 + 1000 * i, red_blue_));
  write_bag_mcap(folder_ / "a.mcap", samples);
  const auto dataset = bags();
  const Traversal traversal = dataset->load("a");
  EXPECT_EQ(traversal.latitude[0], 48);
  EXPECT_NEAR(traversal.latitude[1], 48 + .00001 / 3.5, 1e-12);
  EXPECT_TRUE(std::isnan(traversal.latitude[2]));  // 2 s after the first, 1.5 s before the last
  EXPECT_EQ(traversal.latitude[4], 48.00001);
  EXPECT_EQ(dataset->correspondence(), Correspondence::kGps);
  EXPECT_EQ(dataset->left_out("a").on_purpose,
            Lines{"2 of /fix (sensor_msgs/msg/NavSatFix, 4 messages) not taken: each has no fix"});
}

TEST_F(Rosbag2, SimulatorsDriveAtNullIsland) {
  std::vector<BagSample> samples;
  for (int i = 0; i < 5; ++i) {
    samples.push_back(fix(10'000 + 1000 * i, 0, 0.0002 * (i - 1), 0));
    samples.push_back(image(10'000 + 1000 * i, red_blue_));
  }
  write_bag_mcap(folder_ / "a.mcap", samples);
  const Traversal traversal = bags()->load("a");
  EXPECT_EQ(traversal.latitude[1], 0);
  EXPECT_NEAR(traversal.positions[4], 0.0008 * 111195.08, 0.01);
  EXPECT_EQ(traversal.places_from, "/fix");
}

TEST_F(Rosbag2, PartsAndMetadata) {
  std::filesystem::create_directory(folder_ / "lap");
  write_bag_mcap(folder_ / "lap/lap_0.mcap", {image(10'000, red_blue_), image(11'000, green_)});
  write_bag_db3(folder_ / "lap/lap_1.db3", {image(12'000, green_), {"/chatter", "std_msgs/msg/String", 1}});
  {  // The picture as a frame of zstd, by its specification: one block that is stored.
    const std::string bytes = image(12'000, green_).bytes();
    std::string frame("\x28\xb5\x2f\xfd\x20", 5);
    frame += std::string({static_cast<char>(bytes.size()), static_cast<char>(bytes.size() << 3 | 1),
                          static_cast<char>(bytes.size() >> 5), 0}) +
             bytes;
    SQLite::Database database(folder_ / "lap/lap_1.db3", SQLite::OPEN_READWRITE);
    SQLite::Statement update(database, "UPDATE messages SET data = ? WHERE id = 1");
    update.bind(1, frame.data(), static_cast<int>(frame.size()));
    update.exec();
  }
  EXPECT_EQ(bags()->load("lap").frames, 3);
  EXPECT_EQ(make_dataset("rosbag2", folder_ / "lap")->names(), Lines{"lap"});  // itself

  const auto metadata = [&](const std::string& more) {
    make_file(folder_ / "lap/metadata.yaml", "rosbag2_bagfile_information:\n  version: 9\n  " + more);
  };
  const auto dataset = bags();
  metadata(
      "relative_file_paths: [lap/lap_0.mcap, lap_1.db3]\n  message_count: 5\n  compression_mode: MESSAGE\n"
      "  compression_format: zstd\n");
  EXPECT_EQ(picture_of(dataset->load("lap"), 2).at<cv::Vec3b>(0, 0), cv::Vec3b(0, 128, 0));
  EXPECT_EQ(dataset->left_out("lap").faults, Lines{"lap: 4 messages are there, metadata.yaml counts 5"});
  EXPECT_EQ(dataset->left_out("lap").on_purpose,
            Lines{"/chatter (std_msgs/msg/String, 1 message): messages that are not read"});
  metadata("relative_file_paths: [lap_0.mcap, lap_2.mcap]\n");
  EXPECT_EQ(dataset->load("lap").frames, 2);
  EXPECT_EQ(dataset->left_out("lap").faults, Lines{"lap: lap_2.mcap is missing, which metadata.yaml names"});
  metadata("relative_file_paths: [\n");
  EXPECT_TRUE(holds(error_of_loading("lap"), "lap/metadata.yaml, line "));
  metadata("compression_mode: message\n  compression_format: lz9\n");
  EXPECT_TRUE(holds(error_of_loading("lap"), "has compression_format 'lz9'; zstd is known"));
}

TEST_F(Rosbag2, UnfinishedBagsGiveWhatIsThere) {
  std::vector<BagSample> samples;
  for (int i = 0; i < 5; ++i) samples.push_back(image(10'000 + 1000 * i, red_blue_));
  write_bag_mcap(folder_ / "a.mcap", samples, false);
  const auto dataset = bags();
  EXPECT_EQ(dataset->load("a").frames, 5);
  ASSERT_EQ(dataset->left_out("a").faults.size(), 1u);
  EXPECT_TRUE(contains(dataset->left_out("a").faults[0], "a.mcap: cut short after "));
  std::filesystem::resize_file(folder_ / "a.mcap", std::filesystem::file_size(folder_ / "a.mcap") - 60);
  EXPECT_EQ(dataset->load("a").frames, 4);

  for (int i = 0; i < 40; ++i) samples.push_back({"/scan", "some/msg/Scan", 1, false, std::string(4000, 'x')});
  write_bag_db3(folder_ / "b.db3", samples);
  std::filesystem::resize_file(folder_ / "b.db3", 65'536);
  const Log log;
  EXPECT_EQ(dataset->load("b").frames, 5);
  EXPECT_TRUE(log.has("b.db3: cannot be read as a bag: database disk image is malformed"));
}

TEST_F(Rosbag2, TopicsAreChosen) {
  write_bag_mcap(folder_ / "a.mcap",
                 {image(10'000, green_), image(11'000, green_), image(10'500, green_, false, 2, "/b"),
                  image(10'600, green_, false, 2, "/b"), image(10'700, green_, false, 2, "/b")});
  const Log log;
  EXPECT_EQ(bags()->load("a").frames, 3);
  EXPECT_TRUE(
      log.has("a.mcap: takes /b; --rosbag2-camera chooses of 1: /b (sensor_msgs/msg/Image, 3 messages), 2: "
              "/camera (sensor_msgs/msg/Image, 2 messages)"));
  EXPECT_EQ(bags({{"camera", 2}})->load("a").times, (std::vector<double>{10, 11}));
  EXPECT_NEAR(bags({{"stamp", 1}})->load("a").times[0], 10.505, 1e-9);
  EXPECT_TRUE(holds(error_of_loading("a", {{"camera", 3}}), "has 2 topics for --rosbag2-camera 3 (1: /b "));
}

TEST_F(Rosbag2, WrongInputs) {
  BagSample cut = image(12'000, red_blue_), absurd = cut;
  cut.data.pop_back();
  absurd.data.replace(absurd.data.size() - 10, 4, "\xff\xff\xff\x7f");
  write_bag_mcap(folder_ / "a.mcap", {image(10'000, red_blue_), image(11'000, green_, false, 2, "/camera", "rgb565"),
                                      cut, absurd, image(14'000, "", false, 0), image(15'000, "12")});
  const auto dataset = bags();
  const Traversal traversal = dataset->load("a");
  ASSERT_EQ(traversal.frames, 4);
  EXPECT_EQ(traversal.images->fault(0), "");
  EXPECT_TRUE(contains(traversal.images->fault(1), "has encoding 'rgb565'; known: "));
  EXPECT_EQ(traversal.images->fault(2), "has 0 x 1 pixels of rgb8");
  EXPECT_EQ(traversal.images->fault(3), "has 2 bytes, 6 a row; 1 rows of at least 6 are wanted");
  EXPECT_EQ(dataset->left_out("a").faults, Lines{"2 of /camera (sensor_msgs/msg/Image, 6 messages) not taken: each is "
                                                 "shorter than its lengths say, or of another type"});

  write_bag_mcap(folder_ / "none.mcap", {pose(10'000, 1, 2)});
  EXPECT_EQ(error_of_loading("none"),
            folder_ / "none.mcap" +
                ": has no pictures: sensor_msgs/msg/Image or CompressedImage (its topics are /pose "
                "(geometry_msgs/msg/PoseStamped, 1 message))");
  write_bag_mcap(folder_ / "unstamped.mcap", {image(0, green_), image(0, green_)});
  EXPECT_TRUE(holds(error_of_loading("unstamped"), "not taken: each has no stamp (--rosbag2-stamp 1 takes the "));
  make_file(folder_ / "empty.mcap", "");
  EXPECT_EQ(error_of_loading("empty"), folder_ / "empty.mcap: is empty");
  make_file(folder_ / "text.db3", "id,time");
  EXPECT_TRUE(holds(error_of_loading("text"), "text.db3: is neither MCAP nor SQLite"));
  SQLite::Database(folder_ / "other.db3", SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec("CREATE TABLE t(a)");
  EXPECT_TRUE(holds(error_of_loading("other"), "other.db3: cannot be read as a bag: no such table: messages"));
  McapWriter(folder_ / "own.mcap", {"test", {}}).close();  // a recording of agents
  EXPECT_EQ(bags()->names(), (Lines{"a", "empty", "none", "other", "text", "unstamped"}));
  EXPECT_EQ(recognised(folder_.path()), Lines{"rosbag2"});
  write_grey(folder_ / "summer/1.png", 1);  // a recording of another kind, which may have a metadata.yaml too
  make_file(folder_ / "summer/metadata.yaml", "");
  EXPECT_EQ(bags()->names().size(), 6u);
  EXPECT_EQ(recognised(folder_.path()).front(), "plain");
}

}  // namespace
}  // namespace citylearn::testing
