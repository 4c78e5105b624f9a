// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/wire/blob.h"
#include "core/wire/node.h"

namespace citylearn {

/// A frame's image as it came over the wire.
struct FetchedImage {
  int frame = 0;
  std::string name;  ///< for messages
  Bytes file;        ///< empty when the env_service could not read it; `name` then says why
};

/// Fetches images of one traversal from an env_service: asks for them, joins their chunks in whatever order they come,
/// and asks again for what did not come.
class ImageFetch {
 public:
  ImageFetch(Node& node, std::uint64_t hash, int frames) : node_(node), hash_(hash), frames_(frames) {}

  /// Adds frames to fetch after those already wanted.
  void want(const std::vector<int>& frames);
  /// Wants these frames no longer.
  void drop(const std::vector<int>& frames);
  /// Returns how many wanted frames have not come.
  int missing() const { return static_cast<int>(wanted_.size()); }

  /// Takes a chunk; appends the image to `images` when that completes it. Chunks of other traversals and of frames that
  /// are not wanted are ignored.
  void on_chunk(const msg::ImageChunk& chunk, std::vector<FetchedImage>& images);
  /// Asks the env_service `environment` for what is missing, when a request is due.
  void ask(const std::string& environment);

 private:
  Node& node_;
  std::uint64_t hash_;
  int frames_;
  std::deque<int> wanted_;     // in the order they are asked for
  std::map<int, Blob> files_;  // of wanted frames
  int asked_ = 0;              // frames of the last request that have not come
  RequestTimer timer_{kImageRetry};
  msg::ImageRequest request_;
};

}  // namespace citylearn
