// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/traversal_work.h"

#include <algorithm>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr auto kLookAgain = std::chrono::milliseconds(100);

}  // namespace

TraversalWork::TraversalWork(const std::string& folder, const FeatureStore::Key& key) : key_(key) {
  have_.assign(key.frames, false);
  if (folder.empty())
    memory_.setZero(key.dimension, key.frames);
  else
    store_ = std::make_unique<FeatureStore>(folder, key);
  look_into_store();
}

void TraversalWork::look_into_store() {
  looked_ = Clock::now();
  if (!store_) return;
  const std::vector<bool> present = store_->present();
  std::vector<float> numbers(static_cast<std::size_t>(key_.dimension));
  for (int frame = 0; frame < key_.frames; ++frame)
    // Reads it too: after a loss of power the index may name a frame whose numbers are gone.
    if (present[frame] && !have_[frame] && store_->read(frame, numbers)) {
      have_[frame] = true;
      ++done_;
    }
  release_finished_blocks();
}

void TraversalWork::release_finished_blocks() {
  for (auto block = blocks_.begin(); block != blocks_.end();) {
    const auto from = have_.begin() + block->first;
    const auto to = have_.begin() + std::min(block->first + kBlock, key_.frames);
    block = std::find(from, to, false) == to ? blocks_.erase(block) : std::next(block);
  }
}

std::optional<std::vector<int>> TraversalWork::reserve(int begin) {
  // The store is looked into when there is nothing else to do, but not at every call.
  if (store_ && Clock::now() >= looked_ + kLookAgain) look_into_store();
  const int blocks = (key_.frames + kBlock - 1) / kBlock;
  for (int i = 0; i < blocks; ++i) {
    const int first = (begin / kBlock + i) % blocks * kBlock;
    const int end = std::min(first + kBlock, key_.frames);
    if (blocks_.count(first) || std::find(have_.begin() + first, have_.begin() + end, false) == have_.begin() + end)
      continue;
    std::unique_ptr<FeatureStore::Claim> claim;
    if (store_) {
      claim = store_->claim(first, end - first);
      if (!claim) continue;
      look_into_store();  // the process that had it before may have finished it
    }
    std::vector<int> frames;
    for (int frame = first; frame < end; ++frame)
      if (!have_[frame]) frames.push_back(frame);
    if (frames.empty()) continue;
    blocks_[first] = std::move(claim);
    return frames;
  }
  return std::nullopt;
}

void TraversalWork::put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor) {
  if (have_[frame]) return;
  if (store_)
    store_->write(frame, {descriptor.data(), static_cast<std::size_t>(descriptor.size())});
  else
    memory_.col(frame) = descriptor;
  have_[frame] = true;
  ++done_;
  ++made_;
  release_finished_blocks();
}

void TraversalWork::put_bad(int frame) {
  if (have_[frame]) return;
  have_[frame] = true;
  ++done_;
  bad_.push_back(frame);
  release_finished_blocks();
}

Eigen::MatrixXf TraversalWork::take_descriptors() {
  if (static_cast<int>(bad_.size()) == key_.frames) throw Error("no frame could be encoded");
  Eigen::MatrixXf descriptors = store_ ? Eigen::MatrixXf(key_.dimension, key_.frames) : std::move(memory_);
  const auto is_bad = [this](int frame) { return std::find(bad_.begin(), bad_.end(), frame) != bad_.end(); };
  for (int frame = 0; store_ && frame < key_.frames; ++frame)
    if (!is_bad(frame) &&
        !store_->read(frame, {descriptors.col(frame).data(), static_cast<std::size_t>(key_.dimension)}))
      throw Error("lost frame " + std::to_string(frame), store_->path(), "start again: it will be encoded again");
  for (const int frame : bad_) {
    int nearest = -1;
    for (int distance = 1; nearest < 0; ++distance) {
      if (frame - distance >= 0 && !is_bad(frame - distance))
        nearest = frame - distance;
      else if (frame + distance < key_.frames && !is_bad(frame + distance))
        nearest = frame + distance;
    }
    descriptors.col(frame) = descriptors.col(nearest);
  }
  return descriptors;
}

}  // namespace citylearn
