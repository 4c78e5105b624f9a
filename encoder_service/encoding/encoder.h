// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/plugin/registry.h"
#include "core/util/types.h"

namespace cv {
class Mat;
}

namespace citylearn {

/// Turns a picture into one vector that distinguishes places. Its numbers depend on the picture and on spec().name
/// alone, not on what else is encoded with it (up to the rounding of a batched product). Used by one thread at a time.
class Encoder {
 public:
  struct Spec {
    /// Names the encoder, its version and all parameters that change numbers: "hog-1 bins=12"; at most 200 characters.
    std::string name;
    int dimension = 0;  ///< D
    int batch = 16;     ///< pictures that one call encodes most quickly
  };

  virtual ~Encoder() = default;
  /// Describes the encoder. Encoders that learn have a Spec only after learn() or restore().
  virtual Spec spec() const = 0;
  /// Encodes n pictures (8-bit, 3 channels, BGR, any size) to D x n finite numbers, a column each. Throws Error.
  virtual Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) = 0;

  /// Returns how many pictures of the reference traversal, evenly spread, it needs for learn() before anything else; 0:
  /// it does not learn.
  virtual int training_sample_count() const { return 0; }
  virtual void learn(std::span<const cv::Mat> /*pictures*/) {}
  /// Returns what learn() found, for restore() of an encoder with the same parameters. restore() throws Error when the
  /// bytes are something else.
  virtual Bytes state() const { return {}; }
  virtual void restore(std::span<const std::byte> /*state*/) {}
};

/// Returns which frames of a reference traversal with `frames` frames an encoder learns from that wants `wanted`
/// pictures: the middles of as many equal parts.
inline std::vector<int> training_frames(int wanted, int frames) {
  wanted = std::min(wanted, frames);
  std::vector<int> chosen;
  for (int i = 0; i < wanted; ++i)
    chosen.push_back(static_cast<int>((2 * std::int64_t{i} + 1) * frames / (2 * std::int64_t{wanted})));
  return chosen;
}

/// Files and names that an encoder needs beside its numeric parameters.
struct EncoderFiles {
  std::string model;   ///< --model: file of the network
  std::string layer;   ///< --layer: output layer by name; empty: the network's last
  std::string preset;  ///< --preset: input size, mean, deviation, channel order and layer of a known network
};

/// An encoder is one file of encoders/ that ends in a static Registration. It may recommend a reduction: "dimension",
/// and "centring" as a Centring.
using EncoderRegistry = Registry<Encoder, const EncoderFiles&>;

/// The encoder that programs use when none is named.
inline constexpr const char* kDefaultEncoder = "hog_vlad";

/// Creates an encoder that has a constructor from parameters.
template <class T>
std::unique_ptr<Encoder> make_encoder(const Parameters& parameters, const EncoderFiles&) {
  return std::make_unique<T>(parameters);
}

/// Decodes an image file: 8-bit, 3 channels, BGR. Throws Error naming `where` when it is broken, of an unknown format,
/// or larger than kMaxPixels by its header, which is read first.
cv::Mat decode_picture(std::span<const std::byte> file, const std::string& where);

}  // namespace citylearn
