// SPDX-License-Identifier: Apache-2.0
// People's own drives: photographs, films with tracks, names with places. Right values are by hand, those of real files
// by the README beside them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "env_service/dataset_io/photographs.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/image_sources.h"
#include "tests/paths.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Names = std::vector<std::string>;

std::string big(unsigned long value, int bytes) {
  std::string text;
  while (bytes-- > 0) text += static_cast<char>(value >> (8 * bytes));
  return text;
}

/// A field of EXIF data: a text, or rationals as numerators and denominators.
struct Field {
  unsigned tag;
  std::string text = {};
  std::vector<unsigned long> rationals = {};
};
/// A directory at `at` of TIFF data whose fields' values follow it.
std::string directory(const std::vector<Field>& fields, std::size_t at) {
  std::string entries = big(fields.size(), 2), values;
  for (const Field& field : fields) {
    std::string value = field.text.empty() ? "" : field.text + '\0';
    for (const unsigned long number : field.rationals) value += big(number, 4);
    const std::size_t count = field.text.empty() ? field.rationals.size() / 2 : value.size();
    entries += big(field.tag, 2) + big(field.text.empty() ? 5 : 2, 2) + big(count, 4);
    if (value.size() <= 4) {
      value.resize(4);
      entries += value;
    } else {
      entries += big(at + 2 + 12 * fields.size() + 4 + values.size(), 4);
      values += value;
    }
  }
  return entries + big(0, 4) + values;
}
/// Writes a grey JPEG with these fields of the photograph and of GPS, and a time of its last edit.
void write_photo(const std::string& path, int grey, const std::vector<Field>& photo, const std::vector<Field>& gps) {
  std::string tiff = "MM" + big(42, 2) + big(8, 4) + big(3, 2);
  const std::size_t edited = 8 + 2 + 36 + 4, at_photo = edited + 20;
  const std::string first = directory(photo, at_photo);
  tiff += big(0x132, 2) + big(2, 2) + big(20, 4) + big(edited, 4);
  for (const auto& [tag, at] : {std::pair{0x8769u, at_photo}, std::pair{0x8825u, at_photo + first.size()}})
    tiff += big(tag, 2) + big(4, 2) + big(1, 4) + big(at, 4);
  tiff += big(0, 4) + std::string("2027:01:01 00:00:00") + '\0' + first + directory(gps, at_photo + first.size());
  write_grey(path, grey);
  std::string jpeg = contents(path);
  make_file(path, jpeg.insert(2, "\xFF\xE1" + big(tiff.size() + 8, 2) + std::string("Exif\0\0", 6) + tiff));
}
std::vector<Field> place(unsigned long degrees, unsigned long minutes, unsigned long hundredths,
                         const char* side = "N") {
  return {{1, side}, {2, "", {degrees, 1, minutes, 1, hundredths, 100}}, {3, "E"}, {4, "", {11, 1, 30, 1, 0, 1}}};
}

TEST(Photographs, TellTimeAndPlace) {
  const Folder folder;
  const std::string path = folder / "x.jpg";
  write_photo(path, 9, {{0x9003, "2026:06:01 14:00:00"}, {0x9291, "25"}, {0x9011, "+02:00"}}, place(48, 12, 3600));
  const Taken taken = read_taken(path);
  EXPECT_DOUBLE_EQ(utc_of({taken}, "")[0], 1780315200.25) << "digits are decimals; the edit's time is not taken";
  EXPECT_DOUBLE_EQ(taken.latitude, 48.21);
  EXPECT_DOUBLE_EQ(taken.longitude, 11.5);
  // No zone: by GPS, whose whole seconds are of the day before; its camera is 100 s ahead.
  write_photo(path, 9, {{0x9003, "2026:06:01 00:01:40"}, {0x9291, "5"}},
              {{7, "", {22, 1, 0, 1, 0, 1}}, {0x1D, "2026:05:31"}});
  const Taken ahead = read_taken(path);
  const Log log;
  EXPECT_DOUBLE_EQ(utc_of({ahead, ahead}, "")[1], 1780315200 - 14 * 3600 + 0.5);
  EXPECT_TRUE(std::isnan(ahead.latitude));

  const std::vector<Field> void_fix{{9, "V"}}, no_side{{2, "", {48, 1, 0, 1, 0, 1}}, {4, "", {11, 1, 0, 1, 0, 1}}};
  std::vector<Field> nothing = place(0, 0, 0), receiver_off = place(48, 0, 0);
  nothing[1].rationals = {0, 0, 0, 0, 0, 0};
  receiver_off.push_back({9, "V"});
  for (const auto& gps : {nothing, receiver_off, no_side, place(91, 0, 0), {}}) {
    write_photo(path, 9, {}, gps);
    EXPECT_TRUE(std::isnan(read_taken(path).latitude));
    EXPECT_TRUE(std::isnan(read_taken(path).local));
  }
  write_photo(path, 9, {}, place(0, 0, 0, "S"));
  EXPECT_EQ(read_taken(path).latitude, 0) << "the equator is a place";
}

TEST(Photographs, OfAnotherDayAreTold) {
  const auto told = [](const std::vector<double>& clock) {
    std::vector<Taken> photographs;
    for (const double time : clock) photographs.push_back({time, 0, std::nan(""), 0, 0});
    const Log log;
    utc_of(photographs, "walk");
    return log.has("walk: mend the dates of 1 of 4 pictures, hours from all others");
  };
  EXPECT_TRUE(told({0, 2, 86403, 6}));
  EXPECT_FALSE(told({0, 2, 6, 86403})) << "a pause";
}

TEST(Photographs, AreInTheOrderOfTheirTimes) {
  const Folder folder;
  const auto drive = [&] { return make_dataset("plain", folder.path())->load("trip"); };
  const auto write = [&](const std::string& name, int k, const char* fraction) {
    write_photo(folder / ("trip/" + name), k,
                {{0x9003, "2026:06:01 14:00:0" + std::to_string(k / 2)}, {0x9291, fraction}},
                place(48, 0, 100UL * static_cast<unsigned>(k)));
  };
  // A counter that wraps; two pictures a second, which the fraction orders.
  write("IMG_9998.JPG", 0, "1");
  write("IMG_9999.JPG", 1, "75");
  write("IMG_0002.JPG", 2, "09");
  write("IMG_0001.JPG", 3, "1");
  std::filesystem::copy(folder / "trip/IMG_9998.JPG", folder / "trip/IMG_9998 (1).JPG");
  const Log log;
  const Traversal trip = drive();
  Names names;
  for (int i = 0; i < trip.frames; ++i) names.push_back(trip.images->name(i));
  EXPECT_EQ(names, (Names{"trip/IMG_9998.JPG", "trip/IMG_9999.JPG", "trip/IMG_0002.JPG", "trip/IMG_0001.JPG"}));
  EXPECT_TRUE(log.has("1 pictures are copies of others and left out, the first IMG_9998 (1).JPG")) << log.text();
  EXPECT_EQ(trip.places_from, "EXIF");
  EXPECT_NEAR(trip.positions[3], 3 / 3600.0 * 111195.08, 0.01);
  // Some have no time: the others say that names do not follow it.
  write_grey(folder / "trip/IMG_0003.jpg", 50);
  EXPECT_TRUE(contains(error_of(drive), "the counter seems to have begun anew"));
}

TEST(Tracks, BesideAFilmNeedItsTime) {
  const Folder folder;
  ASSERT_TRUE(write_video(folder / "walk.avi", 50));  // 2 s, and no word when they began
  const auto point = [](int second, double latitude) {
    return "<trkpt lat='" + std::to_string(latitude) + "' lon='0'><time>2026-06-01T12:00:0" + std::to_string(second) +
           "Z</time></trkpt>";
  };
  make_file(folder / "walk.gpx", "<gpx><trk><trkseg>" + point(0, 48) + point(4, 48.0004) + "</trkseg></trk></gpx>");
  EXPECT_TRUE(contains(error_of([&] { make_dataset("plain", folder.path())->load("walk"); }),
                       "walk.gpx: nothing says which time of it is that of the first frame of walk, not its motion "
                       "either: it is shorter than 20 s"));
  const Traversal walk = make_dataset("plain", folder.path(), {{"clock-offset", 1}})->load("walk");
  EXPECT_EQ(walk.places_from, "walk.gpx");
  EXPECT_NEAR(walk.latitude[25], 48.0002, 1e-9) << "second 1 of the film is second 2 of the track";
  std::filesystem::rename(folder / "walk.gpx", folder / "other.gpx");  // it may be of something else
  const Log log;
  EXPECT_TRUE(make_dataset("plain", folder.path())->load("walk").latitude.empty());
  EXPECT_TRUE(log.has("other.gpx")) << log.text();
}

/// A film of 40 s was made from second 60 of a track that goes at seconds 30 to 50, 70 to 80, 90 to 95 and 105 to 110.
TEST(FilmTracks, AreJoinedAtTheStartOrTheEndByTheMotionOfTheFilm) {
  if (std::system("ffmpeg -version >/dev/null 2>&1") != 0) GTEST_SKIP() << "skipped: no ffmpeg";
  const Folder folder;
  const auto moved = [](double second) {  // seconds of going, up to then
    double sum = 0;
    for (const auto& [from, to] : {std::pair{30, 50}, {70, 80}, {90, 95}, {105, 110}})
      sum += std::clamp(second, double(from), double(to)) - from;
    return sum;
  };
  const auto clock = [](int second) {
    return "2026-06-01T12:0" + std::to_string(second / 60) + ":" + std::to_string(100 + second % 60).substr(1) + "Z";
  };
  const auto track = [&](int last) {
    std::string points;
    for (int second = 0; second <= last; ++second)
      points += "<trkpt lat='" + std::to_string(48 + 1e-4 * moved(second)) + "' lon='0'><time>" + clock(second) +
                "</time></trkpt>";
    make_file(folder / "walk.gpx", "<gpx><trk><trkseg>" + points + "</trkseg></trk></gpx>");
  };
  const auto film = [&](double begin) {  // NaN: steady
    cv::VideoWriter writer(folder / "made.avi", cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10,
                           cv::Size(64, 48));
    for (int i = 0; i < 400; ++i)
      writer.write(cv::Mat(48, 64, CV_8UC3,
                           cv::Scalar::all(int(80 * (std::isnan(begin) ? i / 10. : moved(begin + i / 10.))) % 200)));
    return writer.isOpened();
  };
  const auto load = [&](int creation, double offset = 0) {
    const std::string began = creation < 0 ? "" : " -metadata creation_time=" + clock(creation);
    const std::string command =
        "ffmpeg -nostdin -v fatal -y -i " + (folder / "made.avi") + " -c copy" + began + " " + (folder / "walk.mp4");
    EXPECT_EQ(std::system(command.c_str()), 0);
    return make_dataset("plain", folder.path(), {{"clock-offset", offset}})->load("walk");
  };
  constexpr double kGone = 48.0025;  // at second 15 of the film, after 20 s and 5 s of going
  track(150);
  ASSERT_TRUE(film(60));
  {
    const Log log;
    EXPECT_NEAR(load(60).latitude[150], kGone, 2e-5);
    EXPECT_EQ(log.lines(), 0) << "its start, as is usual: " << log.text();
  }
  {
    const Log log;
    EXPECT_NEAR(load(100).latitude[150], kGone, 2e-5);
    EXPECT_TRUE(log.has("walk: creation_time is taken as its end: its motion fits")) << log.text();
  }
  {
    const Log log;
    EXPECT_NEAR(load(100, 0.001).latitude[150], 48.004, 2e-5) << "second 115: the word given holds";
    EXPECT_EQ(log.lines(), 0) << log.text();
  }
  for (const int last : {99, 102}) {  // it ends about creation_time, but covers the film
    track(last);
    const Log log;
    EXPECT_NEAR(load(100).latitude[150], kGone, 2e-5);
    EXPECT_TRUE(log.has("creation_time is taken as its end, as the track ends")) << log.text();
  }
  track(150);
  for (const double begin :
       {58.2, 60.33, 61.7}) {  // its clock is whole seconds off, and more: found to a picture, .1 s
    ASSERT_TRUE(film(begin));
    const double there = 48 + 1e-4 * moved(begin + 15);
    {
      const Log log;
      EXPECT_NEAR(load(60).latitude[150], there, 1e-5) << begin;
      EXPECT_TRUE(log.has("walk: its clock is taken to be")) << log.text();
    }
    EXPECT_NEAR(load(100).latitude[150], there, 1e-5) << begin << ", by its end";
    const Log log;
    EXPECT_NEAR(load(-1).latitude[150], there, 1e-5) << begin << ", not told";
    EXPECT_TRUE(log.has("walk: begins ")) << log.text();
  }
  ASSERT_TRUE(film(28.2));  // it can not have ended at second 30 of the track, as it takes 40
  {
    const Log log;
    EXPECT_NEAR(load(30).latitude[150], 48.00132, 1e-5) << "second 43.2, after 13.2 s of going";
    EXPECT_TRUE(log.has("walk: its clock is taken to be 1.8")) << log.text();
  }
  ASSERT_TRUE(film(std::nan("")));
  EXPECT_TRUE(contains(error_of([&] { load(-1); }), "either: it fits the track's speed nowhere well enough"));
  const Log log;
  EXPECT_NEAR(load(60).latitude[150], kGone, 2e-5);
  EXPECT_TRUE(log.has("if it is, give --plain-clock-offset -40, else .001")) << log.text();
}

/// 10 pictures a second lie .1 s apart but for rounding. The film begins at second 30 of the track and takes 40 s.
TEST(FilmTracks, OfTenPicturesASecondAreFoundByTheirSpeed) {
  const Folder folder;
  const std::string speeds = "133131131113313111113131";  // .0001 degrees a second, each for 5 s
  const auto moved = [&](double second) {
    double sum = 0;
    for (std::size_t i = 0; i < speeds.size(); ++i)
      sum += (speeds[i] - '0') * std::clamp(second - 5 * static_cast<double>(i), 0., 5.);
    return sum;
  };
  cv::VideoWriter writer(folder / "walk.avi", cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10,
                         cv::Size(64, 48));
  for (int i = 0; i < 400; ++i)
    writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(double(std::lround(40 * moved(30 + i / 10.)) % 200))));
  writer.release();
  const auto load = [&](int rounds) {
    std::string points;
    for (int second = 0; second < 120 * rounds; ++second)
      points += "<trkpt lat='" + std::to_string(48 + 1e-4 * (moved(second % 120) + (second < 120 ? 0 : moved(120)))) +
                "' lon='0'><time>2026-06-01T12:0" + std::to_string(second / 60) + ":" +
                std::to_string(100 + second % 60).substr(1) + "Z</time></trkpt>";
    make_file(folder / "walk.gpx", "<gpx><trk><trkseg>" + points + "</trkseg></trk></gpx>");
    return make_dataset("plain", folder.path())->load("walk");
  };
  // Second 43 is after 5 s each of 1, 3, 3, 1, 3, 1, 1 and 3, and 3 s of 1.
  EXPECT_NEAR(load(1).latitude[130], 48.0083, 2e-5) << ".2 s at 1";
  EXPECT_TRUE(contains(error_of([&] { load(2); }), "either: it fits the track's speed at several times"));
}

TEST(FilmTracks, SubtitlesOfADrone) {
  const Folder folder;
  ASSERT_TRUE(write_video(folder / "fly.avi", 50));  // 2 s
  const auto subtitles = [](const std::string& first, const std::string& last) {
    return "1\n00:00:00,000 --> 00:00:01,000\n<font size=\"28\">" + first + "</font>\n\n2\n00:00:01,000 --> " +
           "00:00:02,000\n" + last + "\n\n";
  };
  const auto fly = [&](const std::string& text) {
    make_file(folder / "FLY.SRT", text);
    return make_dataset("plain", folder.path())->load("fly");
  };
  Traversal film = fly(subtitles("[iso: 100] [latitude: 48.0] [longtitude: 11.0] [abs_alt: 9]",
                                 "[latitude : 48.0002] [longitude : 11.0]"));
  EXPECT_EQ(film.places_from, "FLY.SRT");
  EXPECT_NEAR(film.latitude[5], 48.00004, 1e-9) << "a fifth of the way to second 1";
  EXPECT_NEAR(film.latitude[49], 48.0002, 1e-9);
  film = fly(subtitles("HOME(1.0,2.0)\nGPS(11.0,48.0,19) BAROMETER:1.9", "F/2.8, GPS (11.0, 48.0002, 19), D 2m"));
  EXPECT_NEAR(film.latitude[5], 48.00004, 1e-9) << "longitude comes first";
  EXPECT_EQ(film.longitude[5], 11);
  EXPECT_TRUE(fly(subtitles("[Birds sing]", "[A dog barks]")).latitude.empty());
}

TEST(FilmTracks, LieInTheFolderOfTheFilmToo) {
  const Folder folder;
  std::filesystem::create_directory(folder / "monday");
  ASSERT_TRUE(write_video(folder / "monday/VID_1.AVI", 50));
  make_file(folder / "monday/vid_1.srt", "1\n00:00:00,000 --> 00:00:02,000\n[latitude: 48] [longitude: 11]\n\n");
  const auto plain = make_dataset("plain", folder.path());
  EXPECT_EQ(plain->names(), Names{"monday"});
  EXPECT_EQ(plain->load("monday").places_from, "monday/vid_1.srt");
  EXPECT_EQ(plain->load("monday").latitude[0], 48);
}

TEST(FilmTracks, ChaptersTellTheirPlacesInTurn) {
  if (std::system("ffmpeg -version >/dev/null 2>&1") != 0) GTEST_SKIP() << "skipped: no ffmpeg";
  const Folder folder;
  std::filesystem::create_directory(folder / "drives");
  ASSERT_TRUE(write_video(folder / "made.avi", 50));  // 2 s
  for (const int chapter : {1, 2}) {
    const auto subtitle = [&](int second) {
      return std::to_string(second + 1) + "\n00:00:0" + std::to_string(second) + ",000 --> 00:00:0" +
             std::to_string(second + 1) + ",000\n[latitude: 48.000" + std::to_string(2 * chapter + second) +
             "] [longitude: 11]\n\n";
    };
    make_file(folder / "made.srt", subtitle(0) + subtitle(1));
    const std::string film = folder / ("drives/GX0" + std::to_string(chapter) + "0009.mkv");
    const std::string command =
        "ffmpeg -nostdin -v fatal -i " + (folder / "made.avi") + " -i " + (folder / "made.srt") + " -c copy " + film;
    ASSERT_EQ(std::system(command.c_str()), 0);
  }
  const Traversal film = make_dataset("plain", folder / "drives")->load("GX010009");
  ASSERT_EQ(film.frames, 100);
  for (const int frame : {0, 25, 50, 75})  // 25 frames and .0001 degrees a second
    EXPECT_NEAR(film.latitude[static_cast<std::size_t>(frame)], 48.0002 + frame * 4e-6, 1e-7) << frame;
}

TEST(FilmTracks, ChaptersOfAGoProAreOneFilm) {
  const Folder folder;
  std::filesystem::create_directory(folder / "monday");
  const auto chapter = [&](const std::string& name) { ASSERT_TRUE(write_video(folder / ("monday/" + name), 50)); };
  for (const std::string name : {"GX020007.AVI", "gx010007.avi", "GX030007.AVI"}) chapter(name);
  const auto plain = make_dataset("plain", folder.path());
  EXPECT_EQ(plain->names(), Names{"monday"});
  const Traversal film = plain->load("monday");
  ASSERT_EQ(film.frames, 150);
  EXPECT_EQ(film.images->name(49), "monday/gx010007.avi, frame 49");
  EXPECT_EQ(film.images->name(100), "monday/GX030007.AVI, frame 0");
  EXPECT_NEAR(film.times[50], 2, 1e-9) << "25 pictures a second";
  EXPECT_NEAR(film.times[149], 5.96, 1e-9);
  std::filesystem::remove(folder / "monday/GX020007.AVI");
  EXPECT_TRUE(contains(error_of([&] { plain->load("monday"); }),
                       "monday/GX030007.AVI: the chapter before it is not there (copy it too, or move this one away)"));
  std::filesystem::remove_all(folder / "monday");
  std::filesystem::create_directory(folder / "monday");
  for (const std::string name : {"GP010008.AVI", "GOPR0008.AVI"}) chapter(name);
  EXPECT_EQ(plain->load("monday").images->name(50), "monday/GP010008.AVI, frame 0");
  chapter("GOPR0009.AVI");
  EXPECT_EQ(plain->names(), Names{}) << "two films: which one is the traversal's cannot be told";
}

/// By exiftool 12.57, -ee -v3: the first samples of the packets at 0 s and 2 s of the film.
TEST(FilmTracksReal, AGoProTellsItsPlaces) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "formats/gopro");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const Traversal film = make_dataset("plain", folder)->load("max-heromode");
  EXPECT_EQ(film.places_from, "GPS5");
  EXPECT_NEAR(film.latitude[0], 33.12677, 1e-7);
  EXPECT_NEAR(film.longitude[0], -117.3273436, 1e-7);
  EXPECT_NEAR(film.latitude[60], 33.1267516, 1e-7);
  EXPECT_NEAR(film.longitude[60], -117.3273295, 1e-7);
}

TEST(UtmNames, GivePlacesAndTheOrderOfTheDrive) {
  // By PROJ: 9 E of the equator is 500000, 0 in zone 32; 48.2, 11.5 is 685760.31, 5341551.85.
  const LatLon munich = from_utm(685760.305762, 5341551.854095, 32, true),
               south = from_utm(500000, 1e7 - 1e6, 21, false);
  EXPECT_NEAR(munich.latitude, 48.2, 2e-8);
  EXPECT_NEAR(munich.longitude, 11.5, 2e-8);
  EXPECT_NEAR(south.latitude, -from_utm(500000, 1e6, 21, true).latitude, 1e-12);
  EXPECT_DOUBLE_EQ(south.longitude, -57);
  const Folder folder;
  const auto write = [&](const std::string& name) { write_grey(folder / ("images/test/" + name), 9); };
  write("database/@0685760.31@5341551.85@32@U@@@b@@@@@@20260601100100@@.jpg");
  write("database/@0685770.31@5341551.85@32@U@48.20000@11.50000@a@@@@@@20260601100000@@.jpg");
  for (int i = 0; i < 2; ++i) write("queries/@1000@200" + std::to_string(3 * i) + "@@@@@x@@@@@@1@@.jpg");
  const auto dataset = make_dataset("utm_names", folder.path());
  EXPECT_EQ(dataset->names(), (Names{"test-database", "test-queries"}));
  EXPECT_EQ(recognised(folder.path())[0], "utm_names");
  const Traversal database = dataset->load("test-database");
  EXPECT_TRUE(contains(database.images->name(0), "@a@"));
  EXPECT_NEAR(database.latitude[1], 48.2, 1e-7) << "from the zone";
  EXPECT_EQ(dataset->load("test-queries").positions, (std::vector<float>{0, 3})) << "metres, where no zone is told";
}

TEST(Msls, FollowsItsSequences) {
  const Folder folder;
  const std::string city = folder / "train_val/made_up/database/";
  for (const char* key : {"a", "b", "c", "d"}) write_grey(city + "images/" + key + ".jpg", 9);
  make_file(city + "seq_info.csv", ",key,sequence_key,frame_number\n0,a,two,1\n1,b,one,0\n2,c,two,0\n3,d,one,1\n");
  make_file(city + "raw.csv",
            ",key,lon,lat,ca,pano,captured_at\n0,a,8,50.1,0,False,2026-06-01\n"
            "1,b,8,50,0,False,2026-06-01\n2,c,8,50.2,0,False,2026-06-01\n3,d,8,50,0,True,2026-06-01\n");
  const Log log;
  EXPECT_EQ(recognised(folder.path())[0], "msls");
  const Traversal drive = make_dataset("msls", folder.path())->load("made_up-database");
  EXPECT_EQ(drive.latitude, (std::vector<double>{50.2, 50.1, 50})) << "a panorama is left out";
  EXPECT_TRUE(log.has("1 panoramas are left out")) << log.text();
}

/// draw.py: ten bits of the picture's number in the lowest 16 rows, red in the upper left.
int number_in(Images& images, int frame) {
  Bytes bytes;
  images.read(frame, bytes);
  const cv::Mat picture = decode_image(bytes, "x");
  const cv::Vec3b corner = picture.at<cv::Vec3b>(4, 4);
  if (picture.cols != 128 || picture.rows != 96 || corner[2] < 128 || corner[0] > 100) return -1;
  int number = 0;
  for (int bit = 0; bit < 10; ++bit) number |= (picture.at<cv::Vec3b>(88, 10 + 12 * bit)[1] > 127) << bit;
  return number;
}

TEST(OwnDrivesReal, PhotographsAndFilmsAreUprightAndInOrder) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "formats/drives-2026");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  for (const char* name : {"piexif", "exiftool", "heic"}) {
    const Traversal drive = make_dataset("plain", folder + "/photos")->load(name);
    const bool south = name == std::string("exiftool");
    for (int k = 0; k < drive.frames; ++k) {
      const auto i = static_cast<std::size_t>(k);
      EXPECT_EQ(number_in(*drive.images, k), k) << name;
      if (name == std::string("piexif") && k == 3) {
        EXPECT_TRUE(std::isnan(drive.latitude[i]));
      } else {
        EXPECT_NEAR(drive.latitude[i], (south ? -34.9 : 48.2) + std::min(200, 50 * k) / 111195.0, 1e-6) << name << k;
      }
    }
  }
  EXPECT_EQ(make_dataset("plain", folder + "/walk")->load("walk").places_from, "walk.nmea");
  const auto utm = make_dataset("utm_names", folder + "/utm");
  const Traversal database = utm->load("test-database"),
                  city = make_dataset("msls", folder + "/msls")->load("made_up-query");
  for (int k = 0; k < database.frames; ++k) EXPECT_EQ(number_in(*database.images, k), k);
  for (int k = 0; k < city.frames; ++k) EXPECT_EQ(number_in(*city.images, k), 200 + k);
}

}  // namespace
}  // namespace citylearn::testing
