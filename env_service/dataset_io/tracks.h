// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "env_service/dataset_io/folder_dataset.h"

namespace citylearn {

/// A point of a receiver's track.
struct TrackPoint {
  double time = 0;                                           ///< seconds since 1970 in UTC; NaN: not told
  double latitude = 0, longitude = 0;                        ///< degrees; NaN: no fix
  bool begins = false;                                       ///< the first of a segment: the receiver was off before
  double height = std::numeric_limits<double>::quiet_NaN();  ///< metres; NaN: not told
};

/// Endings of the tracks that read_track() reads, in the order in which one is preferred.
const std::vector<std::string>& track_suffixes();

/// Reads a track by its ending: .gpx, .nmea, .kml or .geojson. Returns its fixes by time, with a row of unknown place
/// where a segment ends, or fixes do, and the next one begins more than 10 s later. Points without time are left out
/// and counted in a warning. `near`, seconds since 1970, tells the day of logs that have only hours. Throws Error
/// naming the file: broken, a place beyond the earth, or no point with a time.
GpsRows read_track(const std::string& path, double near);

/// Returns the track that a film holds itself, or a file of subtitles, in seconds of the film: GoPro's GPS9, else GPS5
/// (GPMF), or places in DJI's subtitles; `kind` says which. Rows without a fix are of unknown place. Empty when there
/// is none, or the file is not a film.
GpsRows read_film_track(const std::string& path, std::string& kind);

/// Returns when a film began, in seconds from its creation_time, which some telephones write at its end: about 0, or
/// minus its length. `rows` is a track on the clock of creation_time that tells places up to `reach` seconds beyond its
/// ends. Where both would do, the film moves as the track does: at most 50 pictures and those 1/10 s later are
/// compared. Up to 3 s of clock error are mended, to about .2 s, where speed changes: at most six stretches of 8 s are
/// looked at. Logs that the end is taken, what is mended, or that neither fits clearly better. `where` names the film.
double find_film_start(const Traversal& film, const GpsRows& rows, double reach, const std::string& where);
/// Returns where on a track a film began that does not say it, where its motion fits there alone; else says in `why`
/// what is missing.
std::optional<double> search_film_start(const Traversal& film, const GpsRows& rows, double reach, std::string& why);

/// Reads the fixes of NMEA 0183: GGA, else RMC, of the receiver that has most of them in the best quality; days are
/// those of RMC or ZDA, else of `near`. Sentences with a wrong checksum count in `broken`.
std::vector<TrackPoint> read_nmea(std::string_view text, double near, int& broken);

}  // namespace citylearn
