// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/descriptor_exchange.h"

#include <spdlog/spdlog.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>

namespace citylearn {
namespace {

constexpr std::size_t kMaxTraversals = 4096;  // any process may name one
constexpr int kMinFramesAsked = 16;           // frames of a block that a peer has not finished
constexpr int kMaxDamaged = 3;

std::uint32_t checksum(std::span<const std::uint8_t> bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, bytes.data(), bytes.size()));
}

std::uint64_t bytes_of(std::uint64_t frames, int dimension) {
  return std::uint64_t(std::popcount(frames)) * static_cast<std::uint64_t>(dimension) * sizeof(float);
}

}  // namespace

DescriptorExchange::DescriptorExchange(Node& node) : node_(node), started_(Clock::now()) {
  node_.create_reader<msg::DescriptorStatus>();
  node_.create_reader<msg::DescriptorRequest>();
  node_.create_reader<msg::DescriptorChunk>();
  node_.create_writer<msg::DescriptorStatus>();
}

BlockClaims& DescriptorExchange::claims(std::uint64_t hash, std::uint32_t frames) {
  auto found = traversals_.find(hash);
  // What others say of it does not count as much as what this service was told by its env_service.
  if (found != traversals_.end() && found->second.claims.frames() != frames) {
    traversals_.erase(found);
    found = traversals_.end();
  }
  return found == traversals_.end() ? add(hash, frames) : found->second.claims;
}

BlockClaims& DescriptorExchange::add(std::uint64_t hash, std::uint32_t frames) {
  BlockClaims& claims =
      traversals_.emplace(hash, Traversal{BlockClaims(node_.incarnation(), hash, frames)}).first->second.claims;
  for (const auto& [incarnation, peer] : peers_) claims.add_peer(incarnation, peer.id);
  return claims;
}

void DescriptorExchange::share(TraversalWork& work) { traversals_.at(work.key().traversal).work = &work; }

/// Returns false when there are too many to take in another one.
bool DescriptorExchange::hear(std::uint64_t incarnation, const std::string& id, Clock::time_point now) {
  const auto known = peers_.find(incarnation);
  if (known != peers_.end()) {
    known->second.presence.heard(now);
    return true;
  }
  if (incarnation == 0 || peers_.size() >= msg::MAX_ENCODERS) return false;
  spdlog::info("encoder_service '{}' takes part", id);
  peers_[incarnation] = {id, Presence(now)};
  for (auto& [hash, traversal] : traversals_) traversal.claims.add_peer(incarnation, id);
  return true;
}

void DescriptorExchange::drop(std::uint64_t incarnation) {
  const auto found = peers_.find(incarnation);
  if (found == peers_.end()) return;
  spdlog::info("encoder_service '{}' takes part no longer", found->second.id);
  peers_.erase(found);
  fetches_.erase(incarnation);
  for (auto& [hash, traversal] : traversals_) traversal.claims.remove_peer(incarnation);
}

void DescriptorExchange::on_heartbeat(const msg::ServiceStatus& status, Clock::time_point now) {
  const msg::Header& header = status.header();
  if (status.service_state() == msg::STOPPING)
    drop(header.incarnation());
  else
    hear(header.incarnation(), header.sender().c_str(), now);
}

void DescriptorExchange::on_status(const msg::DescriptorStatus& status, Clock::time_point now) {
  const auto found = traversals_.find(status.hash());
  if (found == traversals_.end() && traversals_.size() >= kMaxTraversals) return;
  if (!hear(status.header().incarnation(), status.header().sender().c_str(), now)) return;
  BlockClaims& claims = found == traversals_.end() ? add(status.hash(), status.frames()) : found->second.claims;
  claims.take(status, now);
}

void DescriptorExchange::on_request(const msg::DescriptorRequest& request) {
  const auto found = traversals_.find(request.hash());
  if (found == traversals_.end() || !found->second.work) return;
  const TraversalWork& work = *found->second.work;
  const std::span<const std::uint64_t> present = work.present();
  // Only frames that this one announced are asked for, so others are asked of another process, or forged.
  if (work.key().encoder != request.encoder().c_str() || request.block() >= present.size() || request.frames() == 0 ||
      (request.frames() & ~present[request.block()]) != 0)
    return;
  if (served_.hash != request.hash() || served_.block != request.block() || served_.frames != request.frames()) {
    served_ = {};
    std::vector<float> descriptor(static_cast<std::size_t>(work.key().dimension));
    std::vector<std::uint8_t> bytes(bytes_of(request.frames(), work.key().dimension));
    auto* to = bytes.data();
    bool whole = true;
    for (const int frame : BlockClaims::frames_of(static_cast<int>(request.block()), request.frames())) {
      whole = whole && work.read(frame, descriptor);
      std::memcpy(to, descriptor.data(), descriptor.size() * sizeof(float));
      to += descriptor.size() * sizeof(float);
    }
    if (!whole) return;  // lost on the disk: the one that asks gives up and encodes them
    served_ = {request.hash(), request.frames(), request.block(), std::move(bytes)};
    chunk_.checksum() = checksum(served_.bytes);
  }
  chunk_.receiver() = request.header().sender();
  chunk_.hash() = request.hash();
  chunk_.encoder() = request.encoder();
  chunk_.dimension() = static_cast<std::uint32_t>(work.key().dimension);
  chunk_.block() = request.block();
  chunk_.frames() = request.frames();
  for (const std::uint32_t chunk : request.chunks()) {
    const auto data = chunk_size(chunk, served_.bytes.size()) == 0
                          ? std::span<const std::uint8_t>()
                          : chunk_of(std::span<const std::uint8_t>(served_.bytes), chunk);
    if (data.empty()) {
      ++node_.traffic.rejected;
      continue;
    }
    chunk_.chunk() = chunk;
    chunk_.data().assign(data.begin(), data.end());
    node_.publish(chunk_);
  }
}

void DescriptorExchange::on_chunk(const msg::DescriptorChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find(chunk.header().incarnation());
  if (found == fetches_.end()) return;
  Fetch& fetch = found->second;
  Traversal& traversal = traversals_.at(fetch.hash);
  const FeatureStore::Key& key = traversal.work->key();
  if (chunk.hash() != fetch.hash || chunk.block() != static_cast<std::uint32_t>(fetch.block) ||
      chunk.frames() != fetch.frames || chunk.encoder().c_str() != key.encoder ||
      chunk.dimension() != static_cast<std::uint32_t>(key.dimension))
    return;
  if (fetch.blob.chunks.missing() < chunk_count(fetch.bytes) && chunk.checksum() != fetch.checksum)
    fetch.blob = Blob(fetch.bytes);  // it was written again meanwhile
  fetch.checksum = chunk.checksum();
  if (fetch.blob.take(chunk.chunk(), chunk.data()) != Taken::kYes) return;
  fetch.timer.answered(now);
  if (!fetch.blob.complete()) return;
  if (!finish(fetch, *traversal.work)) {
    ++node_.traffic.rejected;
    fetch.blob = Blob(fetch.bytes);
    fetch.timer.ask_now();
    if (++fetch.damaged < kMaxDamaged) return;
    spdlog::warn("encoder_service '{}' sends damaged descriptors", chunk.header().sender().c_str());
    traversal.claims.withhold(found->first, fetch.block);
  }
  fetches_.erase(found);
}

/// Puts what has come to the rest. Returns false when it is damaged.
bool DescriptorExchange::finish(Fetch& fetch, TraversalWork& work) {
  const Bytes bytes = fetch.blob.release();
  const auto* from = reinterpret_cast<const std::uint8_t*>(bytes.data());
  if (checksum({from, bytes.size()}) != fetch.checksum) return false;
  Eigen::MatrixXf descriptors(work.key().dimension, std::popcount(fetch.frames));
  std::memcpy(descriptors.data(), from, bytes.size());
  if (!descriptors.allFinite()) return false;
  Eigen::Index column = 0;
  for (const int frame : BlockClaims::frames_of(fetch.block, fetch.frames))
    work.put_fetched(frame, descriptors.col(column++));
  return true;
}

void DescriptorExchange::begin_fetches() {
  for (const auto& [incarnation, peer] : peers_)
    for (auto& [hash, traversal] : traversals_)
      if (fetches_.contains(incarnation))
        break;
      else if (traversal.work && !traversal.work->complete())
        begin_fetch(incarnation, hash, traversal);
}

void DescriptorExchange::begin_fetch(std::uint64_t incarnation, std::uint64_t hash, Traversal& traversal) {
  BlockClaims& claims = traversal.claims;
  TraversalWork& work = *traversal.work;
  const BlockClaims::Peer& peer = claims.peers().at(incarnation);
  for (int block = 0; block < static_cast<int>(work.lacking().size()); ++block) {
    const auto wanted = [&] { return claims.offered(peer, block) & work.lacking()[static_cast<std::size_t>(block)]; };
    if (wanted() == 0 || claims.has(block)) continue;
    if (std::popcount(wanted()) < kMinFramesAsked && claims.encoded_by_peer(block)) continue;
    if (std::any_of(fetches_.begin(), fetches_.end(),
                    [&](const auto& entry) { return entry.second.hash == hash && entry.second.block == block; }))
      continue;
    work.look_for(block);  // with a common store they are there already
    if (wanted() == 0) continue;
    fetches_.emplace(incarnation, Fetch{hash, block, wanted(), bytes_of(wanted(), work.key().dimension)});
    return;
  }
}

void DescriptorExchange::ask(std::uint64_t incarnation, Fetch& fetch, Clock::time_point now) {
  request_.encoder_service() = peers_.at(incarnation).id.c_str();
  request_.hash() = fetch.hash;
  request_.encoder() = traversals_.at(fetch.hash).work->key().encoder.c_str();
  request_.block() = static_cast<std::uint32_t>(fetch.block);
  request_.frames() = fetch.frames;
  request_.chunks() = fetch.blob.chunks.first_missing(msg::MAX_CHUNKS_ASKED);
  node_.publish(request_);
  fetch.timer.sent(now, request_.chunks().size());
}

void DescriptorExchange::advance(Clock::time_point now) {
  std::vector<std::uint64_t> gone;
  for (const auto& [incarnation, peer] : peers_)
    if (!peer.presence.here(now)) gone.push_back(incarnation);
  for (const std::uint64_t incarnation : gone) drop(incarnation);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    if (!fetch->second.timer.gave_up(now)) {
      ++fetch;
      continue;
    }
    traversals_.at(fetch->second.hash).claims.withhold(fetch->first, fetch->second.block);
    fetch = fetches_.erase(fetch);
  }
  begin_fetches();
  for (auto& [incarnation, fetch] : fetches_)
    if (fetch.timer.is_due(now)) ask(incarnation, fetch, now);
  for (auto& [hash, traversal] : traversals_)
    if (traversal.claims.fill(now, traversal.work ? traversal.work->present() : std::span<const std::uint64_t>(),
                              status_))
      node_.publish(status_);
}

}  // namespace citylearn
