// SPDX-License-Identifier: Apache-2.0
// Which files are a traversal's pictures, and in which order: right values are by hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "env_service/files/files.h"
#include "tests/support/files.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Names = std::vector<std::string>;

/// The result of pictures_in() for files with these names: in its order, or the Error's line.
struct Listing {
  explicit Listing(const Names& names) {
    const Folder folder;
    for (const std::string& name : names) make_file(folder / name, "x");
    error = error_of([&] { files = pictures_in(folder.path()); });
  }
  Names files;
  std::string error;
};

TEST(Pictures, NumbersAreSortedAsNumbers) {
  const std::vector<Names> orders{
      {"1700000000.0.png", "1700000000.25.png", "1700000000.5.png", "1700000000.75.png", "1700000001.0.png"},
      {"9.5.jpg", "10.25.JPG", "10.5.jpg", "100.jpg"},
      {"left_9.75.png", "left_10.5.png", "left_10.75.png", "left_11.png"},
      {"9.5_left.png", "10.25_left.png", "10.5_left.png"},
      {"5e-05.png", "0.0001.png", "0.25.png", "0.5.png", "1e+16.png"},
      {"-10.png", "-9.5.png", "-2.png", "3.png", "20.png"},
      {"frame_-10.png", "frame_-9.png", "frame_4.png"},
      {"1700000000.123456788.png", "1700000000.123456789.png", "1700000000.2.png"},
      {"img-9.png", "img-10.png", "img-11.png"},
      {"img.9.png", "img.10.png", "img.11.png"},
      {"cam1_9.png", "cam1_010.png", "cam1_11.png", "cam2_1.png"},
      {"2024-01-02_9-11-12.png", "2024-01-02_10-01-02.png", "2024-02-01_0-0-0.png"},
      {"img_8.png", "IMG_9.PNG", "img_10.png", "IMG_11.JPG"},
      {"a.png", "b.png", "c.png"}};
  for (const Names& order : orders) {
    Names given = order;
    std::reverse(given.begin(), given.end());
    EXPECT_EQ(Listing(given).files, order) << Listing(given).error;
  }
}

TEST(Pictures, OtherKindsAreNotLeftOut) {
  EXPECT_TRUE(contains(Listing({"0.jpg", "1.tif", "2.WEBP", "3.jpg"}).error,
                       ": has pictures of kinds that are not read: 1.tif and 1 more (convert"));
  EXPECT_EQ(Listing({"0.heic", "0.jpg", "1.HEIC"}).files, (Names{"0.jpg", "1.HEIC"}));
  // Raw beside its JPEG is the same picture; AppleDouble, thumbnails and notes are no pictures.
  EXPECT_EQ(Listing({"0.jpg", "0.dng", "1.jpg", "1.heic", "._0.tif", "Thumbs.db", "0.xmp", "notes.txt"}).files,
            (Names{"0.jpg", "1.jpg"}));
  EXPECT_TRUE(contains(Listing({"0.jpg", "0.png", "1.jpg"}).error, ": 0.jpg and 0.png have one name"));
}

TEST(Pictures, ACounterThatWrappedIsRefused) {
  for (const Names& names : {Names{"IMG_9998.JPG", "IMG_9999.JPG", "IMG_0001.JPG", "IMG_0002.JPG"},
                             Names{"IMG_9997.JPG", "IMG_9999.JPG", "IMG_0000.JPG", "IMG_0001.JPG"},
                             Names{"DJI_0990.JPG", "DJI_0999.JPG", "DJI_0001.JPG", "DJI_0012.JPG"}}) {
    const std::string error = Listing(names).error;
    EXPECT_TRUE(contains(error, "the counter seems to have begun anew: " + names[2] + " would come before " + names[0]))
        << error;
    EXPECT_TRUE(contains(error, "as " + names[2].substr(4, 4) + " to 1" + names[2].substr(4, 4))) << error;
  }
  for (const auto& [names, renaming] :
       std::map<Names, std::string>{{{"00.jpg", "01.jpg", "95.jpg", "99.jpg"}, "as 00 to 100"},
                                    {{"IMG_0.jpg", "IMG_1.jpg", "IMG_9998.jpg", "IMG_9999.jpg"}, "as 0 to 10000"},
                                    {{"0.jpg", "1.jpg", "65534.jpg", "65535.jpg"}, "as 0 to 100000"},
                                    {{"3.jpg", "4294967294.jpg", "4294967295.jpg"}, "as 3 to 10000000003"}})
    EXPECT_TRUE(contains(Listing(names).error, renaming)) << Listing(names).error;
  for (const Names& names :
       {Names{"00001.jpg", "00002.jpg", "09998.jpg", "09999.jpg", "10000.jpg"},  // thinned
        Names{"000.jpg", "001.jpg", "002.jpg", "900.jpg", "901.jpg", "1000.jpg"}, Names{"0.jpg", "1.jpg", "99.jpg"},
        Names{"000.jpg", "450.jpg", "900.jpg"}, Names{"IMG_9998.jpg", "IMG_9999.jpg", "IMG_10001.jpg"}})
    EXPECT_EQ(Listing(names).files, names);
}

TEST(Pictures, TimesOrderNames) {
  const auto order = [](const std::map<std::string, double>& times) {
    const Folder folder;
    for (const auto& [name, time] : times) make_file(folder / name, name);
    Names files;
    const std::string error = error_of([&] {
      files = pictures_in(folder.path(), [&](const Names& names) {
        std::vector<double> found;
        for (const std::string& name : names) found.push_back(times.at(name));
        return found;
      });
    });
    return error.empty() ? files : Names{error};
  };
  const double unknown = std::nan("");
  EXPECT_EQ(order({{"c.jpg", 1}, {"a.jpg", 2}, {"b.jpg", 2}}), (Names{"c.jpg", "a.jpg", "b.jpg"}));
  // A counter that wrapped within a second, and one that lacks times but follows those that are told.
  EXPECT_EQ(order({{"I_0001.jpg", 7}, {"I_0000.jpg", 7}, {"I_9999.jpg", 7}, {"I_9998.jpg", 6}}),
            (Names{"I_9998.jpg", "I_9999.jpg", "I_0000.jpg", "I_0001.jpg"}));
  EXPECT_EQ(order({{"I_0001.jpg", 8}, {"I_0000.jpg", unknown}, {"I_9999.jpg", 7}, {"I_9998.jpg", 6}}),
            (Names{"I_9998.jpg", "I_9999.jpg", "I_0000.jpg", "I_0001.jpg"}));
  EXPECT_TRUE(contains(order({{"I_0001.jpg", 8}, {"I_0000.jpg", unknown}, {"I_9999.jpg", 9}, {"I_9998.jpg", 9}})[0],
                       "begun anew"));
  const Log log;
  EXPECT_EQ(order({{"1.jpg", 8}, {"2.jpg", unknown}, {"3.jpg", 7}}), (Names{"1.jpg", "2.jpg", "3.jpg"}));
  EXPECT_TRUE(log.has("1 of 3 pictures have no time")) << log.text();
  EXPECT_EQ(order({{"A04F.jpg", 1}, {"3F2A.jpg", 2}, {"A1C7.jpg", 3}, {"3F0B.jpg", 4}}),
            (Names{"A04F.jpg", "3F2A.jpg", "A1C7.jpg", "3F0B.jpg"}));
  EXPECT_FALSE(log.has("count in two ways")) << "hashes are no counters: " << log.text();
}

TEST(Pictures, CopiesAreLeftOut) {
  const Folder folder;
  for (const std::string name : {"1.jpg", "1 (1).jpg", "1 - Copy.jpg", "1 - Kopie (2).jpg", "2.jpg"})
    make_file(folder / name, name.substr(0, 1));
  make_file(folder / "Copy of 2.jpg", "2");
  make_file(folder / "2 (1).jpg", "other");
  EXPECT_EQ(pictures_in(folder.path()), (Names{"1.jpg", "2 (1).jpg", "2.jpg"}));
}

TEST(Pictures, NumbersThatMayBeTwoAreRefused) {
  EXPECT_TRUE(contains(Listing({"5.9000000.png", "5.100000000.png"}).error, "may be decimals or two counters"));
  EXPECT_EQ(Listing({"5.900000000.png", "5.009000000.png"}).files, (Names{"5.009000000.png", "5.900000000.png"}));
}

TEST(Pictures, TwoCountersAreWarnedOf) {
  const std::vector<std::pair<Names, std::string>> cases{
      {{"DSC_0001.JPG", "DSC_0002.JPG", "DSC_0003.JPG", "IMG_0001.JPG"},
       "two ways, DSC_0001.JPG to IMG_0001.JPG, and are ordered by name"},
      {{"GOPR0001.JPG", "IMG_0001.JPG", "IMG_0002.JPG", "IMG_0003.JPG"}, "two ways, GOPR0001.JPG to IMG_0003.JPG, "},
      {{"0_left.png", "0_right.png", "1_left.png", "1_right.png"}, "two ways, 0_left.png to 1_right.png, "},
      {{"f_001_0.png", "f_001_1.png", "f_002_0.png", "f_002_1.png"}, "two ways, f_001_0.png to f_002_1.png, "},
      {{"cam1_9.png", "cam1_10.png", "cam2_9.png", "cam2_10.png"}, "two ways, cam1_9.png to cam2_10.png, "},
      {{"0_1.png", "0_2.png", "0_3.png", "1_0.png", "1_1.png"}, ""},
      {{"IMG_0001.JPG", "img_0002.jpg", "IMG_0003.JPG", "IMG_0004_HDR.JPG"}, ""},
      {{"cam1_9.png", "cam1_10.png", "cam2_1.png", "cam2_2.png"}, ""}};
  for (const auto& [names, words] : cases) {
    const Log log;
    EXPECT_EQ(Listing(names).files, names);
    EXPECT_EQ(log.has("its pictures count in two ways"), !words.empty()) << log.text();
    EXPECT_TRUE(words.empty() || log.has(words)) << log.text();
  }
}

TEST(Pictures, NamesWithoutAnOrderAreWarnedOf) {
  for (const Names& names :
       {Names{"c4ca4238a0.jpg", "c81e728d9d.jpg", "eccbc87e4b.jpg"},
        Names{"0000635340061525167377.jpg", "0001663341875487337577.jpg", "7003326683750974675154.jpg"},
        Names{"1700000000.jpg", "1700000001000.jpg"}, Names{"at 1.00.00 PM.jpg", "at 10.00.00 AM.jpg"},
        Names{"01-02-2024.jpg", "31-01-2024.jpg"}, Names{"2026-Feb-01.jpg", "2026-Jan-31.jpg"},
        Names{"0x5.jpg", "0x8.jpg", "0x11.jpg", "0x14.jpg", "0xb.jpg"},
        Names{"f_000a.jpg", "f_0007.jpg", "f_0008.jpg", "f_0009.jpg"},
        Names{"@utm@0691230.10@5341670.20@32@U@.jpg", "@utm@0691231.10@5341660.20@32@U@.jpg"}}) {
    const Log log;
    EXPECT_EQ(Listing(names).files.size(), names.size());
    EXPECT_TRUE(log.has("give no order (" + names[0] + ", " + names[1])) << log.text();
  }
}

}  // namespace
}  // namespace citylearn::testing
