// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/task/street_map.h"

namespace citylearn {

/// Where a vehicle was that recorded frames, in metres, NaN where unknown; or where several were, one after the other.
struct Drive {
  std::vector<double> east, north;  ///< F, of a plane
  std::vector<double> height = {};  ///< F; or empty
  std::vector<float> along = {};    ///< F, along the route; they do not grow while it stands
  double receiver = 0;              ///< how far off the places of one spot may be at least, by a receiver; or 0
  std::vector<int> begins = {};     ///< the first frame of each of several drives; or empty
};

/// Frames of a drive that are where it was before: one that crosses the earlier way, or some that run along it.
struct DriveMeeting {
  int first = 0, last = 0;                  ///< frames, one where it crosses
  int earlier_first = 0, earlier_last = 0;  ///< those of the earlier way where these are
  double degrees = 0;                       ///< between both directions in their middle, 0..180
};

/// Streets that drives have run through. A place is where a frame was taken, a link leads to that of the next one as
/// the drive did, and shows what was seen there: of several drives along a street in one direction, the first. Where
/// a drive is at its earlier way, or at that of a drive before it, places of both are one, so that one can go on by
/// either.
struct DriveStreets {
  StreetMap map;            ///< in order, in metres from the first frame
  std::vector<int> shown;   ///< L, the frame of each link
  std::vector<int> places;  ///< F, the place of the map at which each frame was taken; -1: at none
  std::vector<DriveMeeting> meetings;
  double reach = 0;  ///< metres beside the earlier way at which the drive is on it
  int frames = 0;    ///< of the drive
  int apart = 0;     ///< frames at places that cannot be reached from the others, or not left for them
  int unknown = 0;   ///< frames whose place is unknown
  /// Returns lines for a person: what there is and what is left out, then the meetings.
  std::vector<std::string> description() const;
};

/// Returns the largest part of a drive's streets in which each place can be reached from each other one. Where it runs
/// along its earlier way, in either direction, it is on it within 4 of its usual steps from frame to frame, but 1 to
/// 8 m, and `receiver` at least; ways that cross are joined at the frames nearest to where they do. Neither where one
/// is more than 4 m above the other (by a receiver only where a drive crosses itself more than 10 m above: its heights
/// drift, and differ from day to day), nor in less than 4 times that reach along the drive, which is one bend. Throws
/// Error naming `where` when fewer than 2 frames have places, or when the drive never comes to its earlier way again.
DriveStreets streets_of(const Drive& drive, const std::string& where);

}  // namespace citylearn
