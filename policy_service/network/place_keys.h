// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string>

#include "core/util/error.h"
#include "policy_service/network/feature_normaliser.h"
#include "policy_service/network/product.h"

namespace citylearn {

/// The keys that frames are compared with to find the place: the features K of the route's N places in each of E
/// experiences, as FeatureNormaliser makes them.
template <class S>
class PlaceKeys {
 public:
  /// `reference` must have `features` numbers of `frames` places, once or several times, as in NetworkTask. Throws
  /// Error.
  PlaceKeys(const Matrix<float>& reference, int features, int frames) : frames_(frames) {
    if (features < 1 || frames < 1 || reference.rows() != features || reference.cols() < frames ||
        reference.cols() % frames != 0)
      throw Error("needs the features of all " + std::to_string(frames) + " frames of the training route", "reference",
                  "train where the env_service has features, or give it an encoder_service");
    keys_ = normalised_reference(reference, frames).template cast<S>().transpose();
  }

  /// Sets `similarity` (`places` x U) to how much each of the first places looks like each column of `features`
  /// (D x U): x . K, the largest of its experiences'. `each` is room to work in.
  template <class Features>
  void compare(const Features& features, std::ptrdiff_t places, Matrix<S>& each, Matrix<S>& similarity) const {
    if (keys_.rows() == frames_) {
      set_product(similarity, keys_.topRows(places), features);
      return;
    }
    set_product(each, keys_, features);
    similarity = each.topRows(places);
    for (std::ptrdiff_t first = frames_; first < keys_.rows(); first += frames_)
      similarity = similarity.cwiseMax(each.middleRows(first, places));
  }

 private:
  std::ptrdiff_t frames_;
  Matrix<S> keys_;  ///< EN x D
};

}  // namespace citylearn
