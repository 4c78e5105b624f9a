// SPDX-License-Identifier: Apache-2.0
#pragma once

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

#include <memory>
#include <string>

namespace citylearn {

struct FreeLibav {
  void operator()(AVFormatContext* it) const { avformat_close_input(&it); }
  void operator()(AVIOContext* it) const { avio_closep(&it); }
  void operator()(AVCodecContext* it) const { avcodec_free_context(&it); }
  void operator()(AVPacket* it) const { av_packet_free(&it); }
  void operator()(AVFrame* it) const { av_frame_free(&it); }
};
/// What libav has made, and frees.
template <class T>
using Libav = std::unique_ptr<T, FreeLibav>;

/// A film, or a file of subtitles, as libav reads it.
struct FilmFile {
  Libav<AVIOContext> bytes;  ///< outlives the format, which reads it
  Libav<AVFormatContext> format;

  /// Opens it, or opens it anew. Returns 0, or libav's error: then `format` is null, and `bytes` too where the file
  /// cannot be read.
  int open(const std::string& path) {
    format.reset();
    AVIOContext* file = nullptr;
    int error = avio_open(&file, ("file:" + path).c_str(), AVIO_FLAG_READ);
    bytes.reset(file);
    if (error < 0) return error;
    AVFormatContext* opened = avformat_alloc_context();
    opened->pb = file;
    AVDictionary* options = nullptr;
    av_dict_set(&options, "protocol_whitelist", "none", 0);  // a playlist opens no other files
    error = avformat_open_input(&opened, path.c_str(), nullptr, &options);
    av_dict_free(&options);
    if (error >= 0) format.reset(opened);
    return error;
  }
};

}  // namespace citylearn
