// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <regex>

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
constexpr double kMotionStep = 0.09;                         // seconds (some films repeat pictures), under .1: rounding
constexpr double kMinMotionFit = 0.6, kMinMotionLead = 0.4;  // correlations, of the better fit and over the other
constexpr double kClockError = 3, kCoarseStep = 0.5;         // seconds by which a film's clock may be off, and between
constexpr double kFineStep = 0.01, kFineReach = 1.5;         // ... those that are tried, then about the best
constexpr double kMinFineFit = 0.8;                          // correlation with a clock that is trusted more finely
constexpr double kFlat = 0.5, kMinFall = 0.01;  // seconds from the best fit, and by how much it is worse there
constexpr double kStretch = 4;                  // seconds before and after a change of speed that are looked at
constexpr std::size_t kMaxStretches = 6;
constexpr double kSaturations[] = {1e3, 0.5, 0.15};  // shares of the highest speed at which half of all changes is seen
constexpr double kMinSearched = 20;                  // seconds of a film that does not say when it began
constexpr double kMinLead = 0.15, kOneClock = 5;     // fit over those at clocks that differ by so many seconds

std::int64_t big_endian(const std::uint8_t* at, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | at[i];
  return bytes == 4 ? static_cast<std::int32_t>(value) : static_cast<std::int64_t>(value);
}

/// GPMF (gopro/gpmf-parser): elements of a key, a type, a structure's size, their number and data, padded to 4 bytes.
/// GPS5 and GPS9 hold latitude, longitude and height, divided by the first numbers of SCAL; GPS9 has a fix of its own,
/// for GPS5 GPSF tells it. The samples of a packet are spread over its time.
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

cv::Mat grey_picture(const Traversal& film, std::size_t frame) {
  Bytes bytes;
  film.images->read(static_cast<int>(frame), bytes);
  cv::Mat small, picture = decode_image(bytes, film.images->name(static_cast<int>(frame)));
  cv::resize(picture, small, cv::Size(64, 48), 0, 0, cv::INTER_AREA);
  cv::cvtColor(small, small, cv::COLOR_BGR2GRAY);
  return small;
}

/// Returns the first frame at or after a time; the number of frames where there is none.
std::size_t frame_from(const Traversal& film, double time) {
  return static_cast<std::size_t>(std::lower_bound(film.times.begin(), film.times.end(), time) - film.times.begin());
}

double change(const cv::Mat& before, const cv::Mat& after) {
  return cv::norm(before, after, cv::NORM_L1) / static_cast<double>(before.total());
}

/// Sets the highest tenth to the lowest of these: cuts, and wrong fixes.
void clip(std::vector<double>& values) {
  std::vector<double> sorted = values;
  const auto most = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 9 / 10);
  std::nth_element(sorted.begin(), most, sorted.end());
  for (double& value : values) value = std::min(value, *most);
}

/// Returns the motion at moments all over a film.
std::vector<Motion> motion_of(const Traversal& film) {
  std::vector<Motion> motion;
  for (int i = 0; i < kMotionSamples; ++i) try {
      const std::size_t frame = film.times.size() * static_cast<std::size_t>(i) / kMotionSamples;
      const std::size_t next = frame_from(film, film.times[frame] + kMotionStep);
      if (next == film.times.size()) break;
      motion.emplace_back(film.times[frame], change(grey_picture(film, frame), grey_picture(film, next)) /
                                                 (film.times[next] - film.times[frame]));
    } catch (const Error&) {  // a damaged picture: reading the film tells of it
    }
  return motion;
}

/// Returns the motion a second about a moment of a film, each the mean of those up to a second before and after.
std::vector<Motion> motion_about(const Traversal& film, double moment) {
  std::vector<double> times, changes;
  cv::Mat before;
  double last = 0;
  for (std::size_t frame = frame_from(film, moment - kStretch);
       frame < film.times.size() && film.times[frame] <= moment + kStretch;
       frame = frame_from(film, film.times[frame] + kMotionStep)) {
    const cv::Mat now = grey_picture(film, frame);
    if (!before.empty()) {
      times.push_back((last + film.times[frame]) / 2);
      changes.push_back(change(before, now) / (film.times[frame] - last));
    }
    before = now;
    last = film.times[frame];
  }
  if (changes.empty()) return {};
  clip(changes);
  std::vector<Motion> motion;
  for (const double time : times) {
    if (time < times.front() + 1 || time > times.back() - 1) continue;
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < times.size(); ++i)
      if (std::abs(times[i] - time) <= 1) sum += changes[i], ++count;
    motion.emplace_back(time, sum / count);
  }
  return motion;
}

double correlation(std::vector<double> a, std::vector<double> b) {
  for (std::vector<double>* const series : {&a, &b}) {
    const double mean = std::accumulate(series->begin(), series->end(), 0.0) / static_cast<double>(series->size());
    for (double& value : *series) value -= mean;
  }
  const auto product = [](const auto& x, const auto& y) {
    return std::inner_product(x.begin(), x.end(), y.begin(), 0.0);
  };
  const double scale = std::sqrt(product(a, a) * product(b, b));
  return scale > 1e-9 ? product(a, b) / scale : 0;
}

/// A track whose speed is compared with the motion of a film.
class SpeedMatch {
 public:
  SpeedMatch(const GpsRows& rows, double reach) : times_(rows.times), reach_(reach) {
    const std::vector<float> along = metres_along(rows.latitude, rows.longitude);
    along_.assign(along.begin(), along.end());
  }

  /// Returns the correlation of a film's motion and the speed where second 0 of the film is at `start` of the track,
  /// the highest of those with speeds above which pictures hardly change more; 0 where that cannot be told.
  double fit(const std::vector<Motion>& motion, double start) const {
    std::vector<double> moments;
    for (const Motion& at : motion) moments.insert(moments.end(), {start + at.first - 1, start + at.first + 1});
    const std::vector<double> metres = interpolate(times_, along_, moments, reach_);
    std::array<std::vector<double>, 2> values;
    for (std::size_t i = 0; i < motion.size(); ++i) {
      const double way = metres[2 * i + 1] - metres[2 * i];
      if (std::isnan(way)) continue;
      values[0].push_back(motion[i].second);
      values[1].push_back(way);
    }
    const std::size_t count = values[0].size();
    if (count < kMinMotionSamples) return 0;
    for (std::vector<double>& series : values) clip(series);
    const double most = *std::max_element(values[1].begin(), values[1].end());
    double best = 0;
    for (const double share : kSaturations) {
      std::vector<double> speeds;
      for (const double speed : values[1]) speeds.push_back(speed / (speed + share * most + 1e-9));
      best = std::max(best, correlation(values[0], speeds));
    }
    return best;
  }

  /// A start of the film, and how well it fits.
  struct Found {
    double fit, start;
  };
  Found best(const std::vector<Motion>& motion, double from, double to, double step) const {
    Found found{-1, from};
    for (double start = from; start <= to; start += step)
      if (const double now = fit(motion, start); now > found.fit) found = {now, start};
    return found;
  }

  /// Returns the start to about .2 s where changes of speed tell it, which is about the one given.
  std::optional<double> refined(const Traversal& film, double start) const {
    std::vector<Motion> motion;
    for (const double moment : changes_of_speed(film.times.front(), film.times.back(), start)) try {
        const std::vector<Motion> more = motion_about(film, moment);
        motion.insert(motion.end(), more.begin(), more.end());
      } catch (const Error&) {  // a damaged picture: reading the film tells of it
      }
    const Found found = best(motion, start - kFineReach, start + kFineReach, kFineStep);
    const double beside = std::max(fit(motion, found.start - kFlat), fit(motion, found.start + kFlat));
    if (found.fit < kMinFineFit || found.fit - beside < kMinFall) return std::nullopt;
    return found.start;
  }

 private:
  /// Returns moments of a film about which the speed changes most.
  std::vector<double> changes_of_speed(double first, double last, double start) const {
    std::vector<double> moments, chosen;
    std::vector<std::pair<double, double>> changes;
    for (double at = first + kStretch; at <= last - kStretch; at += kCoarseStep)
      moments.insert(moments.end(), {start + at - 2, start + at - 1, start + at + 1, start + at + 2});
    const std::vector<double> metres = interpolate(times_, along_, moments, reach_);
    for (std::size_t i = 0; i + 3 < metres.size(); i += 4)
      if (const double more = std::abs(metres[i + 3] - metres[i + 2] - metres[i + 1] + metres[i]); more > 0)
        changes.emplace_back(more, moments[i] + 2 - start);
    std::sort(changes.rbegin(), changes.rend());
    for (const auto& [more, at] : changes)
      if (chosen.size() < kMaxStretches && std::none_of(chosen.begin(), chosen.end(), [&](double other) {
            return std::abs(other - at) < 2 * kStretch - 2;
          }))
        chosen.push_back(at);
    std::sort(chosen.begin(), chosen.end());
    return chosen;
  }

  const std::vector<double> times_;
  std::vector<double> along_;  // metres
  const double reach_;
};

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
  if (length <= 2 * reach || begin > length || end < 0) return 0;  // too short to matter, or of another time
  const bool may_end = first - length >= begin;
  const SpeedMatch match(rows, reach);
  const auto mended = [&](double start, double about) {
    const double found = match.refined(film, about).value_or(start);
    if (std::abs(found - start) * 2 * static_cast<double>(film.frames) < length) return start;  // half a picture
    spdlog::info("{}: its clock is taken to be {:.2f} s {} the track's, as its motion fits the speed there", where,
                 std::abs(found - start), found > start ? "behind" : "ahead of");
    return found;
  };
  if (may_end && first + length / 10 > rows.times.back()) {
    spdlog::warn("{}: creation_time is taken as its end, as the track ends about then or before", where);
    return mended(-length, -length);
  }
  const std::vector<Motion> motion = motion_of(film);
  const auto at_start = match.best(motion, -kClockError, kClockError, kCoarseStep),
             at_end = may_end ? match.best(motion, -length - kClockError, -length + kClockError, kCoarseStep)
                              : SpeedMatch::Found{0, -length};
  if (at_end.fit >= kMinMotionFit && at_end.fit - at_start.fit >= kMinMotionLead) {
    spdlog::warn("{}: creation_time is taken as its end: its motion fits the speed on the track {:.2f} against {:.2f}",
                 where, at_end.fit, at_start.fit);
    return mended(-length, at_end.start);
  }
  if (at_start.fit >= kMinMotionFit && at_start.fit - at_end.fit >= kMinMotionLead) return mended(0, at_start.start);
  if (!may_end) return 0;
  spdlog::warn(
      "{}: creation_time is taken as its start, but it may be its end: motion fits the track's speed {:.2f} and "
      "{:.2f}; if it is, give --plain-clock-offset {:.0f}, else .001",
      where, at_start.fit, at_end.fit, -length);
  return 0;
}

std::optional<double> search_film_start(const Traversal& film, const GpsRows& rows, double reach, std::string& why) {
  const double length = film.times.back();
  why = "it is shorter than 20 s";
  if (length < kMinSearched) return std::nullopt;
  const double first = rows.times.front() - length / 4, last = rows.times.back() - 3 * length / 4;
  const SpeedMatch match(rows, reach);
  const std::vector<Motion> motion = motion_of(film);
  const SpeedMatch::Found found = match.best(motion, first, last, kCoarseStep),
                          before = match.best(motion, first, found.start - kOneClock, kCoarseStep),
                          after = match.best(motion, found.start + kOneClock, last, kCoarseStep);
  why =
      "it fits the track's speed " + std::string(found.fit < kMinFineFit ? "nowhere well enough" : "at several times");
  if (found.fit < kMinFineFit || found.fit - std::max(before.fit, after.fit) < kMinLead) return std::nullopt;
  const double start = match.refined(film, found.start).value_or(found.start);
  spdlog::info("{}: begins {:.2f} s after the first point of {}, as its motion fits the speed there", film.name,
               start - rows.times.front(), rows.log);
  return start;
}

}  // namespace citylearn
