// SPDX-License-Identifier: Apache-2.0
#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

#include <array>
#include <functional>
#include <string>
#include <vector>

#include "core/util/error.h"
#include "tests/support/files.h"

// Films of which every picture is known, written with libav, and boxes of MP4 files that are written by hand.

namespace citylearn::testing {

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
};

/// Writes a film of yuv420p. The suffix of the path names the container.
inline void write_film(const std::string& path, int frames, const FilmOptions& options = {}) {
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

inline std::string big_endian(std::uint32_t number) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(number >> shift);
  return bytes;
}

inline std::string box(const std::string& type, const std::string& body) {
  return big_endian(static_cast<std::uint32_t>(body.size() + 8)) + type + body;
}

/// Passes the first box at `path` ("moov/trak/tkhd") of an MP4 file to `change`. The box may get another length, as
/// "moov" is the file's last box.
inline void change_box(std::string& file, const std::string& path, const std::function<void(std::string&)>& change) {
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

}  // namespace citylearn::testing
