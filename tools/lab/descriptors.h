// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>

#include "encoder_service/encoding/encoder.h"
#include "env_service/dataset_io/traversal.h"

namespace citylearn::lab {

/// Ctrl-C arrived: complete results are kept, the rest is abandoned.
struct Stopped {};

/// Reads and decodes a picture of a traversal. Throws Error, Stopped.
cv::Mat read_picture(const Traversal& traversal, int frame);

/// D x F descriptors of a traversal, and how long they took.
struct Descriptors {
  Eigen::MatrixXf matrix;
  double seconds = 0;
  int encoded = 0;  ///< frames; the others came from the store
};

/// Lets an encoder that learns do so from the pictures that an encoder_service takes. Throws Error, Stopped.
void fit_encoder(Encoder& encoder, const Traversal& reference);

/// Encodes a traversal of pictures in order, and calls `use` with the descriptors of frames `first` and those after it,
/// so that all of them need not be kept. Returns how many frames were encoded; the others came from the store. With a
/// `store` folder, features stored there are read and new ones written. Throws Error, Stopped.
int encode_blocks(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store,
                  const std::function<void(int first, const Eigen::MatrixXf& block)>& use);
/// Returns all descriptors.
Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store);

/// Returns the traversal with features, D x F, in place of its pictures; it ends with them.
Traversal with_features(Traversal traversal, const Eigen::MatrixXf& features);

/// Returns the features that a traversal has already.
Descriptors features_of(const Traversal& traversal);

}  // namespace citylearn::lab
