// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/descriptor_exchange.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>

namespace citylearn {
namespace {

constexpr std::size_t kMaxTraversals = 4096;  // any process may name one
constexpr std::size_t kMaxEncoders = 256;     // of one session
constexpr int kMinFramesAsked = 16;           // frames of a block that a peer has not finished

}  // namespace

DescriptorExchange::DescriptorExchange(Node& node) : node_(node), started_(Clock::now()) {
  node_.create_reader<msg::DescriptorStatus>();
  node_.create_reader<msg::DescriptorRequest>();
  node_.create_reader<msg::DescriptorChunk>();
  node_.create_writer<msg::DescriptorStatus>();
}

BlockDivision& DescriptorExchange::division(std::uint64_t hash, std::uint32_t frames) {
  auto found = traversals_.find(hash);
  // What others say of it does not count as much as what this service was told by its env_service.
  if (found != traversals_.end() && found->second.division.frames() != frames) {
    traversals_.erase(found);
    found = traversals_.end();
  }
  return found == traversals_.end() ? add(hash, frames) : found->second.division;
}

BlockDivision& DescriptorExchange::add(std::uint64_t hash, std::uint32_t frames) {
  BlockDivision& division =
      traversals_.emplace(hash, Traversal{BlockDivision(node_.incarnation(), hash, frames)}).first->second.division;
  for (const auto& [incarnation, peer] : peers_) division.add_peer(incarnation, peer.id);
  return division;
}

void DescriptorExchange::share(TraversalWork& work) { traversals_.at(work.key().traversal).work = &work; }

/// Returns false when there are too many to take in another one.
bool DescriptorExchange::hear(std::uint64_t incarnation, const std::string& id, Clock::time_point now) {
  const auto known = peers_.find(incarnation);
  if (known != peers_.end()) {
    known->second.presence.heard(now);
    return true;
  }
  if (incarnation == 0 || peers_.size() >= kMaxEncoders) return false;
  spdlog::info("encoder_service '{}' takes part", id);
  peers_[incarnation] = {id, Presence(now)};
  for (auto& [hash, traversal] : traversals_) traversal.division.add_peer(incarnation, id);
  return true;
}

void DescriptorExchange::drop(std::uint64_t incarnation) {
  const auto found = peers_.find(incarnation);
  if (found == peers_.end()) return;
  spdlog::info("encoder_service '{}' takes part no longer", found->second.id);
  peers_.erase(found);
  fetches_.erase(incarnation);
  for (auto& [hash, traversal] : traversals_) traversal.division.remove_peer(incarnation);
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
  BlockDivision& division = found == traversals_.end() ? add(status.hash(), status.frames()) : found->second.division;
  division.take(status, now);
}

void DescriptorExchange::on_request(const msg::DescriptorRequest& request) {
  server_.answer(request, chunk_, [this] { node_.publish(chunk_); });
}

/// Returns the Descriptor of a key, or nothing where some of it is lacking.
std::shared_ptr<const ObjectBytes> DescriptorExchange::find(const ObjectKey& key) {
  const auto found = traversals_.find(key.hash);
  if (found == traversals_.end() || !found->second.work) return {};
  const TraversalWork& work = *found->second.work;
  const std::span<const std::uint64_t> present = work.present();
  // Only frames that this one announced are asked for, so others are asked of another process, or forged.
  if (key.part >= present.size() || key.item == 0 || (key.item & ~present[key.part]) != 0) return {};
  const auto dimension = static_cast<std::size_t>(work.key().dimension);
  msg::Descriptor object;
  object.encoder() = work.key().encoder.c_str();
  object.dimension() = work.key().dimension;
  object.values().resize(static_cast<std::size_t>(std::popcount(key.item)) * dimension);
  std::span<float> to(object.values());
  for (const int frame : BlockDivision::frames_of(static_cast<int>(key.part), key.item)) {
    if (!work.read(frame, to.first(dimension))) return {};  // lost on the disk: the one that asks encodes them
    to = to.subspan(dimension);
  }
  return std::make_shared<ObjectBytes>(key, encode_object(object));
}

void DescriptorExchange::on_chunk(const msg::DescriptorChunk& chunk, Clock::time_point now) {
  const auto found = fetches_.find(chunk.header().incarnation());
  if (found == fetches_.end()) return;
  Fetch& fetch = found->second;
  Traversal& traversal = traversals_.at(fetch.hash);
  bool damaged = fetch.object.take(chunk, now) == Taken::kDamaged;
  if (const auto object = fetch.object.next()) {
    const bool absent = object->bytes.empty();
    if (absent) traversal.division.withhold(found->first, fetch.block);
    if (absent || finish(fetch, *object, *traversal.work)) {
      fetches_.erase(found);
      return;
    }
    damaged = true;
    fetch.object.refuse(fetch.frames);
  }
  if (!damaged) return;
  ++node_.traffic.rejected;
  if (fetch.object.gave_up(now))
    spdlog::warn("encoder_service '{}' sends damaged descriptors", chunk.header().sender().c_str());
}

/// Puts what has come to the rest. Returns false when it is damaged.
bool DescriptorExchange::finish(const Fetch& fetch, const FetchedObject& object, TraversalWork& work) {
  const FeatureStore::Key& key = work.key();
  const int frames = std::popcount(fetch.frames);
  try {
    const auto descriptor = decode_object<msg::Descriptor>(object.bytes);
    if (descriptor.encoder() != key.encoder || descriptor.dimension() != static_cast<std::uint32_t>(key.dimension) ||
        descriptor.values().size() != static_cast<std::size_t>(frames) * static_cast<std::size_t>(key.dimension))
      return false;
    const Eigen::Map<const Eigen::MatrixXf> columns(descriptor.values().data(), key.dimension, frames);
    Eigen::Index column = 0;
    for (const int frame : BlockDivision::frames_of(fetch.block, fetch.frames))
      work.put_fetched(frame, columns.col(column++));
  } catch (const Error&) {
    return false;
  }
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
  BlockDivision& division = traversal.division;
  TraversalWork& work = *traversal.work;
  const BlockDivision::Peer& peer = division.peers().at(incarnation);
  for (int block = 0; block < static_cast<int>(work.lacking().size()); ++block) {
    const auto wanted = [&] { return division.offered(peer, block) & work.lacking()[static_cast<std::size_t>(block)]; };
    if (wanted() == 0 || division.encoding().contains(block)) continue;
    if (std::popcount(wanted()) < kMinFramesAsked && division.encoded_by_peer(block)) continue;
    if (std::any_of(fetches_.begin(), fetches_.end(),
                    [&](const auto& entry) { return entry.second.hash == hash && entry.second.block == block; }))
      continue;
    work.look_for(block);  // with a common store they are there already
    if (wanted() == 0) continue;
    fetches_.emplace(incarnation, Fetch{hash, block, wanted()}).first->second.object.want(wanted());
    return;
  }
}

void DescriptorExchange::ask(std::uint64_t incarnation, Fetch& fetch, Clock::time_point now) {
  request_.server() = peers_.at(incarnation).id.c_str();
  if (fetch.object.ask(now, request_)) node_.publish(request_);
}

void DescriptorExchange::advance(Clock::time_point now) {
  std::vector<std::uint64_t> gone;
  for (const auto& [incarnation, peer] : peers_)
    if (!peer.presence.here(now)) gone.push_back(incarnation);
  for (const std::uint64_t incarnation : gone) drop(incarnation);
  for (auto fetch = fetches_.begin(); fetch != fetches_.end();) {
    if (!fetch->second.object.gave_up(now)) {
      ++fetch;
      continue;
    }
    traversals_.at(fetch->second.hash).division.withhold(fetch->first, fetch->second.block);
    fetch = fetches_.erase(fetch);
  }
  begin_fetches();
  for (auto& [incarnation, fetch] : fetches_) ask(incarnation, fetch, now);
  for (auto& [hash, traversal] : traversals_)
    if (traversal.division.fill(now, traversal.work ? traversal.work->present() : std::span<const std::uint64_t>(),
                                status_))
      node_.publish(status_);
}

}  // namespace citylearn
