// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace citylearn {

/// What a photograph says of its own taking, in its EXIF data; NaN where it does not.
struct Taken {
  double local = 0;                    ///< seconds since 1970 of the camera's clock, with fractions
  double zone = 0;                     ///< seconds by which that clock is ahead of UTC
  double gps = 0;                      ///< seconds since 1970 in UTC, by the receiver
  double latitude = 0, longitude = 0;  ///< degrees
};

/// Reads a JPEG, PNG or HEIF file. Not told are: a position whose numbers divide by 0, whose hemisphere is missing or
/// whose receiver says that it is void; the time of the last edit is never taken.
Taken read_taken(const std::string& path);
/// Returns when photographs were taken, seconds since 1970 in UTC; NaN where nothing tells. Zones that are not told
/// follow from the receiver's time, else from the other photographs. A camera's clock that is off by a constant is
/// mended by the receiver's, with a line in the log that names `where`. Dates that are hours from all others are told
/// likewise.
std::vector<double> utc_of(const std::vector<Taken>& photographs, const std::string& where);

}  // namespace citylearn
