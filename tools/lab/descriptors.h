// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "core/command_line/progress.h"
#include "encoder_service/encoding/encoder.h"
#include "env_service/traversal/traversal.h"

namespace citylearn {
class FeatureStore;
}

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

/// Encodes a traversal of pictures, part by part. With a `store` folder, features stored there are read and new ones
/// written.
class Encoding {
 public:
  /// `encoder` and `traversal` must outlive it. Throws Error.
  Encoding(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store);
  ~Encoding();
  /// Fills in the descriptors of frame `first` and those that follow it, as Reduction::ReadBlock. Throws Error,
  /// Stopped.
  void read(Eigen::Index first, Eigen::Ref<Eigen::MatrixXf> descriptors);
  int encoded() const { return encoded_; }  ///< frames so far; the others came from the store

 private:
  Encoder& encoder_;
  const Traversal& traversal_;
  const int dimension_;
  std::unique_ptr<FeatureStore> store_;
  Progress progress_;
  int encoded_ = 0;
};
/// Returns all descriptors. Throws Error, Stopped.
Descriptors encode(Encoder& encoder, const Traversal& traversal, const std::string& label, const std::string& store);

/// Returns the traversal with features, D x F, in place of its pictures; it ends with them.
Traversal with_features(Traversal traversal, const Eigen::MatrixXf& features);

/// Returns the features that a traversal has already.
Descriptors features_of(const Traversal& traversal);

}  // namespace citylearn::lab
