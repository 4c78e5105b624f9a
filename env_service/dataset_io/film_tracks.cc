// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <opencv2/imgproc.hpp>
#include <regex>
#include <string_view>

#include "env_service/dataset_io/tracks.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"
#include "env_service/images/film_file.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

using TracksByKind = std::map<std::string, GpsRows>;         // the kind with the best fixes is the last one
constexpr unsigned kMinFix = 2;                              // of GPSF and GPS9: 2 has no height, 3 has one
constexpr int kMaxNesting = 8;                               // of GPMF: cameras write 2
constexpr std::size_t kMaxSubtitle = 2000;                   // bytes
constexpr int kMotionSamples = 50;                           // pictures of a film whose motion is measured
constexpr std::size_t kMinMotionSamples = 20;                // that have a place: fewer prove nothing
constexpr double kMotionStep = 0.1;                          // seconds: some films repeat pictures
constexpr double kMinMotionFit = 0.6, kMinMotionLead = 0.4;  // correlations, of the better fit and over the other

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
                        fix ? static_cast<double>(big_endian(sample + 4, 4)) / longitude_scale : kUnknown,
                        fix && scales.size() > 2 && scales[2] != 0
                            ? static_cast<double>(big_endian(sample + 8, 4)) / scales[2]
                            : kUnknown);
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

/// A moment of a film and how much its pictures change then, 0 to 255.
using Motion = std::pair<double, double>;

std::vector<Motion> motion_of(const Traversal& film) {
  Bytes bytes;
  const auto grey = [&](std::size_t frame) {
    film.images->read(static_cast<int>(frame), bytes);
    cv::Mat small, picture = decode_image(bytes, film.images->name(static_cast<int>(frame)));
    cv::resize(picture, small, cv::Size(64, 48), 0, 0, cv::INTER_AREA);
    cv::cvtColor(small, small, cv::COLOR_BGR2GRAY);
    return small;
  };
  std::vector<Motion> motion;
  const std::vector<double>& times = film.times;
  for (int i = 0; i < kMotionSamples; ++i) try {
      const std::size_t frame = times.size() * static_cast<std::size_t>(i) / kMotionSamples;
      const auto next = std::lower_bound(times.begin(), times.end(), times[frame] + kMotionStep);
      if (next == times.end()) break;
      const cv::Mat before = grey(frame), after = grey(static_cast<std::size_t>(next - times.begin()));
      motion.emplace_back(times[frame], cv::norm(before, after, cv::NORM_L1) / static_cast<double>(before.total()));
    } catch (const Error&) {  // a damaged picture: reading the film tells of it
    }
  return motion;
}

/// Returns the correlation of a film's motion and the speed on the track where second 0 of the film is at `start` of
/// it; 0 where that cannot be told. The highest tenth of each counts as equal: cuts, and wrong fixes.
double motion_fit(const std::vector<Motion>& motion, const GpsRows& rows, double start, double reach) {
  std::vector<double> moments;
  for (const Motion& at : motion) moments.insert(moments.end(), {start + at.first - 1, start + at.first + 1});
  const std::vector<double> latitude = interpolate(rows.times, rows.latitude, moments, reach),
                            longitude = interpolate_longitude(rows.times, rows.longitude, moments, reach);
  std::array<std::vector<double>, 2> values;
  for (std::size_t i = 0; i < motion.size(); ++i) {
    const double way = metres_between(latitude[2 * i], longitude[2 * i], latitude[2 * i + 1], longitude[2 * i + 1]);
    if (std::isnan(way)) continue;
    values[0].push_back(motion[i].second);
    values[1].push_back(way);
  }
  const std::size_t count = values[0].size();
  if (count < kMinMotionSamples) return 0;
  for (std::vector<double>& series : values) {
    std::vector<double> sorted = series;
    std::sort(sorted.begin(), sorted.end());
    double mean = 0;
    for (double& value : series) mean += (value = std::min(value, sorted[count * 9 / 10])) / static_cast<double>(count);
    for (double& value : series) value -= mean;
  }
  double squares[2] = {0, 0}, products = 0;
  for (std::size_t i = 0; i < count; ++i) {
    products += values[0][i] * values[1][i];
    for (const int k : {0, 1}) squares[k] += values[k][i] * values[k][i];
  }
  const double scale = std::sqrt(squares[0] * squares[1]);
  return scale > 1e-9 ? products / scale : 0;
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

double find_film_start(const Traversal& film, const GpsRows& rows, double reach, const std::string& where) {
  const double first = film.times[0], length = film.times.back();
  const double begin = rows.times.front() - reach, end = rows.times.back() + reach;
  if (length <= 2 * reach || first - length < begin || end < 0) return 0;  // too short to matter, or not at its end
  if (first + length / 10 > rows.times.back()) {
    spdlog::warn("{}: creation_time is taken as its end, as the track ends about then or before", where);
    return -length;
  }
  const std::vector<Motion> motion = motion_of(film);
  const double at_start = motion_fit(motion, rows, 0, reach), at_end = motion_fit(motion, rows, -length, reach);
  if (at_end >= kMinMotionFit && at_end - at_start >= kMinMotionLead) {
    spdlog::warn("{}: creation_time is taken as its end: its motion fits the speed on the track {:.2f} against {:.2f}",
                 where, at_end, at_start);
    return -length;
  }
  if (at_start < kMinMotionFit || at_start - at_end < kMinMotionLead)
    spdlog::warn(
        "{}: creation_time is taken as its start, but it may be its end: motion fits the track's speed {:.2f} and "
        "{:.2f}; if it is, give --plain-clock-offset {:.0f}, else .001",
        where, at_start, at_end, -length);
  return 0;
}

}  // namespace citylearn
