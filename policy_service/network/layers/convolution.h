// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "policy_service/network/agent_network.h"

namespace citylearn {

/// A convolution over square pictures, without padding. Pictures lie row by row, the channels of a pixel together; so
/// do what it makes of them, the maps taking the channels' place, and each patch.
struct Convolution {
  int side = 0, channels = 0;  ///< of the input
  int kernel = 0, stride = 0;  ///< pixels
  int maps = 0;

  int out_side() const { return (side - kernel) / stride + 1; }
  std::ptrdiff_t positions() const { return std::ptrdiff_t{out_side()} * out_side(); }
  std::ptrdiff_t patch() const { return std::ptrdiff_t{kernel} * kernel * channels; }
  std::ptrdiff_t inputs() const { return std::ptrdiff_t{side} * side * channels; }
  std::ptrdiff_t outputs() const { return positions() * maps; }

  /// `patches` (patch x positions) of the picture (`inputs()` numbers), so that the convolution is a product.
  template <class S>
  void gather(const S* picture, Matrix<S>& patches) const {
    patches.resize(patch(), positions());
    S* to = patches.data();
    each_run([&](const std::ptrdiff_t begin, const std::ptrdiff_t length) {
      to = std::copy_n(picture + begin, length, to);
    });
  }
  /// The reverse of gather: adds each number of `patches` to the place in `picture` that it came from.
  template <class S>
  void scatter(const Matrix<S>& patches, S* picture) const {
    const S* from = patches.data();
    each_run([&](const std::ptrdiff_t begin, const std::ptrdiff_t length) {
      for (std::ptrdiff_t i = 0; i < length; ++i) picture[begin + i] += from[i];
      from += length;
    });
  }

 private:
  /// Calls run(begin, length) for each row of each patch: numbers that lie together.
  template <class Run>
  void each_run(const Run& run) const {
    const std::ptrdiff_t row = std::ptrdiff_t{side} * channels, length = std::ptrdiff_t{kernel} * channels;
    for (int y = 0; y < out_side(); ++y)
      for (int x = 0; x < out_side(); ++x)
        for (int k = 0; k < kernel; ++k)
          run((std::ptrdiff_t{y} * stride + k) * row + std::ptrdiff_t{x} * stride * channels, length);
  }
};

}  // namespace citylearn
