// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// What two recordings show of the pairs that their columns are said to be.
struct Pairing {
  /// Median distance, in places, between a place and where the other recording shows it; 0: less than 3, or unclear.
  int apart = 0;
  /// No order of the one recording resembles the other: another street, or pictures that tell nothing.
  bool unlike = false;

  bool operator==(const Pairing&) const = default;
};

/// Compares the similarity of the pairs (column i of one, column i of the other) with that along lines, forwards and
/// backwards, at half to double speed, and along the monotone path of greatest similarity. Nothing is said of fewer
/// than 16 places, of other features, or where the lines differ too little to tell. `taught` and `walked`: D x N
/// features each; columns that only one has do not count.
Pairing examine_pairs(const Matrix<float>& taught, const Matrix<float>& walked);

}  // namespace citylearn
