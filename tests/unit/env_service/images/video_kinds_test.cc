// SPDX-License-Identifier: Apache-2.0
// Films that the ffmpeg program made: a picture read at random is that of a reading from front to back by ffmpeg.
#include <gtest/gtest.h>

#include <cstdlib>
#include <opencv2/core.hpp>
#include <random>
#include <string>

#include "env_service/images/image_sources.h"
#include "tests/support/files.h"
#include "tests/support/log.h"

namespace citylearn::testing {
namespace {

constexpr int kSeeks = 200;

struct FilmKind {
  const char *name, *suffix;
  const char* encoding;     ///< of 100 pictures, all of which differ
  const char* cut = "";     ///< from where the film is copied
  const char* copied = "";  ///< how
};
class VideoKinds : public ::testing::TestWithParam<FilmKind> {};

cv::Mat seen(Images& images, int frame) {
  Bytes bytes;
  images.read(frame, bytes);
  return decode_image(bytes, images.name(frame));
}

TEST_P(VideoKinds, ShowTheSamePicturesAtRandomAsInOrder) {
  if (std::system("ffmpeg -version >/dev/null 2>&1") != 0) GTEST_SKIP() << "skipped: no ffmpeg";
  const FilmKind& kind = GetParam();
  const Folder folder;
  const std::string film = folder / (std::string("film.") + kind.suffix);
  const std::string made = *kind.copied ? folder / (std::string("whole.") + kind.suffix) : film;
  const auto run = [](const std::string& arguments) {
    return std::system(("ffmpeg -nostdin -v fatal -y " + arguments + " 2>/dev/null").c_str());
  };
  if (run("-f lavfi -i testsrc2=s=96x64:r=25:d=4 " + std::string(kind.encoding) + " " + made) != 0)
    GTEST_SKIP() << "skipped: this ffmpeg has no such encoder";
  if (*kind.copied) {
    ASSERT_EQ(run(std::string(kind.cut) + " -i " + made + " -c copy " + kind.copied + " " + film), 0);
  }
  ASSERT_EQ(run("-i " + film + " -map 0:v:0 -fps_mode passthrough -f rawvideo -pix_fmt bgr24 " + (folder / "raw")), 0);
  const std::string raw = contents(folder / "raw");
  const Log log;
  const auto images = video_frames(film, folder.path());
  EXPECT_FALSE(log.has("cut short")) << log.text();
  cv::Mat first = seen(*images, 0);
  const std::size_t size = first.total() * first.elemSize();
  ASSERT_EQ(static_cast<std::size_t>(images->frames()), raw.size() / size);
  ASSERT_GT(images->frames(), 40);
  const auto apart = [&](const cv::Mat& picture, int frame) {
    const cv::Mat told(picture.size(), CV_8UC3,
                       const_cast<char*>(raw.data() + static_cast<std::size_t>(frame) * size));  // it is only read
    return cv::norm(picture, told, cv::NORM_L1) / static_cast<double>(size);
  };
  std::mt19937 random(1);
  for (int i = 0; i < kSeeks; ++i) {
    const int frame = static_cast<int>(random() % static_cast<unsigned>(images->frames()));
    const cv::Mat picture = seen(*images, frame);
    const double here = apart(picture, frame);
    EXPECT_LT(here, 6) << frame;
    for (const int other : {frame - 1, frame + 1})
      if (other >= 0 && other < images->frames()) {
        EXPECT_LE(here, apart(picture, other)) << frame;
      }
  }
}

#define X264 "-c:v libx264 -pix_fmt yuv420p -g 12 "
#define TIMES(number) "-vf \"setpts='" number "/25/TB'\" -fps_mode vfr -enc_time_base 1:1000 "
#define MPEG4 "-c:v mpeg4 -q:v 2 -g 12 "
INSTANTIATE_TEST_SUITE_P(
    Video, VideoKinds,
    ::testing::Values(
        FilmKind{"RateFalls", "mp4", TIMES("N*(1+N/50)") X264}, FilmKind{"RateRises", "mkv", TIMES("N*(4-N/50)") X264},
        FilmKind{"RateChanges", "mov", TIMES("(N+if(gt(N,30),40,0)+if(gt(N,60),N-60,0))") X264},
        FilmKind{"CutMp4", "mp4", X264 "-bf 2", "-ss 1.3", "-avoid_negative_ts auto"},
        FilmKind{"CutMkv", "mkv", X264 "-bf 2", "-ss 1.3", "-avoid_negative_ts auto"},
        FilmKind{"CutTs", "ts", X264 "-bf 2", "-ss 1.3", "-avoid_negative_ts auto"},
        FilmKind{"CutAvi", "avi", MPEG4, "-ss 1.3", "-avoid_negative_ts auto"},
        FilmKind{"CutMpg", "mpg", "-c:v mpeg2video -q:v 2 -g 12 -bf 2", "-ss 1.3", "-avoid_negative_ts auto"},
        FilmKind{"BeginsLate", "mp4", X264, "-itsoffset 4", "-avoid_negative_ts auto"},
        FilmKind{"Rotated", "mp4", X264, "", "-metadata:s:v rotate=90"},
        FilmKind{"Vp9", "webm", "-c:v libvpx-vp9 -deadline realtime -cpu-used 8 -b:v 500k -g 24"},
        FilmKind{"Av1", "mkv", "-c:v libsvtav1 -preset 12 -crf 20 -g 24 -pix_fmt yuv420p"},
        FilmKind{"Hevc", "mp4",
                 "-c:v libx265 -pix_fmt yuv420p -x265-params log-level=0:keyint=12:bframes=3 -tag:v hvc1"},
        FilmKind{"OpenGroups", "mkv", X264 "-bf 3 -x264-params open-gop=1:scenecut=0"},
        FilmKind{"Telephone3gp", "3gp", "-c:v mpeg4 -q:v 2 -g 12"}),
    [](const auto& given) { return std::string(given.param.name); });
#undef X264
#undef MPEG4
#undef TIMES

}  // namespace
}  // namespace citylearn::testing
