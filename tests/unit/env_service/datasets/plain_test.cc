// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/files.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class Plain : public ::testing::Test {
 protected:
  Traversal load(const std::string& text) const {
    make_file(folder_ / "x.csv", text);
    return make_dataset("plain", folder_.path())->load("x");
  }
  /// The one line that loading `text` ends in, less the folder.
  std::string complaint(const std::string& text) const {
    const std::string line = error_of([&] { load(text); });
    EXPECT_FALSE(contains(line, "\n"));
    EXPECT_TRUE(line.starts_with(folder_.path() + "/")) << line;
    return line.substr(std::min(line.size(), folder_.path().size() + 1));
  }

  Folder folder_;
};

TEST_F(Plain, ReadsAFrameALine) {
  const Traversal traversal = load("1,2.5,-3e-2\n4,+5,6\n");
  EXPECT_EQ(traversal.dataset, "plain");
  EXPECT_EQ(traversal.name, "x");
  EXPECT_EQ(traversal.condition, "x");
  EXPECT_EQ(traversal.frames, 2);
  EXPECT_EQ(traversal.dimension, 3);
  EXPECT_EQ(traversal.features, (std::vector<float>{1, 2.5f, -3e-2f, 4, 5, 6}));
  ASSERT_EQ(traversal.positions.size(), 2u);
  EXPECT_TRUE(std::isnan(traversal.positions[0]));
}

TEST_F(Plain, LineEndsAndBlanksDoNotMatter) {
  const std::vector<float> expected{1, 2, 3, 4, 5, 6};
  const std::uint64_t hash = load("1,2\n3,4\n5,6\n").hash();
  for (const std::string text : {"1,2\n3,4\n5,6", "1,2\r\n3,4\r\n5,6\r\n", "1,2\r3,4\r5,6", "1,2\r3,4\r5,6\r",
                                 " 1 ,\t2 \n3, 4\n5,6  \n", "1,2\n3,4\n5,6\n\n\r\n  \n", "\uFEFF1,2\n3,4\n5,6\n"}) {
    const Traversal traversal = load(text);
    EXPECT_EQ(traversal.features, expected) << text;
    EXPECT_EQ(traversal.hash(), hash);
  }
}

TEST_F(Plain, TinyNumbersAreZero) {
  EXPECT_EQ(load("1e-60,1\n-1e-400,0." + std::string(400, '0') + "1\n").features, (std::vector<float>{0, 1, 0, 0}));
}

TEST_F(Plain, FramesThatHaveNoLengthAreTold) {
  const std::string remedy =
      ", with which lengths cannot be computed (multiply the features of all recordings by one number)";
  EXPECT_EQ(complaint("1,2\n2e-42,-1e-42\n"), "x.csv:2: its largest number is 2e-42" + remedy);
  EXPECT_EQ(complaint("1,-3e38\n3,4\n"), "x.csv:1: its largest number is 3e+38" + remedy);
  EXPECT_EQ(load("1,1e-42\n1e15,-1e-15\n").frames, 2);
  const Log log;
  EXPECT_EQ(load("1,2\n0,0\n3,4\n0,-0\n").frames, 4);
  EXPECT_TRUE(log.has("x.csv:2: only zeros; places")) << log.text();
  EXPECT_FALSE(log.has("x.csv: all its frames")) << log.text();
  EXPECT_EQ(load("1,2\n1,2\n1,2\n").frames, 3);
  EXPECT_TRUE(log.has("x.csv: all its frames have the same features")) << log.text();
}

TEST_F(Plain, NamesFileLineAndColumnOfWhatIsWrong) {
  const std::string kOnly = " (features are numbers between commas, without a header or names)";
  EXPECT_EQ(complaint("1,2\n3\n"), "x.csv:2: 1 columns, the lines before have 2");
  EXPECT_EQ(complaint("1,2\r3,4,5\r"), "x.csv:2: 3 columns, the lines before have 2");
  EXPECT_EQ(complaint("1,2\n3,four\n"), "x.csv:2: 'four' in column 2 is not a number" + kOnly);
  EXPECT_EQ(complaint("1,2\n3,4x\n"), "x.csv:2: '4x' in column 2 is not a number" + kOnly);
  EXPECT_EQ(complaint("1 2\n3 4\n"), "x.csv:1: '1 2' in column 1 is not a number" + kOnly);
  EXPECT_EQ(complaint("1;2\n3;4\n"), "x.csv:1: '1;2' in column 1 is not a number" + kOnly);
  EXPECT_EQ(complaint("a,b\n3,4\n"), "x.csv:1: 'a' in column 1 is not a number" + kOnly);
  EXPECT_EQ(complaint("1,2\n3,\n"), "x.csv:2: nothing in column 2" + kOnly);
  EXPECT_EQ(complaint("1,2\n,3\n"), "x.csv:2: nothing in column 1" + kOnly);
  EXPECT_EQ(complaint("1,2\n3,,4\n"), "x.csv:2: nothing in column 2" + kOnly);
  EXPECT_EQ(complaint("1,2\n3,+-4\n"), "x.csv:2: '+-4' in column 2 is not a number" + kOnly);
  EXPECT_EQ(complaint("1,2\nnan,4\n"), "x.csv:2: a number that is not finite in column 1");
  EXPECT_EQ(complaint("1,2\n3,-inf\n"), "x.csv:2: a number that is not finite in column 2");
  EXPECT_EQ(complaint("1,2\n3,1e39\n"), "x.csv:2: a number that is not finite in column 2");
  EXPECT_EQ(complaint("1,2\n3,1e999\n"), "x.csv:2: a number that is not finite in column 2");
  EXPECT_EQ(complaint("1,2\n3," + std::string(400, '9') + "\n"), "x.csv:2: a number that is not finite in column 2");
  EXPECT_EQ(complaint("1,2\n3," + std::string(400, '9') + "e-2\n"), "x.csv:2: a number that is not finite in column 2");
  const std::string comma =
      " begins with 0, as digits behind a comma within a number do (write decimals with a point, "
      "and thousands without a comma)";
  EXPECT_EQ(complaint("0,5488,-0,0715\n0,6,0,7\n"), "x.csv:1: '0715' in column 4" + comma);
  EXPECT_EQ(complaint("1,234\n1,034\n"), "x.csv:2: '034' in column 2" + comma);
  EXPECT_EQ(complaint(""), "x.csv: has no frames");
  EXPECT_EQ(complaint("\n\n"), "x.csv: has no frames");
  EXPECT_EQ(complaint("1,2\n"), "x.csv: has only one frame, a route needs two");
  EXPECT_EQ(complaint("1,2\n\n3,4\n"),
            "x.csv:2: an empty line between frames (remove it, or put the missing frame there)");
  EXPECT_EQ(complaint(std::string("1,2\n3,\0\x1b[2J\n", 12)), "x.csv:2: '??[2J' in column 2 is not a number" + kOnly);
}

/// Tests files as pandas writes them: to_csv(index=False), with the names 0..D-1 of columns; to_csv(header=False), with
/// those of rows.
TEST_F(Plain, HeadersAndIndexesAreNotFeatures) {
  const std::string header = "x.csv:1: numbers the columns (remove this line, as features have no header)";
  EXPECT_EQ(complaint("0,1,2\n0.5,1,2\n3,4,5\n"), header);
  EXPECT_EQ(complaint("1,2\n3.5,4\n5,6.25\n"), header);
  EXPECT_EQ(complaint("0.0,1.0\n3,4.5\n"), header);
  EXPECT_EQ(complaint("0,1,2,3,4,5,6,7\n7,0,3,0,3,0,2,4\n1,1,1,1,1,1,1,1\n"), header);
  const std::string of_pandas = ", not a feature (remove it; of pandas: to_csv(index=False, header=False))";
  EXPECT_EQ(complaint("0,.25\n1,.5\n2,.125\n"), "x.csv: column 1 has the numbers of lines" + of_pandas);
  EXPECT_EQ(complaint("10,.25\n15,.5\n20,.125\n"), "x.csv: column 1 has the numbers of lines" + of_pandas);
  EXPECT_EQ(complaint("1700000000.25,.25\n1700000000.75,.5\n"), "x.csv: column 1 has times" + of_pandas);
  EXPECT_EQ(complaint("7,.5\n6,.1\n5,.2\n4,.9\n3,.5\n2,.4\n1,.3\n0,.2\n"),
            "x.csv: column 1 has the numbers of lines" + of_pandas);
  EXPECT_EQ(complaint("0,.5\n1,.1\n3,.2\n4,.9\n5,.5\n9,.4\n10,.3\n11,.2\n"),
            "x.csv: column 1 has the numbers of lines" + of_pandas);
  EXPECT_EQ(complaint(".5,1\n.1,2\n.2,3\n.9,4\n.5,5\n.4,6\n.3,7\n.2,8\n"),
            "x.csv: column 2 has the numbers of lines" + of_pandas);
  EXPECT_TRUE(contains(complaint(",0,1\n0,.5,.25\n1,.5,.75\n"), "x.csv:1: nothing in column 1 (features are numbers"));
  EXPECT_TRUE(contains(complaint("000.jpg,.5\n001.jpg,.25\n"), "x.csv:1: '000.jpg' in column 1 is not a number"));
  std::string times;
  for (int i = 0; i < 16; ++i) times += std::to_string(.1 * i + .03 * (i % 2)) + "," + std::to_string(i * 7 % 5) + "\n";
  const Log log;
  EXPECT_EQ(load(times).dimension, 2);
  EXPECT_TRUE(log.has("x.csv: column 1 rises or falls evenly, as times do: is it a feature?")) << log.text();
  EXPECT_FALSE(log.has("column 2"));
  for (const std::string text :
       {"0,1\n2,3\n4,5\n", "0\n1\n2.5\n", "0,.5\n1,.5\n3,.5\n", "0,2\n.5,.5\n", "3,.5\n2,.25\n1,.5\n"})
    EXPECT_GT(load(text).frames, 1) << text;
}

TEST_F(Plain, AnyLetterCaseOfSuffixes) {
  make_file(folder_ / "night.CSV", "1,2\n3,4\n");
  make_file(folder_ / "night.Poses.CSV", "metres\n0\n2.5\n");
  const auto dataset = make_dataset("plain", folder_.path());
  EXPECT_EQ(dataset->names(), std::vector<std::string>{"night"});
  EXPECT_EQ(dataset->load("night").positions, (std::vector<float>{0, 2.5f}));
}

TEST_F(Plain, RefusesPlacesInfinitelyFarApart) {
  for (const std::string poses : {"metres\n1e300\n2\n", "x,y\n0,0\n1e308,-1e308\n"}) {
    make_file(folder_ / "x.poses.csv", poses);
    EXPECT_TRUE(contains(error_of([&] { load("1,2\n3,4\n"); }), "'x' has places that are too far apart")) << poses;
  }
}

TEST_F(Plain, RefusesMoreColumnsThanMessagesHold) {
  std::string row = "1";
  for (int i = 1; i < 4096; ++i) row += ",1";
  EXPECT_EQ(load(row + "\n" + row + "\n").dimension, 4096);
  row += ",1\n";
  EXPECT_EQ(complaint(row + row), "x.csv:1: more than 4096 columns");
}

TEST_F(Plain, RefusesMoreFramesThanMessagesHold) {
  std::string text;
  for (unsigned i = 0; i < msg::MAX_FRAMES; ++i) text += "1\n";
  EXPECT_EQ(load(text).frames, static_cast<int>(msg::MAX_FRAMES));
  EXPECT_EQ(complaint(text + "1\n"), "x.csv:1048577: more than 1048576 frames");
}

TEST_F(Plain, ListsTraversalsAndNamesThemWhenOneIsMissing) {
  make_file(folder_ / "night.csv", "1\n2\n");
  make_file(folder_ / "day.csv", "1\n2\n");
  make_file(folder_ / "notes.txt", "hello");
  make_file(folder_ / ".hidden.csv", "1\n2\n");
  std::filesystem::create_directory(folder_ / "folder.csv");
  const auto dataset = make_dataset("plain", folder_.path());
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"day", "night"}));
  for (const std::string name : {"summer", "", "../day", "folder"})
    EXPECT_EQ(error_of([&] { dataset->load(name); }),
              folder_.path() + ": no traversal '" + name + "' (there are: day, night)");
}

TEST_F(Plain, MissingFolder) {
  EXPECT_THROW(make_dataset("plain"), Error);
  const std::string missing = folder_ / "missing";
  EXPECT_EQ(error_of([&] { make_dataset("plain", missing)->names(); }),
            missing + ": No such file or directory (--data names the folder that holds NAME/, NAME.mp4 or NAME.csv)");
  EXPECT_EQ(error_of([&] { make_dataset("plain", folder_.path())->load("x"); }),
            folder_.path() + ": no traversals found; expected NAME/, NAME.mp4 or NAME.csv");
}

TEST_F(Plain, NamesWhatIsThereWhenNothingIsTaken) {
  const auto told = [&](const std::string& file) {
    std::filesystem::remove_all(folder_ / "data");
    make_file(folder_ / ("data/" + file), "x");
    return error_of([&] { make_dataset("plain", folder_ / "data")->load("x"); });
  };
  EXPECT_TRUE(
      contains(told("set/meta/info.json"), "it is a dataset of LeRobot (make recordings of its episodes: python3 -m"));
  EXPECT_TRUE(contains(told("run.bag"), "it is a bag of ROS 1, which is not read (convert it"));
  EXPECT_TRUE(contains(told("day/features.npz"), "it has arrays, which are not read (write each recording as a table"));
  EXPECT_TRUE(contains(told("a/b/c/d/e/1.JPG"), "pictures or films are in a/b/c/d/e (--data names the folder"));
  EXPECT_TRUE(contains(told("a.fit"), "expected NAME/, NAME.mp4 or NAME.csv (files there: 1 .fit)"));
}

TEST(PlainReal, NordlandFeatures) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "nordland-netvlad64");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const auto dataset = make_dataset("plain", folder);
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"fall", "summer"}));
  for (const std::string& name : dataset->names()) {
    const Traversal traversal = dataset->load(name);
    EXPECT_EQ(traversal.frames, 1000);
    EXPECT_EQ(traversal.dimension, 64);
    for (int frame = 0; frame < 1000; ++frame) {
      double sum = 0;
      for (const float value : traversal.feature(frame)) sum += value * value;
      ASSERT_NEAR(sum, 1, 1e-3) << name << " frame " << frame;
    }
  }
}

}  // namespace
}  // namespace citylearn::testing
