// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/export/encoder_graph.h"

namespace citylearn {
namespace {

/// Returns the weights that give each pixel of a line the mean of its patch.
Matrix<float> patch_means(int length, int patch) {
  Matrix<float> weights = Matrix<float>::Zero(length, length);
  for (int first = 0; first < length; first += patch) {
    const int size = std::min(patch, length - first);
    weights.block(first, first, size, size).setConstant(1 / static_cast<float>(size));
  }
  return weights;
}

/// Appends what encoders/patchnorm.cc computes.
std::unique_ptr<EncoderGraph> append_patchnorm(const Parameters& parameters, const EncoderFiles&,
                                               const OnnxPicture& picture) {
  const int width = parameters.integer("width"), height = parameters.integer("height");
  const Matrix<float> across = patch_means(width, parameters.integer("patch"));
  const Matrix<float> down = patch_means(height, parameters.integer("patch"));
  OnnxPicture patches = scaled_grey(picture, width, height), squares = patches;
  patches.value = patches.value - transformed(patches, across, down).value;
  squares.value = patches.value * patches.value;
  const OnnxValue variance = relu(transformed(squares, across, down).value + -1) + 1;
  patches.value = patches.value * exp(-0.5f * log(variance));
  return std::make_unique<EncoderGraph>(flattened(patches, false));
}

const EncoderGraphRegistry::Registration patchnorm_registration{
    {"patchnorm", "as encoders/patchnorm.cc", {}, append_patchnorm}};

}  // namespace
}  // namespace citylearn
