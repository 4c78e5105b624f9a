// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "core/exchange/object.h"
#include "core/wire/node.h"
#include "env_service/environment.h"

namespace citylearn {

/// Answers requests for the data of an environment's traversal: features and positions, image files, its map and its
/// streets. Every answer may be lost and asked for again. Used by the node's thread.
class TraversalServer {
 public:
  /// `node` and `environment` must outlive it.
  TraversalServer(Node& node, const Environment& environment);

  /// Returns what the env_service announces, under no settings. Throws Error when a name does not fit the messages.
  msg::TraversalInfo info() const;
  /// Takes requests. Returns whether features or positions are asked for that are here. An encoder_service asks for
  /// positions alone (dimension 0), and answers itself where features are asked for that only it has.
  bool take_requests();
  /// Sends one object of each kind to each service that asked. Returns whether more are to be sent.
  bool send_objects();

 private:
  bool addressed(const std::string& id, std::uint64_t hash) const {
    return id == node_.options().id && hash == environment_.traversal_hash();
  }
  std::shared_ptr<const ObjectBytes> image(const ObjectKey& key);
  std::shared_ptr<const ObjectBytes> map(const ObjectKey& key) const;
  std::shared_ptr<const ObjectBytes> streets(const ObjectKey& key) const;

  Node& node_;
  const Environment& environment_;
  const Traversal& traversal_;
  const std::uint64_t streets_hash_;  // 0: it has no streets

  ObjectServer frames_, images_, maps_, streets_;
  Bytes file_;  // of a picture

  // Members, so that an answer allocates nothing.
  msg::TraversalRequest request_;
  msg::TraversalChunk chunk_;
  msg::ImageRequest image_request_;
  msg::ImageChunk image_chunk_;
  msg::RouteMapRequest map_request_;
  msg::RouteMapChunk map_chunk_;
  msg::StreetsRequest streets_request_;
  msg::StreetsChunk streets_chunk_;
};

}  // namespace citylearn
