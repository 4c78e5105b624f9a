// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdint>
#include <map>
#include <regex>
#include <string_view>

#include "env_service/dataset_io/tracks.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/images/film_file.h"

namespace citylearn {
namespace {

using TracksByKind = std::map<std::string, GpsRows>;  // the kind with the best fixes is the last one
constexpr unsigned kMinFix = 2;                       // of GPSF and GPS9: 2 has no height, 3 has one
constexpr int kMaxNesting = 8;                        // of GPMF: cameras write 2
constexpr std::size_t kMaxSubtitle = 2000;            // bytes

std::int64_t big_endian(const std::uint8_t* at, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | at[i];
  return bytes == 4 ? static_cast<std::int32_t>(value) : static_cast<std::int64_t>(value);
}

/// GPMF (gopro/gpmf-parser): elements of a key, a type, a structure's size, their number and data, padded to 4 bytes.
/// GPS5 and GPS9 hold latitude and longitude, divided by the first numbers of SCAL; GPS9 has a fix of its own, for
/// GPS5 GPSF tells it. The samples of a packet are spread over its time.
void read_gpmf(const std::uint8_t* at, const std::uint8_t* end, double begin, double duration, TracksByKind& tracks,
               int nesting = 0) {
  std::vector<double> scales;
  bool stream_fix = true;
  while (end - at >= 8) {
    const std::string key(at, at + 4);
    const bool nested = at[4] == 0;
    const std::int64_t size = at[5], count = big_endian(at + 6, 2), bytes = size * count;
    if (at += 8; bytes > end - at) return;  // cut short
    if (nested && nesting < kMaxNesting) read_gpmf(at, at + bytes, begin, duration, tracks, nesting + 1);
    if (key == "GPSF" && bytes == 4) stream_fix = big_endian(at, 4) >= kMinFix;
    if (key == "SCAL" && (size == 2 || size == 4))
      for (std::int64_t i = 0; i < count; ++i)
        scales.push_back(static_cast<double>(big_endian(at + i * size, static_cast<int>(size))));
    const bool nine = key == "GPS9" && size >= 32;
    if ((nine || (key == "GPS5" && size >= 20)) && !scales.empty() && scales[0] != 0)
      for (std::int64_t i = 0; i < count; ++i) {
        const std::uint8_t* const sample = at + i * size;
        const bool fix = nine ? big_endian(sample + 30, 2) >= kMinFix : stream_fix;
        const double longitude_scale = scales.size() > 1 && scales[1] != 0 ? scales[1] : scales[0];
        tracks[key].add(begin + duration * static_cast<double>(i) / static_cast<double>(count),
                        fix ? static_cast<double>(big_endian(sample, 4)) / scales[0] : kUnknown,
                        fix ? static_cast<double>(big_endian(sample + 4, 4)) / longitude_scale : kUnknown);
      }
    at += std::min<std::int64_t>((bytes + 3) / 4 * 4, end - at);
  }
}

/// Subtitles as DJI's drones write them: "[latitude: 48.2] [longitude: 11.5]", or "GPS(11.5,48.2,19)".
void read_subtitle(const std::string& text, double time, TracksByKind& tracks) {
  static const std::regex named("latitude *: *([-+0-9.]+)[^]*?longt?itude *: *([-+0-9.]+)"),
      listed("GPS *\\( *([-+0-9.]+) *, *([-+0-9.]+)");
  std::smatch parts;
  const bool by_name = std::regex_search(text, parts, named);
  if (!by_name && !std::regex_search(text, parts, listed)) return;
  const std::string first = parts[1], second = parts[2];
  const double one = field_number({first}, 0), other = field_number({second}, 0);
  tracks["subtitles"].add(time, by_name ? one : other, by_name ? other : one);
}

}  // namespace

GpsRows read_film_track(const std::string& path, std::string& kind) {
  FilmFile film;
  if (film.open(path) < 0) return {};
  const auto tells = [&](const AVStream& stream) {
    return stream.codecpar->codec_type == AVMEDIA_TYPE_SUBTITLE ||
           stream.codecpar->codec_tag == MKTAG('g', 'p', 'm', 'd');
  };
  bool any = false;
  for (unsigned i = 0; i < film.format->nb_streams; ++i) {
    film.format->streams[i]->discard = tells(*film.format->streams[i]) ? AVDISCARD_DEFAULT : AVDISCARD_ALL;
    any = any || tells(*film.format->streams[i]);
  }
  if (!any) return {};
  TracksByKind tracks;
  const Libav<AVPacket> packet(av_packet_alloc());
  for (; av_read_frame(film.format.get(), packet.get()) >= 0; av_packet_unref(packet.get())) {
    const AVStream& stream = *film.format->streams[packet->stream_index];
    if (!tells(stream) || packet->pts == AV_NOPTS_VALUE || packet->size <= 0) continue;
    const double begin = static_cast<double>(packet->pts) * av_q2d(stream.time_base);
    if (stream.codecpar->codec_type == AVMEDIA_TYPE_SUBTITLE)
      read_subtitle(std::string(packet->data, packet->data + std::min<std::size_t>(packet->size, kMaxSubtitle)), begin,
                    tracks);
    else
      read_gpmf(packet->data, packet->data + packet->size, begin,
                static_cast<double>(packet->duration) * av_q2d(stream.time_base), tracks);
  }
  for (auto& [name, rows] : tracks)
    if (const auto known = std::count_if(rows.latitude.begin(), rows.latitude.end(), [](double x) { return x == x; });
        known > 0 && std::is_sorted(rows.times.begin(), rows.times.end())) {
      kind = name;
      rows.log = path;
    }
  return kind.empty() ? GpsRows() : tracks[kind];
}

}  // namespace citylearn
