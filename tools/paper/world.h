// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "env_service/dataset_io/selection.h"

namespace citylearn::paper {

struct WorldOptions {
  Source source;                      ///< dataset and folder; its traversal is the one learned from
  std::vector<std::string> encoders;  ///< of pictures, by name; empty where the dataset has features
  std::vector<std::string> usual;     ///< these where it has pictures and `encoders` is empty
  EncoderFiles files;                 ///< of theirs
  int most_frames = 1000;             ///< of each recording, from its beginning
  int raw_frames = 128;               ///< of those, as pixels
  std::string store;                  ///< folder that keeps what was encoded
};

/// The recordings of the study: the route as each traversal shows it, in each representation, frame i everywhere the
/// same place. Encodes when asked, once. Throws Error, Stopped.
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
  /// As it was read, pictures or features.
  const Traversal& recording(const std::string& name) const;
  std::uint64_t hash(const std::string& name);  ///< of a recording

  /// Representations of the frames: "features" as the dataset has them, else "ENCODER-D" for D of `dimensions` that the
  /// route's frames and the encoder allow (D principal components, learned on the traversal learned from), and
  /// "raw84" (pixels; of the first `raw_frames` alone).
  std::vector<std::string> representations(const std::vector<int>& dimensions);
  /// A traversal with the features of a representation.
  const Traversal& traversal(const std::string& representation, const std::string& name);

  /// The traversal learned from, and the same route with the camera to the side of where it was, a traversal for each
  /// of aside_shifts(), called aside_name(). Drawn: "shifted" with the camera so many metres further left. Real
  /// pictures: a simulated shift, a window of 4/5 of the picture's width (of the traversal learned from too) moved
  /// right by such a share of it. Made once; the world must have pictures. Throws Error.
  World& aside();
  std::vector<double> aside_shifts() const;
  std::string aside_name(double shift) const;  ///< "1.5 m", "10 %"

 private:
  /// Recordings that were made elsewhere; the first is learned from.
  World(const WorldOptions& options, const std::vector<Traversal>& recordings);

  struct Encoded;
  Encoded& encoded(const std::string& encoder);

  WorldOptions options_;
  Selection selection_;  ///< of all but the traversal learned from
  std::vector<std::string> names_;
  std::map<std::string, Traversal> recordings_;
  std::map<std::string, std::uint64_t> hashes_;
  std::map<std::string, std::unique_ptr<Encoded>> encoded_;              ///< by encoder
  std::map<std::pair<std::string, std::string>, Traversal> traversals_;  ///< by representation and name
  std::unique_ptr<World> aside_;
};

}  // namespace citylearn::paper
