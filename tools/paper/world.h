// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "env_service/dataset_io/selection.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

struct WorldOptions {
  Source source;           ///< dataset and folder; its traversal is the one learned from
  std::string encoder;     ///< of pictures; empty: the default one
  EncoderFiles files;      ///< of the encoder
  int most_frames = 1000;  ///< of each recording, from its beginning
  int raw_frames = 128;    ///< of those, as pixels
  std::string store;       ///< folder of the feature store
};

/// The recordings of the study: the route as each traversal shows it, in each representation. Frame i is the same place
/// in all of them. Encodes each representation once, when it is asked for. Throws Error, Stopped.
class World {
 public:
  explicit World(const WorldOptions& options);
  ~World();

  const Source& source() const { return options_.source; }
  const std::string& dataset() const { return options_.source.dataset; }
  bool drawn() const { return dataset() == "synthetic"; }  ///< else real recordings
  bool pictures() const;
  int frames() const;                      ///< of the route
  const std::string& train() const;        ///< the traversal learned from
  std::vector<std::string> names() const;  ///< of all traversals, that one first
  /// A traversal as it was read, with pictures or features.
  const Traversal& recording(const std::string& name) const;
  Json hashes(const std::vector<std::string>& names);  ///< of recordings, as hexadecimal text, by name

  /// Returns the names of the frames' representations: "features" where the dataset has them; otherwise "ENCODER-D" for
  /// each D of `dimensions` that the number of frames and the encoder allow (D principal components of the traversal
  /// learned from), and "raw84" (pixels of the first `raw_frames` frames).
  std::vector<std::string> representations(const std::vector<int>& dimensions);
  /// The features that are compared where all policies shall see the same ones: 64 a frame, fewer where the route has
  /// fewer frames to learn them from.
  std::string common_representation();
  /// Features a frame of a representation; 0: pixels.
  int features(const std::string& representation) const;
  /// Returns the features that an encoder gives before principal components are taken.
  int encoder_dimension(const std::string& encoder);
  /// A traversal with the features of a representation.
  const Traversal& traversal(const std::string& representation, const std::string& name);

  /// {"drawn", "train", "frames", "traversals": [{"name", "condition"}]}, the traversal learned from first.
  Json description() const;

 private:
  struct Encoded;
  Encoded& encoded(const std::string& encoder);

  WorldOptions options_;
  Selection selection_;  ///< of all but the traversal learned from
  std::vector<std::string> names_;
  std::map<std::string, Traversal> recordings_;
  std::map<std::string, std::uint64_t> hashes_;
  std::map<std::string, std::unique_ptr<Encoded>> encoded_;              ///< by encoder
  std::map<std::pair<std::string, std::string>, Traversal> traversals_;  ///< by representation and name
};

/// The encoder of a representation "ENCODER-D".
std::string encoder_of(const std::string& representation);

}  // namespace citylearn::paper
