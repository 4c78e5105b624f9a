// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "core/exchange/object_fetch.h"
#include "core/exchange/presence.h"
#include "core/exchange/timing.h"
#include "core/wire/node.h"
#include "encoder_service/pipeline/block_division.h"
#include "encoder_service/pipeline/traversal_work.h"

namespace citylearn {

/// Divides the work on traversals with the other encoder_services of the session, fetches the descriptors that they
/// have, and sends them those of this one (idl/descriptor.idl). Used by the node's thread.
class DescriptorExchange {
 public:
  /// `node` must outlive it.
  explicit DescriptorExchange(Node& node);

  /// Returns how the blocks of a traversal are divided, before share().
  BlockDivision& division(std::uint64_t hash, std::uint32_t frames);
  /// Exchanges the descriptors of a traversal from now on. `work` must outlive this.
  void share(TraversalWork& work);
  /// Returns whether this one may begin a block: it has had time to hear of others.
  bool settled(Clock::time_point now) const { return now >= started_ + kEncoderSettle; }

  /// Takes the heartbeat of another encoder_service.
  void on_heartbeat(const msg::ServiceStatus& status, Clock::time_point now);
  void on_status(const msg::DescriptorStatus& status, Clock::time_point now);
  void on_request(const msg::DescriptorRequest& request);
  void on_chunk(const msg::DescriptorChunk& chunk, Clock::time_point now);
  /// Asks for what is due, and says what changed.
  void advance(Clock::time_point now);

 private:
  struct Traversal {
    BlockDivision division;
    TraversalWork* work = nullptr;  // null: its frames are not known here, or not what makes descriptors
  };
  struct Peer {
    std::string id;
    Presence presence;
  };
  /// Descriptors on their way from one peer.
  struct Fetch {
    std::uint64_t hash;
    int block;
    std::uint64_t frames;
    ObjectFetch object{{hash, static_cast<std::uint32_t>(block), kObjectRetry, RequestTimer::kDefaultTries}};
  };

  BlockDivision& add(std::uint64_t hash, std::uint32_t frames);
  bool hear(std::uint64_t incarnation, const std::string& id, Clock::time_point now);
  void drop(std::uint64_t incarnation);
  void begin_fetches();
  void begin_fetch(std::uint64_t incarnation, std::uint64_t hash, Traversal& traversal);
  void ask(std::uint64_t incarnation, Fetch& fetch, Clock::time_point now);
  bool finish(const Fetch& fetch, const FetchedObject& object, TraversalWork& work);
  std::shared_ptr<const ObjectBytes> find(const ObjectKey& key);

  Node& node_;
  const Clock::time_point started_;
  std::map<std::uint64_t, Traversal> traversals_;  // by hash
  std::map<std::uint64_t, Peer> peers_;            // alive, by incarnation
  std::map<std::uint64_t, Fetch> fetches_;         // at most one of each peer

  ObjectServer server_{[this](const ObjectKey& key) { return find(key); }, node_.traffic.rejected};

  msg::DescriptorStatus status_;
  msg::DescriptorRequest request_;
  msg::DescriptorChunk chunk_;
};

}  // namespace citylearn
