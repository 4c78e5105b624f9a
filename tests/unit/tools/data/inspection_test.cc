// SPDX-License-Identifier: Apache-2.0
#include "tools/data/inspection.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/util/random.h"
#include "tests/paths.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const auto kOn = [](long, long) { return true; };

/// A command of the program, its status and what it says among others.
struct Said {
  Arguments arguments;
  int status;
  const char* text;
};
void expect_said(const std::vector<Said>& all) {
  const Folder logs;
  for (const auto& [arguments, status, text] : all) {
    Service program(Arguments{CITYLEARN_DATA} + arguments, logs / "log");
    EXPECT_EQ(program.wait(seconds(30)), status) << program.output();
    EXPECT_TRUE(contains(program.output(), text)) << program.output();
  }
}

/// Traversals "day" (5 pictures) and "night" (3 pictures).
void write_drives(const Folder& folder) {
  for (int i = 0; i < 5; ++i) write_grey(folder / ("day/" + std::to_string(i) + ".png"), 10 * i);
  for (int i = 0; i < 3; ++i) write_grey(folder / ("night/" + std::to_string(i) + ".png"), 10 * i);
}

TEST(Inspection, RecognisesFolders) {
  const Folder folder;
  EXPECT_TRUE(recognised(folder.path()).empty());
  EXPECT_TRUE(recognised(folder / "missing").empty());
  write_drives(folder);
  EXPECT_EQ(recognised(folder.path()), std::vector<std::string>{"plain"});
  // Seasons of one's own come first as what plain reads; what only Nordland has makes it Nordland.
  std::filesystem::rename(folder / "day", folder / "Summer");
  EXPECT_EQ(recognised(folder.path()), (std::vector<std::string>{"plain", "nordland"}));
  make_file(folder / "Summer.poses.csv", "lat,lon\n1,2\n");
  EXPECT_EQ(recognised(folder.path()).front(), "plain");
  make_file(folder / "gpsData/summer.csv", "tid,lat,lon\n5595900,6300000,1000000\n");
  EXPECT_EQ(recognised(folder.path()), (std::vector<std::string>{"nordland", "plain"}));
  make_file(folder / "Summer.mp4", "x");  // one name twice is refused, not read as Nordland
  std::filesystem::remove_all(folder / "gpsData");
  EXPECT_EQ(recognised(folder.path()).front(), "plain");
  for (const std::string own : {"260815_0845", "Gold_Coast_1", "highway_1"}) {
    const Folder other;
    for (int i = 0; i < 3; ++i) write_grey(other / (own + "/" + std::to_string(i) + ".png"), 10 * i);
    EXPECT_EQ(recognised(other.path()).front(), "plain") << own;
  }
}

TEST(Inspection, DescribesAMapOfStreets) {
  const Folder folder;
  make_file(folder / "nodes.txt", "a,0,0,0\nb,0,0,0.001\n");
  make_file(folder / "links.txt", "a,90,b\nb,270,a\n");
  for (const std::string name : {"day.csv", "night.csv"})
    make_file(folder / name, "1.5," + std::to_string(name.size()) + "\n3,5\n");
  const auto inspected = [&] { return inspect(*make_dataset("plain", folder.path()), folder.path(), kOn); };
  const Inspection found = inspected();
  EXPECT_EQ(found.notes,
            std::vector<std::string>{"streets: places 2, links 2, junctions 0, dead ends 2, one-way links 0"});
  EXPECT_TRUE(found.faults.empty() && found.not_taken.empty() && found.left_out.empty());
  make_file(folder / "links.txt", "a,90,b\nb,270,c\n");
  ASSERT_EQ(inspected().faults.size(), 2u);
  EXPECT_TRUE(holds(inspected().faults[0].what, "links.txt:2: id c is not in nodes.txt"));
  for (const char* name : {"nodes.txt", "links.txt"}) std::filesystem::remove(folder / name);
  make_file(folder / "town.osm", "<osm version='0.6'/>");
  ASSERT_EQ(inspected().faults.size(), 1u);
  EXPECT_TRUE(holds(inspected().faults[0].what, "town.osm: has no streets on which cars can go there and back"));
  make_file(folder / "town.osm",
            "<osm version='0.6'><node id='1' lat='0' lon='0'/><node id='2' lat='0' lon='.0001'/><way id='1'>"
            "<nd ref='1'/><nd ref='2'/><tag k='highway' v='road'/></way></osm>");
  EXPECT_EQ(inspected().notes,
            (std::vector<std::string>{"streets of town.osm: ways for cars 1, nodes 2",
                                      "streets: places 2, links 2, junctions 0, dead ends 2, one-way links 0",
                                      "streets: 2 links, shown by none; without positions: day, night"}));
  EXPECT_TRUE(inspected().faults.empty() && inspected().not_taken.empty());
}

TEST(Inspection, SaysWhereARecordingMeetsItself) {
  // Round a square of 40 m with a frame every 10 m; frames 16 and 17 are where 0 and 1 were, (3, 0) and (13, 0).
  const Folder folder;
  make_file(
      folder / "day.poses.csv",
      "x,y\n3,0\n13,0\n23,0\n33,0\n40,3\n40,13\n40,23\n40,33\n37,40\n27,40\n17,40\n7,40\n0,37\n0,27\n0,17\n0,7\n3,0\n"
      "13,0\n");
  std::string rows;
  for (int row = 0; row < 18; ++row) rows += std::to_string(row) + ",1\n";
  make_file(folder / "day.csv", rows);
  const auto notes = [&] { return inspect(*make_dataset("plain", folder.path()), folder.path(), kOn).notes; };
  ASSERT_EQ(notes().size(), 2u);
  EXPECT_TRUE(notes()[0].starts_with(
      "day: streets: places 16, links 16, junctions 0, dead ends 0, one-way links 16; frames left out: 2, of which 0"));
  EXPECT_EQ(notes()[1], "day: streets: frames 16 to 17 run along frames 0 to 1 (28 degrees)");  // atan(7 / 13)
  make_file(folder / "day.poses.csv", "frame,x,y\n0,0,0\n1,10,0\n2,20,0\n");
  EXPECT_TRUE(notes().empty());
}

TEST(Inspection, ReadsMatches) {
  const Folder folder;
  write_drives(folder);
  for (const auto& [matches, wrong] : std::map<std::string, std::string>{
           {"day,night\n0,0\n4,2\n", ""},
           {"day,night\n0,0\n4,3\n", "the match of frames 4 and 3 is beyond day (5 frames) or night (3 frames)"},
           {"0,0\n4,2\n", "matches.csv: no column 'day'"},
           {"day,night\n0,0,0\n", "matches.csv:2: has 3 fields, the header names 2"}}) {
    make_file(folder / "matches.csv", matches);
    const Inspection found = inspect(*make_dataset("plain", folder.path()), folder.path(), kOn);
    EXPECT_EQ(found.faults.size(), wrong.empty() ? 0u : 1u) << matches;
    for (const Fault& fault : found.faults) EXPECT_TRUE(contains(fault.what, wrong)) << fault.what;
  }
}

TEST(Inspection, TellsOfPicturesThatAreAlmostBlackOrOfAnotherSize) {
  const Folder folder;
  std::filesystem::create_directory(folder / "day");
  for (const std::string name : {"day/0.png", "day/1.png"})
    cv::imwrite(folder / name, cv::Mat(24, 32, CV_16UC1, cv::Scalar(4000)));
  const auto notes = inspect(*make_dataset("plain", folder.path()), folder.path(), kOn).notes;
  ASSERT_EQ(notes.size(), 1u);  // 4000 of 65535 are 15 of 255
  EXPECT_TRUE(notes[0].starts_with("day: all 2 pictures are almost black")) << notes[0];
  cv::imwrite(folder / "day/2.png", cv::Mat(32, 48, CV_8UC1, cv::Scalar(200)));
  EXPECT_EQ(inspect(*make_dataset("plain", folder.path()), folder.path(), kOn).notes,
            std::vector<std::string>{"day: has pictures of 2 sizes, as 32x24 and 48x32: are some of another camera?"});
}

TEST(Inspection, ListsWhatIsNotTaken) {
  const Folder folder;
  write_drives(folder);
  const auto inspected = [&] { return inspect(*make_dataset("plain", folder.path()), folder.path(), kOn); };
  // What belongs to other things is no loss.
  for (const std::string file : {"notes.md", "matches.csv", "day.poses.csv", "day/Thumbs.db", "day/.DS_Store",
                                 "day/._0.png", "day/0.xmp", "day/1.json", "day/2.dng", ".cache/x.png"})
    make_file(folder / file, file == std::string("day.poses.csv") ? "frame,metres\n0,1\n"
                             : file == std::string("matches.csv") ? "day,night\n0,0\n4,2\n"
                                                                  : "x");
  EXPECT_TRUE(inspected().faults.empty() && inspected().not_taken.empty());
  EXPECT_TRUE(inspected().left_out.empty());
  make_file(folder / "readme.txt", "x");
  EXPECT_TRUE(inspected().faults.empty() && inspected().not_taken.empty());
  EXPECT_EQ(inspected().left_out, std::vector<std::string>{"1 .txt files, the first readme.txt"});
  for (const std::string file : {"day/more/9.JPG", "day/more/8.jpg", "dusk.npy", "night/film.mkv", "Day.poses.csv"})
    make_file(folder / file, "x");
  std::filesystem::create_directory(folder / "dawn");
  std::vector<std::string> lines;
  for (const Fault& fault : inspected().faults) lines.push_back(fault.traversal + ": " + fault.what);
  for (const std::string& kind : inspected().not_taken) lines.push_back("not taken: " + kind);
  EXPECT_EQ(lines, (std::vector<std::string>{"not taken: 2 .jpg files, the first day/more/8.jpg",
                                             "not taken: 1 .mkv files, the first night/film.mkv",
                                             "not taken: 1 .npy files, the first dusk.npy",
                                             "not taken: 1 .poses.csv files, the first Day.poses.csv",
                                             "not taken: 1 empty folders, the first dawn"}));
}

TEST(Inspection, FilesOfADatabaseBelongToIt) {
  const Folder folder;
  write_drives(folder);
  const auto left_out = [&] { return inspect(*make_dataset("plain", folder.path()), folder.path(), kOn).left_out; };
  for (const std::string file : {"LOCK", "LOG", "MANIFEST-000004", "000007.log"}) make_file(folder / file, "x");
  EXPECT_EQ(left_out(), std::vector<std::string>{"3 files without a suffix, the first LOCK"});
  make_file(folder / "CURRENT", "MANIFEST-000004\n");
  EXPECT_TRUE(left_out().empty());
}

TEST(Inspection, NotesUnequalNumbersOfFrames) {
  const Folder folder;
  write_drives(folder);
  make_file(folder / "other.gpx", "<gpx/>");
  const Inspection found = inspect(*make_dataset("plain", folder.path()), folder.path(), kOn);
  ASSERT_EQ(found.notes.size(), 1u);
  EXPECT_TRUE(found.notes[0].starts_with("night has 3 frames and day 5: frames of equal index")) << found.notes[0];
  EXPECT_TRUE(found.faults.empty());
  EXPECT_EQ(found.not_taken, std::vector<std::string>{"1 .gpx files, the first other.gpx"});
}

TEST(Inspection, ComparesTables) {
  const Folder folder;
  std::string forwards, backwards;
  for (int i = 0; i < 60; ++i) {
    Random random(static_cast<std::uint64_t>(i));
    std::string row;
    for (int column = 0; column < 8; ++column) row += (column > 0 ? "," : "") + std::to_string(random.uniform());
    forwards += row + "\n";
    backwards = row + "\n" + backwards;
  }
  make_file(folder / "summer.csv", forwards);
  make_file(folder / "winter.csv", backwards);
  const auto inspected = [&] { return inspect(*make_dataset("plain", folder.path()), folder.path(), kOn); };
  ASSERT_EQ(inspected().notes.size(), 1u);
  EXPECT_TRUE(contains(inspected().notes[0], "no order of the frames of winter looks like those of summer"));
  make_file(folder / "winter.csv", forwards);
  EXPECT_EQ(inspected().notes,
            std::vector<std::string>{"winter shows the same in every frame as summer: is it a copy?"});
  EXPECT_TRUE(inspected().faults.empty());
  ASSERT_EQ(inspected().matches.size(), 1u);
  EXPECT_EQ(inspected().matches[0].counterparts[30], 30);
  EXPECT_GT(inspected().matches[0].confidence[30], 0.5);
  EXPECT_EQ(occurrences(to_svg(inspected()), "<circle r=\"2\" fill=\""), 60);
  make_file(folder / "winter.csv", "5,2\n3,4.5\n");
  ASSERT_EQ(inspected().faults.size(), 1u);
  EXPECT_EQ(inspected().faults[0].what,
            "has 2 features a frame, summer has 8: they are of two encoders, or one table is transposed");
}

TEST(Inspection, NotesADriveTheOtherWay) {
  const Folder folder;
  std::string there = "lat,lon\n", back = there, elsewhere = there;
  for (int i = 0; i < 12; ++i) {
    for (const std::string name : {"back/", "there/", "town/"})
      write_grey(folder / (name + std::to_string(i) + ".png"), 10 * i + static_cast<int>(name.size()));
    there += std::to_string(50 + 0.0001 * i) + ",7\n";
    back += std::to_string(50.0011 - 0.0001 * i) + ",7\n";
    elsewhere += std::to_string(50 + 0.0001 * i) + ",8\n";
  }
  make_file(folder / "there.poses.csv", there);
  make_file(folder / "back.poses.csv", back);
  make_file(folder / "town.poses.csv", elsewhere);
  const Inspection found = inspect(*make_dataset("plain", folder.path()), folder.path(), kOn);
  EXPECT_EQ(found.notes, (std::vector<std::string>{"town shows the same in every frame as back: is it a copy?",
                                                   "there runs the other way than back, by latitude and longitude: "
                                                   "cameras that look ahead see other things",
                                                   "12 of 12 places of town are farther than 25 m from all of back"}));
  EXPECT_TRUE(found.faults.empty());
  const std::string svg = to_svg(found);
  EXPECT_TRUE(contains(svg, ">there</text>"));
  EXPECT_TRUE(contains(svg, "routes, 71473 m wide")) << "a degree at latitude 50.0011 is 111195 m times its cosine";
}

TEST(Inspection, NamesEachBadFrame) {
  const Folder folder;
  write_drives(folder);
  const Inspection all_taken = inspect(*make_dataset("plain", folder.path()), folder.path(), kOn);
  EXPECT_TRUE(all_taken.faults.empty() && all_taken.not_taken.empty());
  const std::string png = contents(folder / "day/2.png");
  make_file(folder / "day/2.png", png.substr(0, 40));
  // A file whose ends look fine and whose middle does not.
  std::string hollow = png;
  std::fill(hollow.begin() + 37, hollow.end() - 12, 'x');
  make_file(folder / "night/1.png", hollow);
  make_file(folder / "table.csv", "1,2\n3,x\n");
  long last = 0, all = 0;
  const Inspection inspection =
      inspect(*make_dataset("plain", folder.path()), folder.path(), [&](long done, long total) {
        last = done;
        all = total;
        return true;
      });
  EXPECT_EQ(inspection.frames, 8);
  EXPECT_EQ(last, 8);
  EXPECT_EQ(all, 8);
  ASSERT_EQ(inspection.faults.size(), 3u);
  EXPECT_EQ(inspection.faults[0].traversal, "table");
  EXPECT_EQ(inspection.faults[0].frame, -1);
  EXPECT_EQ(inspection.faults[1].name, "day/2.png");
  EXPECT_EQ(inspection.faults[1].frame, 2);
  EXPECT_EQ(inspection.faults[2].name, "night/1.png");
  EXPECT_EQ(inspect(*make_dataset("plain", folder.path()), folder.path(), [](long, long) { return false; }).frames, 1);
}

TEST(Inspection, Summarises) {
  const Folder folder;
  write_drives(folder);
  make_file(folder / "day.poses.csv", "frame,lat,lon\n0,0,0\n1,0.001,0\n4,0.003,0\n");
  make_file(folder / "feat.csv", "1,2,3\n4,5,6\n");
  make_file(folder / "night/1.png", "");
  make_file(folder / "night.poses.csv", "frame,lat,lon\n0,,\n");
  make_file(folder / "bad.csv", "1\n");
  const auto dataset = make_dataset("plain", folder.path());
  const Summary day = summarise(*dataset, "day"), night = summarise(*dataset, "night");
  EXPECT_EQ(day.frames, 5);
  EXPECT_EQ(day.pixels, "32x24");
  EXPECT_TRUE(day.gps);
  EXPECT_EQ(day.places, "day.poses.csv");
  EXPECT_NEAR(day.metres, 333.585, 0.01);
  EXPECT_NEAR(day.mean_step, 333.585 / 2, 0.01);
  EXPECT_EQ(day.bad_frames, 0);
  EXPECT_EQ(night.bad_frames, 1);
  EXPECT_FALSE(night.gps);
  EXPECT_EQ(night.places, "") << "its table has none";
  EXPECT_TRUE(std::isnan(night.metres));
  EXPECT_EQ(summarise(*dataset, "feat").dimension, 3);
  EXPECT_TRUE(contains(summarise(*dataset, "bad").error, "only one frame"));
}

TEST(Inspection, ColumnsOfTheTableAreAsWideAsTheirContents) {
  Summary drive;
  drive.name = "2011_09_26_drive_0002_sync";
  drive.condition = "overcast+partial+rain";
  drive.frames = 123456789;
  drive.metres = drive.mean_step = 1;
  drive.pixels = "10000x10000";
  Summary bad;
  bad.name = "table";
  bad.error = "table.csv: has only one frame, which is a message longer than any column";
  EXPECT_EQ(to_table({drive, bad}),
            "traversal                   condition                 frames  metres  step m  places       pixels  "
            "features  bad\n"
            "2011_09_26_drive_0002_sync  overcast+partial+rain  123456789       1    1.00      no  10000x10000         "
            "-    0\n"
            "table                       cannot be loaded: " +
                bad.error + "\n");
}

// The drive's only camera is not the default one.
TEST(Inspection, ProgramTakesParametersOfDatasets) {
  const Folder folder;
  const std::string camera = folder / "2011_09_26_drive_0001_sync/image_00";
  for (int i = 0; i < 2; ++i) write_grey(camera + "/data/000000000" + std::to_string(i) + ".png", 10);
  make_file(camera + "/timestamps.txt", "2011-09-26 13:02:25.9\n2011-09-26 13:02:26.0\n");
  const std::string& data = folder.path();
  expect_said({{{"check", "--dataset", "kitti", data}, 1, "image_02"},
               {{"check", "--kitti-camera", "0", data}, 0, "kitti: 2 frames, 0 bad"},
               {{"info", "--kitti-camera", "0", data}, 0, "2011_09_26_drive_0001_sync  day"},
               {{"info", "--dataset", "plain", "--kitti-camera", "0", data}, 1, "is for dataset kitti"}});
}

TEST(Inspection, NothingIsNotGood) {
  const Folder folder, pictures;
  for (int i = 0; i < 3; ++i) write_grey(folder / ("morning/camera/" + std::to_string(i) + ".png"), 10 * i);
  std::filesystem::create_directories(folder / "empty");
  expect_said({{{"check", folder.path(), "--dataset", "plain"},
                1,
                "not taken: 1 empty folders, the first empty\nplain: 3 frames, 0 bad; kinds of files not taken: 1"},
               {{"check", folder / "empty", "--dataset", "plain"}, 1, "no traversals found"},
               {{"info", folder / "empty"}, 1, "no traversals found"},
               {{"check", folder.path(), "--picture", pictures / "x.svg"}, 1, "plain: 3 frames, 0 bad"},
               {{"info", folder.path()}, 0, "morning"}});
  EXPECT_TRUE(contains(contents(pictures / "x.svg"), "no recording has places"));
  make_file(folder / "dusk.npy", "x");
  expect_said(
      {{{"info", folder.path()}, 0, "dusk.npy has arrays, which are not read (write each recording as a table"}});
}

TEST(Inspection, ListsDatasets) {
  for (const char* line : {"\n  paper: ", "\n  address: ", "\n  licence: ", "\n  size: "})
    expect_said({Said{{"list"}, 0, line}});
}

}  // namespace
}  // namespace citylearn::testing
