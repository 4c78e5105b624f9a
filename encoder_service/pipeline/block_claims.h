// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/util/types.h"
#include "idl/descriptor.h"

namespace citylearn {

/// Divides the blocks of one traversal among the encoder_services of a session, so that no two encode the same block
/// while each hears the others. A block is encoded once all others have acknowledged the claim to it and none of them
/// has the better one (Ricart & Agrawala, CACM 1981). Publishes nothing itself. Used by one thread.
class BlockClaims {
 public:
  static constexpr int kFrames = static_cast<int>(msg::FRAMES_PER_BLOCK);  ///< in a block

  /// Another encoder_service of the session, and what it said last about the traversal.
  struct Peer {
    std::string id, encoder;
    std::uint32_t frames = 0, dimension = 0;
    std::uint64_t revision = 0;      ///< of what it said; 0: nothing yet
    std::uint64_t acknowledged = 0;  ///< revision of this one's own status that it has heard
    std::vector<std::uint64_t> present;
    std::set<int> encoding, claimed;
    std::set<int> withheld;  ///< blocks that it has but did not send when asked
    Clock::time_point unanswered_since{};
    bool deaf_logged = false;
  };

  /// `own`: incarnation of this encoder_service. `hash`, `frames`: of the traversal.
  BlockClaims(std::uint64_t own, std::uint64_t hash, std::uint32_t frames);
  /// Returns the frames of a block whose bits are set.
  static std::vector<int> frames_of(int block, std::uint64_t bits);

  /// Names what makes this one's descriptors, once that is known. Others with something else share nothing with it.
  void set_encoder(const std::string& encoder, std::uint32_t dimension);
  std::uint32_t frames() const { return frames_; }
  void add_peer(std::uint64_t incarnation, const std::string& id) {
    peers_.try_emplace(incarnation).first->second.id = id;
  }
  /// Frees what it claims.
  void remove_peer(std::uint64_t incarnation) { peers_.erase(incarnation); }
  /// Takes the status of a peer that was added; others are ignored.
  void take(const msg::DescriptorStatus& status, Clock::time_point now);
  const std::map<std::uint64_t, Peer>& peers() const { return peers_; }

  /// Returns whether this one may claim the block. `lacking`: its frames that this one lacks, a bit each.
  bool is_free(int block, std::uint64_t lacking) const;
  void claim(int block) { claimed_.emplace(block, 0); }
  bool has(int block) const { return claimed_.contains(block) || encoding_.contains(block); }
  /// Moves claims that hold now to the blocks being encoded, and returns them.
  std::vector<int> take_granted(Clock::time_point now);
  /// Drops claims, and blocks being encoded, that are another one's by now, and returns them. `lacking`: by block.
  std::vector<int> take_lost(std::span<const std::uint64_t> lacking);
  /// Ends a claim, or the work on a block.
  void release(int block) { claimed_.erase(block), encoding_.erase(block); }
  std::vector<int> blocks() const;
  std::vector<int> pending() const;  ///< claims that do not hold yet

  /// Returns whether any peer encodes the block.
  bool encoded_by_peer(int block) const;
  /// Returns which frames of a block a peer offers, a bit each.
  std::uint64_t offered(const Peer& peer, int block) const;
  /// Notes that the peer did not send the block when asked, or sent it damaged.
  void withhold(std::uint64_t incarnation, int block);

  /// Fills all of a status but its header, and returns true, when one is to be sent. `present`: by block, the frames
  /// that this one has.
  bool fill(Clock::time_point now, std::span<const std::uint64_t> present, msg::DescriptorStatus& status);

 private:
  bool shares(const Peer& peer) const {
    return peer.revision > 0 && !encoder_.empty() && peer.encoder == encoder_ && peer.dimension == dimension_ &&
           peer.frames == frames_;
  }
  bool waits_for(const Peer& peer, Clock::time_point now) const {
    return peer.unanswered_since == Clock::time_point{} || now - peer.unanswered_since < kClaimTimeout;
  }

  const std::uint64_t own_, hash_;
  const std::uint32_t frames_;
  std::string encoder_;
  std::uint32_t dimension_ = 0;
  std::map<std::uint64_t, Peer> peers_;  // alive, by incarnation

  std::map<int, std::uint64_t> claimed_;  // the revision that said so first; 0: none did yet
  std::set<int> encoding_;

  // What was sent last.
  std::uint64_t revision_ = 0;
  std::vector<std::uint64_t> sent_present_;
  std::vector<std::uint32_t> sent_encoding_, sent_claimed_;
  Clock::time_point sent_{};
  bool answer_now_ = false, answer_again_ = false;
};

}  // namespace citylearn
