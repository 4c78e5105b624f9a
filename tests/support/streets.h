// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "core/task/state_map.h"

namespace citylearn::testing {

/// A made map of 7 places, 10 m apart where not drawn longer: a dead end (4), a junction (2), a one-way link (2 to 3),
/// corridors and corners.
///
///           4
///           |
///   0 - 1 - 2 > 3
///   |           |
///   5 --------- 6
inline StreetMap small_streets() {
  StreetMap map{{0, 10, 20, 30, 20, 0, 30},
                {10, 10, 10, 10, 20, 0, 0},
                {0, 0, 1, 1, 2, 2, 2, 3, 4, 5, 5, 6, 6},
                {1, 5, 2, 0, 4, 3, 1, 6, 2, 0, 6, 3, 5},
                {90, 180, 90, 270, 0, 90, 270, 180, 180, 0, 90, 0, 270}};
  map.check();
  return map;
}

/// Its 13 states under StateRule::kStreet, a link each, in this order. Ahead, left and right of each (-1: not allowed):
///    0: 0 east    2  1  1       5: 2 east    7  4  6      10: 5 east   11  9  9
///    1: 0 south  10  0  0       6: 2 west    3  5  4      11: 6 north   7 12 12
///    2: 1 east    5  3  3       7: 3 south  12 -1 -1      12: 6 west    9 11 11
///    3: 1 west    1  2  2       8: 4 south   5 -1 -1
///    4: 2 north   8  6  5       9: 5 north   0 10 10
inline std::shared_ptr<const StateMap> small_states() {
  return std::make_shared<const StateMap>(small_streets(), StateRule::kStreet, 1 << 20);
}

}  // namespace citylearn::testing
