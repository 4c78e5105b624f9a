// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/exchange/object.h"
#include "core/wire/node.h"
#include "env_service/environment.h"

namespace citylearn {

/// Answers requests for the data of an environment's traversal: features and positions, image files, and its map. Every
/// answer may be lost and asked for again. Used by the node's thread.
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
  /// Takes requests for pictures and the map.
  void take_requests();
  /// Sends one picture and the map to each service that asked. Returns whether more are to be sent.
  bool send_objects();

 private:
  bool addressed(const std::string& id, std::uint64_t hash) const {
    return id == node_.options().id && hash == environment_.traversal_hash();
  }
  Bytes image(std::uint64_t frame);
  Bytes map() const;

  Node& node_;
  const Environment& environment_;
  const Traversal& traversal_;
  const std::uint32_t frames_;

  ObjectServer images_, maps_;
  Bytes file_;  // of a picture

  // Members, so that an answer allocates nothing.
  msg::TraversalChunk chunk_;
  msg::ImageRequest image_request_;
  msg::ImageChunk image_chunk_;
  msg::RouteMapRequest map_request_;
  msg::RouteMapChunk map_chunk_;
};

}  // namespace citylearn
