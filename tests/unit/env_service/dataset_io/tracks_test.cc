// SPDX-License-Identifier: Apache-2.0
// Tracks of receivers: right values are by hand, those of real files by the README beside them.
#include "env_service/dataset_io/tracks.h"

#include <gtest/gtest.h>

#include <cmath>

#include "env_service/files/times.h"
#include "tests/paths.h"
#include "tests/support/data/real_data.h"
#include "tests/support/files.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr double kNoon = 1780315200;  // 2026-06-01T12:00:00Z, by date -d

/// What read_track() makes of a file: "12:+3.5 48.1,11.2", seconds after noon and the place, a point a line.
struct Read {
  explicit Read(const std::string& text, const std::string& suffix = ".gpx", double near = kNoon) {
    const Folder folder;
    make_file(folder / ("x" + suffix), text);
    error = error_of([&] {
      const GpsRows rows = read_track(folder / ("x" + suffix), near);
      for (std::size_t i = 0; i < rows.times.size(); ++i) {
        char line[80];
        std::snprintf(line, sizeof line, "%+g %g,%g\n", rows.times[i] - kNoon, rows.latitude[i], rows.longitude[i]);
        points += line;
      }
    });
  }
  std::string points, error;
};

std::string gpx(const std::string& points) { return "<gpx><trk><trkseg>" + points + "</trkseg></trk></gpx>"; }
std::string gpx_point(const std::string& time, const std::string& place = "lat=\"1\" lon=\"2\"") {
  return "<trkpt " + place + ">" + (time.empty() ? "" : "<ele>3</ele><time>" + time + "</time>") + "</trkpt>";
}
std::string nmea(const std::string& body) {
  unsigned sum = 0;
  for (const char c : body) sum ^= static_cast<unsigned char>(c);
  char end[8];
  std::snprintf(end, sizeof end, "*%02X\r\n", sum);
  return "$" + body + end;
}

TEST(Tracks, TellHeights) {
  const Folder folder;
  const auto heights = [&](const std::string& suffix, const std::string& text) {
    make_file(folder / ("x" + suffix), text);
    std::vector<double> found = read_track(folder / ("x" + suffix), kNoon).height;
    for (double& height : found) height = std::isnan(height) ? -1 : height;
    return found;
  };
  const std::string noon = "2026-06-01T12:00:00Z", later = "2026-06-01T12:00:01Z";
  EXPECT_EQ(heights(".gpx", gpx(gpx_point(noon) + "<trkpt lat='1' lon='2'><time>" + later + "</time></trkpt>")),
            (std::vector<double>{3, -1}));
  EXPECT_EQ(heights(".nmea", nmea("GPGGA,120000.00,0100.0,N,00200.0,E,1,08,0.9,545.4,M,46.9,M,,") +
                                 nmea("GPGGA,120001.00,0100.0,N,00200.0,E,1,08,0.9,,M,46.9,M,,")),
            (std::vector<double>{545.4, -1}));
  const std::string whens = "<when>" + noon + "</when><when>" + later + "</when>";
  EXPECT_EQ(heights(".kml", "<kml><Track>" + whens + "<coord>2 1 7.5</coord><coord>2 1</coord></Track></kml>"),
            (std::vector<double>{7.5, -1}));
  EXPECT_EQ(heights(".geojson",
                    "{\"type\":\"Feature\",\"geometry\":{\"type\":\"LineString\",\"coordinates\":[[2,1,9],[2,1]]"
                    "},\"properties\":{\"times\":[\"" +
                        noon + "\",\"" + later + "\"]}}"),
            (std::vector<double>{9, -1}));
}

TEST(Times, AreReadAsTheyAreWritten) {
  for (const auto& [text, seconds] : std::vector<std::pair<const char*, double>>{{"2026-06-01T12:00:00Z", 0},
                                                                                 {"2026-06-01T14:00:00.25+02:00", 0.25},
                                                                                 {"2026-06-01T06:30:00-0530", 0},
                                                                                 {"2026:06:01 12:00:01", 1},
                                                                                 {" 2026-06-01T12:00Z\n", 0},
                                                                                 {"2026-06-01 13:00:00,5+01", 0.5},
                                                                                 {"2026-06-01", -43200}})
    EXPECT_NEAR(read_moment(text).utc() - kNoon, seconds, 1e-6) << text;
  for (const char* text : {"", "0000:00:00 00:00:00", "2026-02-30T12:00:00Z", "2026-06-01T25:00:00Z", "noon",
                           "2026-06-01T12:00:00+99:00", "    :  :     :  :  "})
    EXPECT_TRUE(std::isnan(read_moment(text).seconds)) << text;
}

TEST(Times, FarFromAllOthersAndAgainstTheirOrderAreStrays) {
  const double day = 86400, now = 1.8e9, unknown = std::nan("");
  const std::vector<std::pair<std::vector<double>, std::vector<std::size_t>>> cases{
      {{now, now + 1, now + day, now + 2, now + 3}, {2}},
      {{now, now + 1, 0, now + 2}, {2}},
      {{now + day, now, now + 1, unknown, now + 2}, {0}},
      {{0, now, now + 1, now + 2}, {}},                   // a clock that was set
      {{now, now + 1, unknown, now + 2, now + day}, {}},  // a pause
      {{now, now + 3000, now + 1500, now + 2}, {}},
      {{now, 0, now + 1, now + day, now + 2}, {}},  // too many
      {{now, 0}, {}},
      {{}, {}}};
  for (const auto& [times, strays] : cases) EXPECT_EQ(stray_times(times), strays) << ::testing::PrintToString(times);
}

TEST(Tracks, PointsOfAnotherDayAreLeftOut) {
  std::string points;
  for (int i = 0; i < 5; ++i)
    points += gpx_point("2026-06-0" + std::string(i == 2 ? "2" : "1") + "T12:00:0" + std::to_string(i) + "Z");
  const Log log;
  EXPECT_EQ(Read(gpx(points)).points, "+0 1,2\n+1 1,2\n+3 1,2\n+4 1,2\n");
  EXPECT_TRUE(log.has("x.gpx: 1 of 5 points have no time or one far from the others")) << log.text();
}

TEST(Tracks, GpxInAnyForm) {
  EXPECT_EQ(Read(gpx(gpx_point("2026-06-01T14:00:00.5+02:00") + gpx_point("") +
                     gpx_point("2026-06-01T11:59:00Z", "lon='-3' lat='0'")))
                .points,
            "-60 0,-3\n+0.5 1,2\n")
      << "zones, points without time, out of order";
  const std::string pause = gpx_point("2026-06-01T12:00:00Z") + "</trkseg><trkseg>" +
                            gpx_point("2026-06-01T12:00:10Z") + "</trkseg><trkseg>" + gpx_point("2026-06-01T12:00:30Z");
  EXPECT_EQ(Read("<wpt lat='9' lon='9'/>").error.empty(), false);
  EXPECT_EQ(Read(gpx(pause)).points, "+0 1,2\n+10 1,2\n+20 nan,nan\n+30 1,2\n") << "unknown in a pause";
  EXPECT_TRUE(contains(Read(gpx(gpx_point("2026-06-01T12:00:00Z", "lat='48,2' lon='2'"))).error, "has no fix"));
  EXPECT_TRUE(
      contains(Read(gpx("<trkpt lat='1' lon='2'><time>2026-06-01T12:00:00Z</time><fix>none</fix></trkpt>")).error,
               "has no fix"));
  EXPECT_TRUE(contains(Read(gpx(gpx_point(""))).error, "x.gpx: has places without times"));
  EXPECT_TRUE(contains(Read(gpx(gpx_point("2026-06-01T12:00:00Z", "lat='91' lon='2'"))).error, "not a latitude"));
  EXPECT_TRUE(contains(Read("<gpx><trk>").error, "x.gpx:1: is not XML"));
  EXPECT_TRUE(contains(Read("<gpx/>").error, "holds no track"));
}

TEST(Tracks, KmlAndGeoJsonHaveLongitudeFirst) {
  const std::string when = "<when>2026-06-01T12:00:00Z</when><when>2026-06-01T12:00:01Z</when>";
  EXPECT_EQ(Read("<kml><gx:Track>" + when + "<gx:coord>2 1 5</gx:coord><gx:coord/></gx:Track></kml>", ".kml").points,
            "+0 1,2\n")
      << "an empty place is no fix";
  EXPECT_TRUE(contains(Read("<kml><Track>" + when + "<coord>2 1</coord></Track></kml>", ".kml").error,
                       "a track of 2 times and 1 places"));
  EXPECT_TRUE(contains(Read("<kml><LineString><coordinates>2,1 3,1</coordinates></LineString></kml>", ".kml").error,
                       "places without times"));
  EXPECT_EQ(Read("<kml><Placemark><TimeStamp><when>2026-06-01T12:00:02Z</when></TimeStamp><Point><coordinates>2,1,0"
                 "</coordinates></Point></Placemark></kml>",
                 ".kml")
                .points,
            "+2 1,2\n");
  const std::string line =
      R"({"type":"Feature","properties":{"coordTimes":TIMES},"geometry":{"type":"MultiLineString",)"
      R"("coordinates":[[[179.9,1],[180,1]],[[-180,1],[-179.9,1,7]]]}})";
  const auto with = [&](const std::string& times) { return std::string(line).replace(line.find("TIMES"), 5, times); };
  const std::string four = "+0 1,179.9\n+1 1,180\n+2 1,-180\n+3 1,-179.9\n";
  EXPECT_EQ(Read(with("[1780315200,1780315201,1780315202,1780315203]"), ".geojson").points, four);
  EXPECT_EQ(Read(with("[[1780315200000,1780315201000],[1780315202000,1780315203000]]"), ".GeoJSON").points, four);
  EXPECT_EQ(Read(with("[1780315200000000,1780315201e6,1780315202e9,1780315203e9]"), ".geojson").points, four)
      << "microseconds and nanoseconds";
  EXPECT_TRUE(contains(Read(with("[1,2,3]"), ".geojson").error, "a track of 3 times and 4 places"));
  EXPECT_TRUE(contains(Read(with("null"), ".geojson").error, "places without times"));
}

TEST(Tracks, NmeaOfOneReceiverOverMidnight) {
  // GP and GL tell places of their own; GL sees more satellites. Without a fix fields are empty.
  std::string text;
  for (int second = 58; second < 62; ++second) {
    const std::string time = second < 60 ? "2359" + std::to_string(second) : "00000" + std::to_string(second - 60);
    text += nmea("GPGGA," + time + ",0130.0000,S,00200.0000,E,1,05,2.0,5,M,47,M,,") +
            nmea("GLGGA," + time + ",0130.6000,S,00200.0000,E,1,09,0.8,5,M,47,M,,") +
            nmea("GNRMC," + time + ",A,0130.0,S,00200.0,E,0,0," + (second < 60 ? "310526" : "010626") + ",,,A");
  }
  text += nmea("GLGGA,000002,,,,,0,00,,,M,,M,,") + "$GLGGA,000003,0130.6000,S,00200.0000,E,1,09,0.8,5,M,47,M,,*00\r\n";
  const Log log;
  EXPECT_EQ(Read(text, ".NMEA").points, "-43202 -1.51,2\n-43201 -1.51,2\n-43200 -1.51,2\n-43199 -1.51,2\n");
  EXPECT_TRUE(log.has("1 sentences are broken")) << log.text();
  text = nmea("GPGGA,120000,0130.0,N,00200.0,E,1,05,2.0,5,M,47,M,,") + nmea("GPGGA,120010,,,,,0,00,,,M,,M,,") +
         nmea("GPGGA,120030,0130.6,N,00200.0,E,1,05,2.0,5,M,47,M,,");
  EXPECT_EQ(Read(text, ".nmea").points, "+0 1.5,2\n+15 nan,nan\n+30 1.51,2\n") << "half a minute without a fix";
  // Hours alone: the day is the one nearest to the frames.
  EXPECT_EQ(Read(nmea("GPGGA,235959,0130.0000,N,00200.0000,W,1,05,2.0,5,M,47,M,,"), ".nmea", kNoon - 43190).points,
            "-43201 1.5,-2\n");
  // The first date is the receiver's own, and that of midnight is a sentence late.
  text.clear();
  const std::pair<const char*, const char*> sentences[] = {{"235957", "060180"}, {"235958", "310526"},
                                                           {"235959", "310526"}, {"000000", "310526"},
                                                           {"000001", "010626"}, {"000002", "010626"}};
  for (const auto& [time, day] : sentences)
    text += nmea("GPRMC," + std::string(time) + ",A,0130.0,N,00200.0,E,0,0," + day + ",,,A");
  EXPECT_EQ(Read(text, ".nmea").points,
            "-43203 1.5,2\n-43202 1.5,2\n-43201 1.5,2\n-43200 1.5,2\n-43199 1.5,2\n-43198 1.5,2\n");
  for (const char* const place : {"0160.0,N,00200.0,E", "-0130.0,N,00200.0,E", "1.5,N,2.5,E", "0130.0,N,2.5,E"})
    EXPECT_TRUE(contains(Read(nmea("GPGGA,120000," + std::string(place) + ",1,05,2.0,5,M,47,M,,"), ".nmea").error,
                         "has no fix"))
        << place << " has no degrees and minutes";
  EXPECT_TRUE(contains(Read(nmea("GPRMC,120000,V,,,,,,,010626,,,N"), ".nmea").error, "has no fix"));
  EXPECT_EQ(Read(nmea("GNGNS,120000,0130.0,N,00200.0,E,AN,05,2.0,5,47,,") +
                     nmea("GNGNS,120001,0130.6,N,00200.0,E,NN,00,9.9,5,47,,"),
                 ".nmea")
                .points,
            "+0 1.5,2\n");
}

TEST(Tracks, ADelayThatAllTimesHaveIsTakenOff) {
  std::string late, early, uneven, expected;
  for (int i = 0; i < 8; ++i) {
    const std::string second = "2026-06-01T12:00:0" + std::to_string(i);
    late += gpx_point(second + ".140Z");
    early += gpx_point(second + ".860Z");
    uneven += gpx_point(second + (i < 7 ? ".140Z" : ".240Z"));
    expected += "+" + std::to_string(i) + " 1,2\n";
  }
  EXPECT_EQ(Read(gpx(late)).points, expected);
  EXPECT_TRUE(Read(gpx(early)).points.starts_with("+0.86 1,2\n"));
  EXPECT_TRUE(Read(gpx(uneven)).points.starts_with("+0.14 1,2\n"));
}

/// 300 frames, 10 a second, 1 m apart: 200 m north, then east (README of the samples).
TEST(TracksReal, FollowTheWalk) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "formats/drives-2026/walk");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const double start = read_moment("2026-06-01T10:00:00Z").seconds;
  for (const char* name : {"gpxpy.gpx", "telephone.gpx", "watch.gpx", "walk.nmea", "track.kml", "walk.geojson"}) {
    Traversal walk;
    walk.frames = 300;
    for (int i = 0; i < 300; ++i) walk.times.push_back(start + i / 10.0);
    locate(walk, read_track(folder + "/" + name, start), 1);
    for (int i = 10; i < 190; i += 10)
      EXPECT_NEAR(walk.latitude[static_cast<std::size_t>(i)], 48.2 + i / 111195.0, 3e-7) << name << " " << i;
  }
  EXPECT_TRUE(contains(error_of([&] { read_track(folder + "/line.kml", start); }), "places without times"));
}

}  // namespace
}  // namespace citylearn::testing
