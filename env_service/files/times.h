// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string_view>
#include <vector>

namespace citylearn {

inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();  ///< a number that is not told

/// A moment as a file tells it.
struct Moment {
  double seconds = 0;  ///< since 1970 on the clock of its zone; NaN where it is not told
  double zone = 0;     ///< seconds by which that clock is ahead of UTC; NaN where it is not told
  /// Returns seconds since 1970 in UTC, which is meant where no zone is told.
  double utc() const { return zone == zone ? seconds - zone : seconds; }
};

/// Reads "2026-06-30T23:59:10.25+02:00" (ISO 8601) or "2026:06:30 23:59:10" (EXIF). A fraction has any digits, a zone
/// is Z, +02:00, +0200 or +02; the time may be missing. `seconds` is NaN when the text is neither, or no such day
/// exists.
Moment read_moment(std::string_view text);
/// Returns the seconds of a zone; NaN when it is none.
double read_zone(std::string_view text);
/// Returns the indices of times, given in the order of a recording, that are not of it: out of order, and an hour or
/// more from all others. None where these are more than one and a twentieth of all.
std::vector<std::size_t> stray_times(const std::vector<double>& times);
/// Removes rows with such times, and returns how many.
template <class Row, class TimeOf>
int erase_strays(std::vector<Row>& rows, TimeOf time_of) {
  std::vector<double> times;
  for (const Row& row : rows) times.push_back(time_of(row));
  const std::vector<std::size_t> strays = stray_times(times);
  for (std::size_t i = strays.size(); i-- > 0;) rows.erase(rows.begin() + static_cast<std::ptrdiff_t>(strays[i]));
  return static_cast<int>(strays.size());
}

}  // namespace citylearn
