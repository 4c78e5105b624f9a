// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/traversal_work.h"

#include <algorithm>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr auto kStorePollInterval = std::chrono::milliseconds(100);
constexpr int kBlock = BlockDivision::kFrames;

std::size_t block_of(int frame) { return static_cast<std::size_t>(frame / kBlock); }
std::uint64_t bit_of(int frame) { return std::uint64_t{1} << (frame % kBlock); }

}  // namespace

TraversalWork::TraversalWork(const std::string& folder, const FeatureStore::Key& key, BlockDivision& division)
    : key_(key), division_(division) {
  present_.assign(block_of(key.frames - 1) + 1, 0);
  lacking_ = present_;
  for (int frame = 0; frame < key.frames; ++frame) lacking_[block_of(frame)] |= bit_of(frame);
  if (folder.empty())
    memory_ = std::make_unique<Eigen::MatrixXf>(Eigen::MatrixXf::Zero(key.dimension, key.frames));
  else
    store_ = std::make_unique<FeatureStore>(folder, key);
  look_into_store(true);
  division_.set_encoder(key.encoder, static_cast<std::uint32_t>(key.dimension));
}

bool TraversalWork::is_lacking(int frame) const { return (lacking_[block_of(frame)] & bit_of(frame)) != 0; }

void TraversalWork::note_done(int frame, bool present) {
  lacking_[block_of(frame)] &= ~bit_of(frame);
  if (present) present_[block_of(frame)] |= bit_of(frame);
  ++done_;
}

/// With `trust` it believes the index: what is missing after all is found when it is read.
void TraversalWork::look_into_store(bool trust) {
  looked_ = Clock::now();
  if (!store_) return;
  const std::vector<bool> there = store_->present();
  std::vector<float> numbers(static_cast<std::size_t>(key_.dimension));
  for (int frame = 0; frame < key_.frames; ++frame)
    // Reads it too: after a loss of power the index may name a frame whose numbers are gone.
    if (there[static_cast<std::size_t>(frame)] && is_lacking(frame) && (trust || store_->read(frame, numbers)))
      note_done(frame, true);
  release_finished_blocks();
}

void TraversalWork::look_for(int block) {
  if (!store_) return;
  std::vector<float> numbers(static_cast<std::size_t>(key_.dimension));
  for (const int frame : lacking_frames(block))
    if (store_->read(frame, numbers)) note_done(frame, true);
  release_finished_blocks();
}

std::vector<int> TraversalWork::lacking_frames(int block) const {
  return BlockDivision::frames_of(block, lacking_[static_cast<std::size_t>(block)]);
}

void TraversalWork::release_finished_blocks() {
  for (const int block : std::vector<int>(division_.encoding().begin(), division_.encoding().end()))
    if (lacking_[static_cast<std::size_t>(block)] == 0) drop({block});
}

/// Reserves a block in the store. Returns false when another process has it, or has finished it.
bool TraversalWork::reserve(int block) {
  if (!store_) return true;
  std::unique_ptr<FeatureStore::Claim> lock =
      store_->claim(block * kBlock, std::min(kBlock, key_.frames - block * kBlock));
  if (!lock) return false;
  look_for(block);
  if (lacking_[static_cast<std::size_t>(block)] == 0) return false;
  locks_[block] = std::move(lock);
  return true;
}

std::vector<int> TraversalWork::begin(Clock::time_point now) {
  // The store is looked into when there is nothing else to do, but not at every call.
  if (store_ && now >= looked_ + kStorePollInterval) look_into_store();
  const auto block = division_.begin(now, lacking_, [this](int one) { return reserve(one); });
  return block ? lacking_frames(*block) : std::vector<int>();
}

/// Leaves blocks to others, and returns their frames that are not done.
std::vector<int> TraversalWork::drop(const std::vector<int>& blocks) {
  std::vector<int> all;
  for (const int block : blocks) {
    division_.release(block);
    locks_.erase(block);
    const std::vector<int> frames = lacking_frames(block);
    all.insert(all.end(), frames.begin(), frames.end());
  }
  return all;
}

std::vector<int> TraversalWork::take_lost() { return drop(division_.take_lost(lacking_)); }

std::vector<int> TraversalWork::give_back() { return drop({division_.encoding().begin(), division_.encoding().end()}); }

int TraversalWork::take(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor) {
  if (!is_lacking(frame)) return 0;
  if (store_)
    store_->write(frame, {descriptor.data(), static_cast<std::size_t>(descriptor.size())});
  else
    memory_->col(frame) = descriptor;
  note_done(frame, true);
  release_finished_blocks();
  return 1;
}

void TraversalWork::put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor) {
  made_ += take(frame, descriptor);
}

void TraversalWork::put_fetched(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor) {
  fetched_ += take(frame, descriptor);
}

void TraversalWork::put_bad(int frame) {
  if (!is_lacking(frame)) return;
  note_done(frame, false);
  bad_.push_back(frame);
  release_finished_blocks();
}

bool TraversalWork::read(int frame, std::span<float> descriptor) const {
  if (store_) return store_->read(frame, descriptor);
  std::copy_n(memory_->col(frame).data(), descriptor.size(), descriptor.begin());
  return true;
}

void TraversalWork::lose(const std::vector<int>& frames) {
  for (const int frame : frames) {
    if (is_lacking(frame)) continue;
    lacking_[block_of(frame)] |= bit_of(frame);
    present_[block_of(frame)] &= ~bit_of(frame);
    --done_;
  }
}

void TraversalWork::read(std::span<const int> frames, Eigen::Ref<Eigen::MatrixXf> descriptors,
                         std::vector<int>& lost) const {
  if (static_cast<int>(bad_.size()) == key_.frames) throw Error("no frame could be encoded");
  const auto is_good = [this](int frame) {
    return frame >= 0 && frame < key_.frames && std::find(bad_.begin(), bad_.end(), frame) == bad_.end();
  };
  for (std::size_t i = 0; i < frames.size(); ++i) {
    int frame = frames[i];
    for (int distance = 1; !is_good(frame); ++distance)
      frame = is_good(frames[i] - distance) ? frames[i] - distance : frames[i] + distance;
    auto column = descriptors.col(static_cast<Eigen::Index>(i));
    if (!read(frame, {column.data(), static_cast<std::size_t>(column.size())})) lost.push_back(frame);
  }
}

}  // namespace citylearn
