// SPDX-License-Identifier: Apache-2.0
// Frame i of a film is its i-th picture, whatever was asked before, upright and in its colours.
extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <functional>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/util/error.h"
#include "env_service/images/image_sources.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

struct FilmOptions {
  const char* codec = "mpeg4";
  int b_frames = 0;
  int key_every = 12;
  int width = 64, height = 48;
  AVColorSpace matrix = AVCOL_SPC_UNSPECIFIED;
  AVColorRange range = AVCOL_RANGE_UNSPECIFIED;
  /// Y, U and V of a picture at a place; the default holds the picture's number in its brightness.
  std::function<std::array<int, 3>(int frame, int x, int y)> pixel = [](int frame, int, int) {
    return std::array{20 + 4 * frame, 128, 128};
  };
  std::vector<int> times = {};  ///< of the pictures, in 1/25 s; empty: 0, 1, 2 ...
  int damaged = -1;             ///< number of a packet whose bytes are lost
};

/// Writes a film of yuv420p. The suffix of the path names the container.
void write_film(const std::string& path, int frames, const FilmOptions& options = {}) {
  const auto check = [&](int state) {
    if (state < 0) throw Error("cannot be written", path);
  };
  AVFormatContext* file = nullptr;
  check(avformat_alloc_output_context2(&file, nullptr, nullptr, path.c_str()));
  const AVCodec* codec = avcodec_find_encoder_by_name(options.codec);
  AVCodecContext* encoder = avcodec_alloc_context3(codec);
  encoder->width = options.width;
  encoder->height = options.height;
  encoder->time_base = {1, 25};
  encoder->framerate = {25, 1};
  encoder->pix_fmt = AV_PIX_FMT_YUV420P;
  encoder->gop_size = options.key_every;
  encoder->max_b_frames = options.b_frames;
  encoder->bit_rate = 2'000'000;
  encoder->colorspace = options.matrix;
  encoder->color_range = options.range;
  encoder->thread_count = 1;
  if (file->oformat->flags & AVFMT_GLOBALHEADER) encoder->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
  check(avcodec_open2(encoder, codec, nullptr));
  AVStream* stream = avformat_new_stream(file, nullptr);
  stream->time_base = encoder->time_base;
  stream->avg_frame_rate = encoder->framerate;
  check(avcodec_parameters_from_context(stream->codecpar, encoder));
  check(avio_open(&file->pb, path.c_str(), AVIO_FLAG_WRITE));
  check(avformat_write_header(file, nullptr));
  AVFrame* picture = av_frame_alloc();
  AVPacket* packet = av_packet_alloc();
  int written = 0;
  for (int i = 0; i <= frames; ++i) {
    if (i < frames) {
      picture->format = encoder->pix_fmt;
      picture->width = options.width;
      picture->height = options.height;
      check(av_frame_get_buffer(picture, 0));
      for (int plane = 0; plane < 3; ++plane)
        for (int y = 0; y < options.height >> (plane > 0); ++y)
          for (int x = 0; x < options.width >> (plane > 0); ++x)
            picture->data[plane][y * picture->linesize[plane] + x] =
                static_cast<std::uint8_t>(options.pixel(i, x << (plane > 0), y << (plane > 0))[plane]);
      picture->pts = options.times.empty() ? i : options.times[static_cast<std::size_t>(i)];
    }
    check(avcodec_send_frame(encoder, i < frames ? picture : nullptr));
    while (avcodec_receive_packet(encoder, packet) == 0) {
      av_packet_rescale_ts(packet, encoder->time_base, stream->time_base);
      if (written++ == options.damaged) std::fill_n(packet->data, packet->size, std::uint8_t{0});
      check(av_interleaved_write_frame(file, packet));
    }
    av_frame_unref(picture);
  }
  check(av_write_trailer(file));
  av_packet_free(&packet);
  av_frame_free(&picture);
  avcodec_free_context(&encoder);
  avio_closep(&file->pb);
  avformat_free_context(file);
}

std::string big_endian(std::uint32_t number) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(number >> shift);
  return bytes;
}

std::string box(const std::string& type, const std::string& body) {
  return big_endian(static_cast<std::uint32_t>(body.size() + 8)) + type + body;
}

/// Passes the first box at `path` ("moov/trak/tkhd") of an MP4 file to `change`. The box may get another length, as
/// "moov" is the file's last box.
void change_box(std::string& file, const std::string& path, const std::function<void(std::string&)>& change) {
  const std::string type = path.substr(0, 4);
  const std::size_t at = file.find(type);
  if (at == std::string::npos || at < 4) throw Error("has no box " + type);
  std::size_t size = 0;
  for (int i = 0; i < 4; ++i) size = size << 8 | static_cast<unsigned char>(file[at - 4 + i]);
  std::string body = file.substr(at + 4, size - 8);
  if (path.size() > 4)
    change_box(body, path.substr(5), change);
  else
    change(body);
  file.replace(at - 4, size, box(type, body));
}

constexpr int kPictures = 50;

cv::Mat picture_at(Images& images, int frame) {
  Bytes bytes;
  images.read(frame, bytes);
  return decode_image(bytes, images.name(frame));
}

/// Returns the number that a picture of write_film() holds: Y is 20 + 4 i, and 255 / 219 (Y - 16) the brightness.
int number_of(Images& images, int frame) {
  const int brightness = picture_at(images, frame).at<cv::Vec3b>(24, 32)[1];
  return static_cast<int>(std::lround((brightness * 219 / 255.0 + 16 - 20) / 4));
}

std::vector<int> counted(int from, int count) {
  std::vector<int> numbers(static_cast<std::size_t>(count));
  std::iota(numbers.begin(), numbers.end(), from);
  return numbers;
}

/// Expects these numbers in the pictures, read in order and at random.
void expect_numbers(Images& images, const std::vector<int>& numbers) {
  ASSERT_EQ(images.frames(), static_cast<int>(numbers.size()));
  for (int frame = 0; frame < images.frames(); ++frame)
    EXPECT_EQ(number_of(images, frame), numbers[static_cast<std::size_t>(frame)]) << frame;
  std::mt19937 random(1);
  for (int i = 0; i < 60; ++i) {
    const int frame = static_cast<int>(random() % numbers.size());
    EXPECT_EQ(number_of(images, frame), numbers[static_cast<std::size_t>(frame)]) << frame;
  }
}

/// Takes the edit list out of a track's box.
void without_edits(std::string& track) {
  if (const std::size_t at = track.find("edts"); at != std::string::npos) track.replace(at, 4, "free");
}

struct Container {
  const char *suffix, *codec;
  int b_frames;
};
class EveryContainer : public ::testing::TestWithParam<Container> {};

TEST_P(EveryContainer, HasItsPicturesInOrderAndAtRandom) {
  const Folder folder;
  const std::string path = folder / (std::string("x.") + GetParam().suffix);
  FilmOptions options;
  options.codec = GetParam().codec;
  options.b_frames = GetParam().b_frames;
  write_film(path, kPictures, options);
  std::vector<double> times;
  const auto images = video_frames(path, folder.path(), &times);
  expect_numbers(*images, counted(0, kPictures));
  ASSERT_EQ(times.size(), static_cast<std::size_t>(kPictures));
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_NEAR(times[i] - times[0], static_cast<double>(i) / 25, 0.0011);
}

INSTANTIATE_TEST_SUITE_P(Video, EveryContainer,
                         ::testing::Values(Container{"mp4", "mpeg4", 2}, Container{"mkv", "mpeg4", 2},
                                           Container{"avi", "mpeg4", 2}, Container{"avi", "mpeg4", 0},
                                           Container{"ts", "mpeg2video", 2}, Container{"m2ts", "mpeg2video", 2},
                                           Container{"mpg", "mpeg2video", 2}, Container{"vob", "mpeg2video", 2},
                                           Container{"avi", "ffv1", 0}, Container{"mkv", "ffv1", 0}),
                         [](const auto& given) {
                           return std::string(given.param.suffix) + "_" + given.param.codec + "_" +
                                  std::to_string(given.param.b_frames);
                         });

TEST(VideoTimes, AreThePicturesOwn) {
  FilmOptions options;
  options.b_frames = 2;
  for (int i = 0; i < kPictures; ++i) options.times.push_back(i < 20 ? 3 * i : 40 + i);
  for (const char* name : {"x.mp4", "x.mkv", "x.mov"}) {
    const Folder folder;
    write_film(folder / name, kPictures, options);
    std::vector<double> times;
    const auto images = video_frames(folder / name, "", &times);
    expect_numbers(*images, counted(0, kPictures));
    for (std::size_t i = 0; i < times.size(); ++i) EXPECT_NEAR(times[i], options.times[i] / 25.0, 0.0011) << name << i;
  }
}

TEST(VideoTimes, FollowTheBoxThatGivesDurations) {
  const Folder folder;
  write_film(folder / "x.mp4", kPictures);
  std::string film = contents(folder / "x.mp4");
  std::uint32_t step = 0;
  change_box(film, "moov/trak/mdia/minf/stbl/stts", [&](std::string& body) {
    for (int i = 12; i < 16; ++i) step = step << 8 | static_cast<unsigned char>(body[static_cast<std::size_t>(i)]);
    body = big_endian(0) + big_endian(2) + big_endian(30) + big_endian(step) + big_endian(20) + big_endian(3 * step);
  });
  change_box(film, "moov/trak", without_edits);  // their durations were the old ones
  make_file(folder / "x.mp4", film);
  std::vector<double> times;
  const auto images = video_frames(folder / "x.mp4", "", &times);
  expect_numbers(*images, counted(0, kPictures));
  EXPECT_NEAR(times[29], 29 / 25.0, 1e-6);
  EXPECT_NEAR(times[30], 30 / 25.0, 1e-6);
  EXPECT_NEAR(times[49], 30 / 25.0 + 3 * 19 / 25.0, 1e-6);
}

/// A copy from second .6 on has the packets from the key frame before, of which the first ones are not shown.
TEST(VideoCut, HidesWhatTheEditListHides) {
  const Folder folder;
  write_film(folder / "x.mp4", kPictures);
  std::string film = contents(folder / "x.mp4");
  std::uint32_t unit = 0;
  change_box(film, "moov/trak/mdia/mdhd", [&](std::string& body) {
    for (int i = 12; i < 16; ++i) unit = unit << 8 | static_cast<unsigned char>(body[static_cast<std::size_t>(i)]);
  });
  change_box(film, "moov/trak", [&](std::string& body) {
    without_edits(body);
    body += box("edts", box("elst", big_endian(0) + big_endian(1) + big_endian(35 * 40) + big_endian(15 * unit / 25) +
                                        big_endian(0x10000)));
  });
  make_file(folder / "x.mp4", film);
  std::vector<double> times;
  expect_numbers(*video_frames(folder / "x.mp4", "", &times), counted(15, 35));
  EXPECT_NEAR(times[0], 0, 1e-6);
  EXPECT_NEAR(times[34], 34 / 25.0, 1e-6);
}

TEST(VideoCut, BeginsWithTheFirstPictureThatIsWhole) {
  const Folder folder;
  FilmOptions options;
  options.codec = "mpeg2video";
  options.b_frames = 2;
  write_film(folder / "x.ts", kPictures, options);
  const std::string film = contents(folder / "x.ts");
  make_file(folder / "x.ts", film.substr(film.size() / 2 / 188 * 188));
  const auto images = video_frames(folder / "x.ts", "");
  const int first = number_of(*images, 0);
  EXPECT_GT(first, 10);
  expect_numbers(*images, counted(first, kPictures - first));
}

TEST(VideoJoined, GoesOnWhereTheFirstPartEnds) {
  const Folder folder;
  FilmOptions options;
  options.codec = "mpeg2video";
  options.b_frames = 2;
  write_film(folder / "x.ts", 20, options);
  make_file(folder / "x.ts", contents(folder / "x.ts") + contents(folder / "x.ts"));
  std::vector<double> times;
  std::vector<int> numbers = counted(0, 20);
  numbers.insert(numbers.end(), numbers.begin(), numbers.begin() + 20);
  expect_numbers(*video_frames(folder / "x.ts", "", &times), numbers);
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_NEAR(times[i], static_cast<double>(i) / 25, 1e-4);
}

/// A quarter of a picture each: upper left, upper right, lower left, lower right.
using Quarters = std::array<int, 4>;

TEST(VideoTurn, FollowsTheMatrixOnce) {
  const Folder folder;
  FilmOptions options;
  options.pixel = [](int, int x, int y) { return std::array{40 + (x < 32 ? 0 : 50) + (y < 24 ? 0 : 100), 128, 128}; };
  write_film(folder / "x.mp4", 3, options);
  const std::string film = contents(folder / "x.mp4");
  const Quarters marks{1, 2, 3, 4};  // as stored
  std::set<std::uint64_t> fingerprints;
  struct Case {
    std::array<int, 4> matrix;  // a b c d: (x, y) goes to (a x + c y, b x + d y)
    Quarters shown;
  };
  for (const auto& [matrix, shown] :
       {Case{{1, 0, 0, 1}, marks}, Case{{0, 1, -1, 0}, {3, 1, 4, 2}}, Case{{-1, 0, 0, -1}, {4, 3, 2, 1}},
        Case{{0, -1, 1, 0}, {2, 4, 1, 3}}, Case{{-1, 0, 0, 1}, {2, 1, 4, 3}}, Case{{1, 0, 0, -1}, {3, 4, 1, 2}},
        Case{{0, 1, 1, 0}, {1, 3, 2, 4}}, Case{{0, -1, -1, 0}, {4, 2, 3, 1}}}) {
    std::string turned = film;
    change_box(turned, "moov/trak/tkhd", [&, given = matrix](std::string& body) {
      for (int i = 0; i < 4; ++i)
        body.replace(40 + static_cast<std::size_t>(i < 2 ? 4 * i : 4 + 4 * i), 4,
                     big_endian(static_cast<std::uint32_t>(given[static_cast<std::size_t>(i)] * 65536)));
    });
    make_file(folder / "turned.mp4", turned);
    const auto images = video_frames(folder / "turned.mp4", "");
    EXPECT_TRUE(fingerprints.insert(images->fingerprint(0)).second);  // features of another turn are other features
    for (const int frame : {2, 0, 1}) {
      const cv::Mat picture = picture_at(*images, frame);
      EXPECT_EQ(picture.size(), matrix[0] != 0 ? cv::Size(64, 48) : cv::Size(48, 64));
      Quarters seen{};
      for (int i = 0; i < 4; ++i) {
        const int y = picture.rows * (i / 2 * 2 + 1) / 4, x = picture.cols * (i % 2 * 2 + 1) / 4;
        seen[static_cast<std::size_t>(i)] = (picture.at<cv::Vec3b>(y, x)[1] + 1) / 58 + 1;  // of 28, 86, 144, 202
      }
      EXPECT_EQ(seen, shown) << matrix[0] << matrix[1] << matrix[2] << matrix[3];
    }
  }
}

TEST(VideoColours, FollowTheTags) {
  struct Case {
    AVColorSpace matrix;
    AVColorRange range;
    cv::Vec3b bgr;  // of Y 81, U 110, V 180, by the standards' formulas
  };
  for (const auto& [matrix, range, bgr] : {Case{AVCOL_SPC_BT709, AVCOL_RANGE_MPEG, {38, 52, 169}},
                                           Case{AVCOL_SPC_SMPTE170M, AVCOL_RANGE_MPEG, {39, 40, 159}},
                                           Case{AVCOL_SPC_BT2020_NCL, AVCOL_RANGE_MPEG, {37, 45, 163}},
                                           Case{AVCOL_SPC_BT709, AVCOL_RANGE_JPEG, {48, 60, 163}},
                                           Case{AVCOL_SPC_SMPTE170M, AVCOL_RANGE_JPEG, {49, 50, 154}},
                                           Case{AVCOL_SPC_UNSPECIFIED, AVCOL_RANGE_UNSPECIFIED, {39, 40, 159}}}) {
    const Folder folder;
    FilmOptions options;
    options.codec = "ffv1";
    options.matrix = matrix;
    options.range = range;
    options.pixel = [](int, int, int) { return std::array{81, 110, 180}; };
    write_film(folder / "x.mkv", 2, options);
    const cv::Vec3b seen = picture_at(*video_frames(folder / "x.mkv", ""), 1).at<cv::Vec3b>(24, 32);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(seen[i], bgr[i], 2) << matrix << " " << range << " " << i;
  }
}

TEST(VideoFaults, AreOneClearLine) {
  const Folder folder;
  const auto told = [&](const std::string& name) {
    return error_of([&] { video_frames(folder / name, folder.path()); });
  };
  make_file(folder / "empty.mp4", "");
  EXPECT_EQ(told("empty.mp4"), "empty.mp4: an empty file");
  make_file(folder / "text.mp4", "no video at all");
  EXPECT_EQ(told("text.mp4"),
            "text.mp4: the video cannot be opened: Invalid data found when processing input (broken, "
            "or of a kind that FFmpeg does not know)");
  std::filesystem::create_directory(folder / "folder.mp4");
  EXPECT_TRUE(contains(told("folder.mp4"), "folder.mp4: is a folder, not a file"));
  EXPECT_TRUE(contains(told("none.mp4"), "none.mp4: the video cannot be opened: No such file"));
  // A playlist is no film, wherever it leads.
  write_film(folder / "x.ts", 5, {.codec = "mpeg2video"});
  make_file(folder / "list.mp4", "#EXTM3U\n#EXT-X-TARGETDURATION:8\n#EXTINF:8,\nx.ts\n#EXT-X-ENDLIST\n");
  EXPECT_TRUE(contains(told("list.mp4"), "list.mp4: the video cannot be opened")) << told("list.mp4");
  const std::string samples(4000, '\0');
  const std::string format("\x10\0\0\0\x01\0\x01\0\x40\x1f\0\0\x80\x3e\0\0\x02\0\x10\0", 20);
  make_file(folder / "sound.mp4",
            std::string("RIFF\xc4\x0f\0\0WAVEfmt ", 16) + format + std::string("data\xa0\x0f\0\0", 8) + samples);
  EXPECT_EQ(told("sound.mp4"), "sound.mp4: holds no video (move it out of the folder)");
  write_film(folder / "m.avi", kPictures);
  const std::string whole = contents(folder / "m.avi");
  make_file(folder / "m.avi", whole.substr(0, whole.size() / 2));
  EXPECT_TRUE(told("m.avi").starts_with("m.avi: ends early, after 2")) << told("m.avi");
}

TEST(VideoFaults, AFrameThatCannotBeDecodedKeepsItsNumber) {
  for (const auto& [codec, name] : {std::pair{"mpeg4", "x.mp4"}, {"libaom-av1", "x.mkv"}}) {
    const Folder folder;
    FilmOptions options;
    options.codec = codec;
    options.key_every = 1;
    options.damaged = 3;
    write_film(folder / name, 30, options);
    const auto images = video_frames(folder / name, folder.path());
    ASSERT_EQ(images->frames(), 30) << codec;
    for (int frame = 0; frame < 30; ++frame)
      if (frame == 3)
        EXPECT_TRUE(contains(error_of([&] { picture_at(*images, 3); }), "frame 3: cannot be decoded")) << codec;
      else
        EXPECT_EQ(number_of(*images, frame), frame) << codec;
  }
}

TEST(VideoFaults, FramesThatReferToADamagedOneAreRefusedToo) {
  const Folder folder;
  FilmOptions options;
  options.key_every = 10;
  options.damaged = 3;
  options.pixel = [](int frame, int x, int y) {  // mostly the same, so that encoders let pictures refer to others
    const bool middle = x >= 24 && x < 40 && y >= 16 && y < 32;
    return std::array{middle ? 20 + 4 * frame : 60 + (x * 37 + y * 59 + (y < 8 ? 31 * frame : 0)) % 101, 128, 128};
  };
  write_film(folder / "x.mp4", 30, options);
  const auto images = video_frames(folder / "x.mp4", folder.path());
  for (const int frame : {0, 1, 2, 3, 4, 9, 10, 29, 5, 2, 12})
    if (frame >= 3 && frame < 10)
      EXPECT_TRUE(contains(error_of([&] { picture_at(*images, frame); }), "cannot be decoded")) << frame;
    else
      EXPECT_EQ(number_of(*images, frame), frame);
}

}  // namespace
}  // namespace citylearn::testing
