// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// Returns how many places the pairs (column i of one recording, column i of the other) are wrong by: the median
/// distance between a place and its counterpart on the monotone path of greatest similarity, forwards or backwards. 0
/// where that is less than 3, where the path is not clearly more similar than the pairs, or where the recordings have
/// too little in common to tell. `taught` and `walked`: D x N features each, of the same places if the pairs are right;
/// columns that only one has do not count.
int places_apart(const Matrix<float>& taught, const Matrix<float>& walked);

}  // namespace citylearn
