// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/block_claims.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <utility>

namespace citylearn {

BlockClaims::BlockClaims(std::uint64_t own, std::uint64_t hash, std::uint32_t frames)
    : own_(own), hash_(hash), frames_(frames) {}

std::vector<int> BlockClaims::frames_of(int block, std::uint64_t bits) {
  std::vector<int> frames;
  for (; bits != 0; bits &= bits - 1) frames.push_back(block * kFrames + std::countr_zero(bits));
  return frames;
}

void BlockClaims::set_encoder(const std::string& encoder, std::uint32_t dimension) {
  encoder_ = encoder;
  dimension_ = dimension;
  ++revision_;  // what others know of it no longer holds
  sent_ = {};
}

void BlockClaims::take(const msg::DescriptorStatus& status, Clock::time_point now) {
  const auto found = peers_.find(status.header().incarnation());
  if (found == peers_.end() || status.revision() == 0) return;
  Peer& peer = found->second;
  for (std::size_t i = 0; i < status.heard().size(); ++i) {
    const std::uint64_t acknowledged = std::min(status.acknowledged()[i], revision_);
    if (status.heard()[i] != own_ || acknowledged <= peer.acknowledged) continue;
    peer.acknowledged = acknowledged;
    peer.unanswered_since = acknowledged == revision_ ? Clock::time_point{} : now;
    peer.deaf_logged = false;
  }
  answer_again_ |= status.unacknowledged();
  if (status.revision() <= peer.revision) return;
  answer_now_ = true;
  peer.revision = status.revision();
  peer.encoder = status.encoder().c_str();
  peer.frames = status.frames();
  peer.dimension = status.dimension();
  peer.present = status.present();
  peer.encoding = {status.encoding().begin(), status.encoding().end()};
  peer.claimed = {status.claimed().begin(), status.claimed().end()};
}

std::uint64_t BlockClaims::offered(const Peer& peer, int block) const {
  const auto index = static_cast<std::size_t>(block);
  if (!shares(peer) || index >= peer.present.size() || peer.withheld.contains(block)) return 0;
  return peer.present[index];
}

void BlockClaims::withhold(std::uint64_t incarnation, int block) {
  if (const auto found = peers_.find(incarnation); found != peers_.end()) found->second.withheld.insert(block);
}

bool BlockClaims::encoded_by_peer(int block) const {
  return std::any_of(peers_.begin(), peers_.end(),
                     [&](const auto& entry) { return shares(entry.second) && entry.second.encoding.contains(block); });
}

bool BlockClaims::is_free(int block, std::uint64_t lacking) const {
  return std::none_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
    const Peer& peer = entry.second;
    // What a peer has is fetched first: only the rest of the block is to be encoded.
    return shares(peer) &&
           (peer.encoding.contains(block) || peer.claimed.contains(block) || (offered(peer, block) & lacking) != 0);
  });
}

std::vector<int> BlockClaims::take_granted(Clock::time_point now) {
  std::vector<int> granted;
  for (const auto& [block, revision] : claimed_) {
    const bool all = std::all_of(peers_.begin(), peers_.end(), [&, since = revision](const auto& entry) {
      return !waits_for(entry.second, now) || (since > 0 && entry.second.acknowledged >= since);
    });
    if (all) granted.push_back(block);
  }
  for (const int block : granted) {
    claimed_.erase(block);
    encoding_.insert(block);
  }
  return granted;
}

std::vector<int> BlockClaims::take_lost(std::span<const std::uint64_t> lacking) {
  std::vector<int> lost;
  for (const int block : blocks()) {
    const std::uint64_t wanted = lacking[static_cast<std::size_t>(block)];
    const bool begun = encoding_.contains(block);
    const bool theirs = std::any_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
      const auto& [incarnation, peer] = entry;
      if (!shares(peer)) return false;
      const std::uint64_t have = offered(peer, block) & wanted;
      // Two encode the same block only after one of them was silent for so long that it counted as gone.
      if (begun) return (peer.encoding.contains(block) && incarnation < own_) || (wanted != 0 && have == wanted);
      return peer.encoding.contains(block) || (peer.claimed.contains(block) && incarnation < own_) || have != 0;
    });
    if (theirs) lost.push_back(block);
  }
  for (const int block : lost) release(block);
  return lost;
}

std::vector<int> BlockClaims::pending() const {
  std::vector<int> blocks;
  for (const auto& [block, revision] : claimed_) blocks.push_back(block);
  return blocks;
}

std::vector<int> BlockClaims::blocks() const {
  std::vector<int> all = pending();
  all.insert(all.end(), encoding_.begin(), encoding_.end());
  return all;
}

bool BlockClaims::fill(Clock::time_point now, std::span<const std::uint64_t> present, msg::DescriptorStatus& status) {
  if (peers_.empty()) return false;
  std::vector<std::uint32_t> encoding(encoding_.begin(), encoding_.end()), claimed;
  for (const auto& [block, revision] : claimed_) claimed.push_back(static_cast<std::uint32_t>(block));
  const bool new_claims =
      std::any_of(claimed_.begin(), claimed_.end(), [](const auto& claim) { return claim.second == 0; });
  const bool other_claims = new_claims || encoding != sent_encoding_ || claimed != sent_claimed_ || revision_ == 0;
  const bool other_frames = !std::equal(present.begin(), present.end(), sent_present_.begin(), sent_present_.end());
  const bool changed = other_claims || (other_frames && now >= sent_ + kPresentInterval);
  const auto lacks_acknowledgement = [&](const auto& entry) {
    return waits_for(entry.second, now) && entry.second.acknowledged < revision_;
  };
  const bool waiting = std::any_of(peers_.begin(), peers_.end(), lacks_acknowledgement);
  if (!changed && !answer_now_ && !((waiting || answer_again_) && now >= sent_ + kClaimRepeat)) return false;
  if (other_claims || other_frames) {
    ++revision_;
    sent_encoding_ = std::move(encoding);
    sent_claimed_ = std::move(claimed);
    sent_present_.assign(present.begin(), present.end());
    for (auto& [block, revision] : claimed_)
      if (revision == 0) revision = revision_;
  }
  status.hash() = hash_;
  status.frames() = frames_;
  status.encoder() = encoder_.c_str();
  status.dimension() = dimension_;
  status.revision() = revision_;
  status.present() = sent_present_;
  status.encoding() = sent_encoding_;
  status.claimed() = sent_claimed_;
  status.unacknowledged() = false;
  status.heard().clear();
  status.acknowledged().clear();
  for (auto& [incarnation, peer] : peers_) {
    status.heard().push_back(incarnation);
    status.acknowledged().push_back(peer.revision);
    if (peer.acknowledged == revision_) continue;
    if (peer.unanswered_since == Clock::time_point{}) peer.unanswered_since = now;
    if (waits_for(peer, now))
      status.unacknowledged() = true;
    else if (!std::exchange(peer.deaf_logged, true))
      spdlog::warn("encoder_service '{}' does not answer: frames are divided without it", peer.id);
  }
  sent_ = now;
  answer_now_ = answer_again_ = false;
  return true;
}

}  // namespace citylearn
