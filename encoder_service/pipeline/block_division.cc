// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/block_division.h"

#include <algorithm>
#include <bit>
#include <utility>

namespace citylearn {

BlockDivision::BlockDivision(std::uint64_t own, std::uint64_t hash, std::uint32_t frames)
    : own_(own), hash_(hash), frames_(frames) {}

std::vector<int> BlockDivision::frames_of(int block, std::uint64_t bits) {
  std::vector<int> frames;
  for (; bits != 0; bits &= bits - 1) frames.push_back(block * kFrames + std::countr_zero(bits));
  return frames;
}

void BlockDivision::set_encoder(const std::string& encoder, std::uint32_t dimension) {
  encoder_ = encoder;
  dimension_ = dimension;
  joined_.reset();
  changed_ = true;
}

void BlockDivision::take(const msg::DescriptorStatus& status, Clock::time_point now) {
  const auto found = peers_.find(status.header().incarnation());
  if (found == peers_.end()) return;
  Peer& peer = found->second;
  if (!peer.order.in_order(status.header(), now)) return;
  if (!std::exchange(peer.heard, true) || peer.encoder != status.encoder().c_str()) {
    peer.encoded = now;
    changed_ = true;  // it may not know this one
  }
  peer.encoder = status.encoder().c_str();
  peer.frames = status.frames();
  peer.dimension = status.dimension();
  peer.present = status.present();
  peer.encoding = {status.encoding().begin(), status.encoding().end()};
  if (!peer.encoding.empty()) peer.encoded = now;
}

std::uint64_t BlockDivision::offered(const Peer& peer, int block) const {
  const auto index = static_cast<std::size_t>(block);
  if (!shares(peer) || index >= peer.present.size() || peer.withheld.contains(block)) return 0;
  return peer.present[index];
}

void BlockDivision::withhold(std::uint64_t incarnation, int block) {
  if (const auto found = peers_.find(incarnation); found != peers_.end()) found->second.withheld.insert(block);
}

bool BlockDivision::encoded_by_peer(int block) const {
  return std::any_of(peers_.begin(), peers_.end(),
                     [&](const auto& entry) { return shares(entry.second) && entry.second.encoding.contains(block); });
}

/// What a peer has is fetched first: only the rest of a block is to be encoded.
bool BlockDivision::is_free(int block, std::uint64_t lacking) const {
  return !encoded_by_peer(block) && std::none_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
    return (offered(entry.second, block) & lacking) != 0;
  });
}

/// Returns the incarnations of those that divide the blocks, in order. One that encodes none for a while has done its
/// share, or cannot work.
std::vector<std::uint64_t> BlockDivision::members(Clock::time_point now) const {
  std::vector<std::uint64_t> all{own_};
  for (const auto& [incarnation, peer] : peers_)
    if (shares(peer) && now < peer.encoded + kEncoderSettle) all.push_back(incarnation);
  std::sort(all.begin(), all.end());
  return all;
}

std::optional<int> BlockDivision::begin(Clock::time_point now, std::span<const std::uint64_t> lacking,
                                        const std::function<bool(int)>& reserve) {
  if (!peers_.empty() && (!joined_ || now < *joined_ + kEncoderJoin)) return std::nullopt;
  if (encoding_.size() >= msg::MAX_BLOCKS_ENCODED) return std::nullopt;
  const std::vector<std::uint64_t> all = members(now);
  const std::size_t own = static_cast<std::size_t>(std::find(all.begin(), all.end(), own_) - all.begin());
  std::vector<int> before;  // blocks of the one before, not begun
  for (int block = 0; block < static_cast<int>(lacking.size()); ++block) {
    const std::uint64_t wanted = lacking[static_cast<std::size_t>(block)];
    if (wanted == 0 || encoding_.contains(block) || !is_free(block, wanted)) continue;
    const std::size_t place = static_cast<std::size_t>(block) % all.size();
    if ((place + 1) % all.size() == own && place != own) before.push_back(block);
    if (place == own && reserve(block)) return *encoding_.insert(block).first;
  }
  for (std::size_t i = before.size(); i > kLeft; --i)
    if (reserve(before[i - 1])) return *encoding_.insert(before[i - 1]).first;
  return std::nullopt;
}

std::vector<int> BlockDivision::take_lost(std::span<const std::uint64_t> lacking) {
  std::vector<int> lost;
  for (const int block : encoding_) {
    const std::uint64_t wanted = lacking[static_cast<std::size_t>(block)];
    const bool theirs = std::any_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
      const auto& [incarnation, peer] = entry;
      return shares(peer) && ((peer.encoding.contains(block) && incarnation < own_) ||
                              (wanted != 0 && (offered(peer, block) & wanted) == wanted));
    });
    if (theirs) lost.push_back(block);
  }
  for (const int block : lost) release(block);
  return lost;
}

bool BlockDivision::fill(Clock::time_point now, std::span<const std::uint64_t> present, msg::DescriptorStatus& status) {
  if (peers_.empty()) return false;
  const bool others = !std::equal(encoding_.begin(), encoding_.end(), sent_encoding_.begin(), sent_encoding_.end());
  const bool frames = !std::equal(present.begin(), present.end(), sent_present_.begin(), sent_present_.end());
  const bool joins = joined_ && now < *joined_ + kEncoderJoin;
  const auto interval = frames ? kPresentInterval : joins ? kEncoderJoin / 4 : kHeartbeat;
  if (!others && !changed_ && now < sent_ + interval) return false;
  sent_encoding_.assign(encoding_.begin(), encoding_.end());
  sent_present_.assign(present.begin(), present.end());
  sent_ = now;
  changed_ = false;
  if (!joined_ && !encoder_.empty()) joined_ = now;
  status.hash() = hash_;
  status.frames() = frames_;
  status.encoder() = encoder_.c_str();
  status.dimension() = dimension_;
  status.present() = sent_present_;
  status.encoding() = sent_encoding_;
  return true;
}

}  // namespace citylearn
