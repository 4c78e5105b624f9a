// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "core/util/types.h"
#include "core/plugin/registry.h"

namespace cv {
class Mat;
}

namespace citylearn {

/// Turns a picture into one vector that tells places apart. Its numbers depend on the picture and on spec().name alone,
/// not on what else is encoded with it (up to the rounding of a batched product). Used by one thread at a time.
class Encoder {
 public:
  struct Spec {
    std::string
        name;  ///< with version and every parameter that changes numbers: "hog-1 bins=12"; at most 200 characters
    int dimension = 0;  ///< D
    int batch = 16;     ///< pictures a call that it handles most quickly
  };

  virtual ~Encoder() = default;
  /// After learn() or restore(), for encoders that learn.
  virtual Spec spec() const = 0;
  /// n pictures (8-bit, 3 channels, BGR, any size) to D x n, a column each, finite. Throws Error.
  virtual Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) = 0;

  /// How many pictures of the reference traversal, evenly spread, it wants to learn() from before anything else; 0: it
  /// does not learn.
  virtual int lessons() const { return 0; }
  virtual void learn(std::span<const cv::Mat> /*pictures*/) {}
  /// What learn() found, to be given to restore() of an encoder with the same parameters. restore() throws Error when
  /// the bytes are not that.
  virtual Bytes state() const { return {}; }
  virtual void restore(std::span<const std::byte> /*state*/) {}
};

/// What an encoder needs beside numbers.
struct EncoderFiles {
  std::string model;   ///< --model: file of the network
  std::string layer;   ///< --layer: output layer by name; empty: the network's last
  std::string preset;  ///< --preset: input size, mean, deviation, channel order and layer of a known network
  std::string head;    ///< --head: file of the NetVLAD layer's weights and of what follows it
};

/// An encoder is one file of encoders/ that ends in a static Registration.
using EncoderRegistry = Registry<Encoder, const EncoderFiles&>;

/// The picture in an image file's bytes: 8-bit, 3 channels, BGR. Throws Error naming `where`: broken, unknown, or
/// larger than kMaxPixels (told from its header, before it is decoded).
cv::Mat decode_picture(std::span<const std::byte> file, const std::string& where);

}  // namespace citylearn
