// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/exchange/message_order.h"
#include "core/util/types.h"
#include "idl/descriptor.h"

namespace citylearn {

/// Divides the blocks of one traversal among the encoder_services of a session that work on it: each has every n-th
/// block, in the order of their incarnations, and helps the one before it when its own are done. Publishes nothing
/// itself. Used by one thread.
class BlockDivision {
 public:
  static constexpr int kFrames = static_cast<int>(msg::FRAMES_PER_BLOCK);  ///< in a block
  /// Blocks that are left to the one that is helped: it may begin them before it hears of the help.
  static constexpr std::size_t kLeft = 2;

  /// Another encoder_service of the session, and what it said last about the traversal.
  struct Peer {
    std::string id, encoder;
    std::uint32_t frames = 0, dimension = 0;
    bool heard = false;
    MessageOrder order;
    std::vector<std::uint64_t> present;
    std::set<int> encoding;
    Clock::time_point encoded{};  ///< when it said last that it encodes a block, or first anything
    std::set<int> withheld;       ///< blocks that it has but did not send when asked
  };

  /// `own`: incarnation of this encoder_service. `hash`, `frames`: of the traversal.
  BlockDivision(std::uint64_t own, std::uint64_t hash, std::uint32_t frames);
  /// Returns the frames of a block whose bits are set.
  static std::vector<int> frames_of(int block, std::uint64_t bits);

  /// Names what makes this one's descriptors, once that is known. Others with something else share nothing with it.
  void set_encoder(const std::string& encoder, std::uint32_t dimension);
  std::uint32_t frames() const { return frames_; }
  void add_peer(std::uint64_t incarnation, const std::string& id) {
    peers_.try_emplace(incarnation).first->second.id = id;
  }
  /// Frees the blocks that it encodes.
  void remove_peer(std::uint64_t incarnation) { peers_.erase(incarnation); }
  /// Takes the status of a peer that was added; others are ignored.
  void take(const msg::DescriptorStatus& status, Clock::time_point now);
  const std::map<std::uint64_t, Peer>& peers() const { return peers_; }

  /// Returns whether no peer encodes the block or offers one of its frames that are lacking, a bit each.
  bool is_free(int block, std::uint64_t lacking) const;
  /// Begins a block for this one and returns it; nothing: there is none now. `lacking`: the frames that this one lacks,
  /// a bit each, by block. `reserve` returns whether the block can be begun.
  std::optional<int> begin(Clock::time_point now, std::span<const std::uint64_t> lacking,
                           const std::function<bool(int)>& reserve);
  /// Drops blocks that another one encodes or has by now, and returns them.
  std::vector<int> take_lost(std::span<const std::uint64_t> lacking);
  void release(int block) { encoding_.erase(block); }
  const std::set<int>& encoding() const { return encoding_; }  ///< blocks that this one has begun

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
    return peer.heard && !encoder_.empty() && peer.encoder == encoder_ && peer.dimension == dimension_ &&
           peer.frames == frames_;
  }
  std::vector<std::uint64_t> members(Clock::time_point now) const;

  const std::uint64_t own_, hash_;
  const std::uint32_t frames_;
  std::string encoder_;
  std::uint32_t dimension_ = 0;
  std::map<std::uint64_t, Peer> peers_;  // alive, by incarnation
  std::set<int> encoding_;

  // What was sent last.
  std::vector<std::uint64_t> sent_present_;
  std::vector<std::uint32_t> sent_encoding_;
  Clock::time_point sent_{};
  std::optional<Clock::time_point> joined_;  // when others were first told of encoder_
  bool changed_ = false;                     // others may not know what makes this one's descriptors
};

}  // namespace citylearn
