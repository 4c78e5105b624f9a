// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <string>

#include "core/wire/node.h"
#include "env_service/environment.h"

namespace citylearn {

/// Answers requests for the data of an environment's traversal: features and positions, image files, and positions for
/// maps. Every answer may be lost and asked for again. Used by the node's thread.
class TraversalServer {
 public:
  /// `node` and `environment` must outlive it.
  TraversalServer(Node& node, const Environment& environment);

  /// Returns what the env_service announces, under no settings. Throws Error when a name does not fit the messages.
  msg::TraversalInfo info() const;
  /// Returns whether the request is for this env_service and for features that are here. An encoder_service asks for
  /// positions alone (dimension 0), and answers itself where features are asked for that only it has.
  bool can_answer(const msg::TraversalRequest& request) const;
  /// Publishes the chunks asked for.
  void answer(const msg::TraversalRequest& request);
  void answer(const msg::MapRequest& request);
  /// Notes the pictures asked for, but for those that are on their way already: a service that waits long for a slow
  /// picture asks again.
  void note(const msg::ImageRequest& request);
  /// Sends one picture to each service that asked. Returns whether more are to be sent.
  bool send_pictures();

 private:
  struct WantedPicture {
    std::uint32_t frame, first_chunk;
  };
  /// The pictures that one service asked for.
  struct PictureOrder {
    std::deque<WantedPicture> pictures;
    std::uint32_t most_chunks = 0;  // that it expects
  };
  struct SentPicture {
    Clock::time_point at;
    std::uint32_t next_chunk;  // all before it were sent
  };

  template <class Request>
  bool addressed(const Request& request) const {
    return request.environment() == node_.options().id && request.hash() == environment_.traversal_hash();
  }
  void read_image(std::uint32_t frame, std::string& name);
  void send_picture(const std::string& service, PictureOrder& order);

  Node& node_;
  const Environment& environment_;
  const Traversal& traversal_;
  const std::uint32_t frames_;

  Bytes image_;           // file of the frame asked for last: a large one is asked for in several requests
  int image_frame_ = -1;  // that frame; -1: none
  std::map<std::string, PictureOrder> orders_;                         // by the id of the service that asked
  std::map<std::pair<std::string, std::uint32_t>, SentPicture> sent_;  // a moment ago, by service and frame

  // Members, so that an answer allocates nothing.
  msg::TraversalChunk chunk_;
  msg::ImageChunk image_chunk_;
  msg::MapChunk map_chunk_;
};

}  // namespace citylearn
