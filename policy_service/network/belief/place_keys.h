// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>

#include "core/util/error.h"
#include "policy_service/network/feature_normaliser.h"
#include "policy_service/network/layers/product.h"

namespace citylearn {

/// The keys that frames are compared with to find the place: the features K of the route's N places in each of E
/// experiences, as FeatureNormaliser makes them.
template <class S>
class PlaceKeys {
 public:
  PlaceKeys() = default;  ///< of no place
  /// `reference` must have `features` numbers of `frames` places, once or several times, as in NetworkTask. Where the
  /// keys are `compact`, 16 bits a number and place by place, there are look() and similarity() instead of compare().
  /// Throws Error.
  PlaceKeys(const Matrix<float>& reference, int features, int frames, bool compact = false) : frames_(frames) {
    if (features < 1 || frames < 1 || reference.rows() != features || reference.cols() < frames ||
        reference.cols() % frames != 0)
      throw Error("needs the features of all " + std::to_string(frames) + " frames of the training route", "reference",
                  "train where the env_service has features, or give it an encoder_service");
    const Matrix<float> keys = normalised_reference(reference, frames);
    if (compact)
      compact_ = (kOne * keys).array().round().template cast<std::int16_t>();
    else
      keys_ = keys.template cast<S>().transpose();
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

  /// Does what compare() does, in blocks of places that stay in the processor's cache. `block` is room to work in.
  void look(const Matrix<S>& features, std::ptrdiff_t places, Matrix<S>& block, Matrix<S>& similarity) const {
    constexpr std::ptrdiff_t kBlock = 256;
    similarity.resize(places, features.cols());
    Matrix<S> other;
    for (std::ptrdiff_t first = 0; first < places; first += kBlock) {
      const std::ptrdiff_t count = std::min(kBlock, places - first);
      auto part = similarity.middleRows(first, count);
      for (std::ptrdiff_t key = first; key < compact_.cols(); key += frames_) {
        block = S(1 / kOne) * compact_.middleCols(key, count).template cast<S>();
        if (key == first) {
          set_product(part, block.transpose(), features);
        } else {
          set_product(other, block.transpose(), features);
          part = part.cwiseMax(other);
        }
      }
    }
  }
  /// Returns how much `place` looks like D features. `key` is room to work in.
  S similarity(std::ptrdiff_t place, const Eigen::Ref<const Vector<S>>& features, Vector<S>& key) const {
    S most = -std::numeric_limits<S>::infinity();
    for (; place < compact_.cols(); place += frames_) {
      key = compact_.col(place).template cast<S>();
      most = std::max(most, S(1 / kOne) * key.dot(features));
    }
    return most;
  }
  /// Returns the compact keys of `count` places, evenly spaced among the first `places`, as those of a route.
  PlaceKeys sample(std::ptrdiff_t places, std::ptrdiff_t count) const {
    PlaceKeys some;
    some.frames_ = count;
    some.compact_.resize(compact_.rows(), compact_.cols() / frames_ * count);
    for (std::ptrdiff_t key = 0; key < some.compact_.cols(); ++key)
      some.compact_.col(key) = compact_.col(key / count * frames_ + key % count * places / count);
    return some;
  }

 private:
  static constexpr float kOne = 32767;  ///< a compact 1; keys have length 1

  std::ptrdiff_t frames_ = 0;
  Matrix<S> keys_;                                                       ///< EN x D
  Eigen::Matrix<std::int16_t, Eigen::Dynamic, Eigen::Dynamic> compact_;  ///< D x EN
};

}  // namespace citylearn
