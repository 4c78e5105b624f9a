// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>

#include "dashboard/store/rows.h"

namespace citylearn {

/// Names one picture for good: the hash of its traversal and its frame.
struct PictureKey {
  std::uint64_t hash = 0;
  std::uint32_t frame = 0;
  auto operator<=>(const PictureKey&) const = default;
};

/// Keeps the pictures used last, so that each is fetched and made smaller once. May be used by any thread.
class PictureCache {
 public:
  explicit PictureCache(std::size_t most_bytes) : most_(most_bytes) {}

  /// Returns null when it is not here.
  std::shared_ptr<const PictureFile> find(const PictureKey& key) {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    if (found == entries_.end()) return nullptr;
    order_.splice(order_.end(), order_, found->second.at);
    return found->second.picture;
  }
  /// Adds a picture and drops those used longest ago. A picture larger than the whole cache is not kept.
  void put(const PictureKey& key, PictureFile picture) {
    const std::lock_guard lock(mutex_);
    const std::size_t size = size_of(picture);
    if (size > most_) return;
    if (const auto found = entries_.find(key); found != entries_.end()) remove(found);
    while (bytes_ + size > most_) remove(entries_.find(order_.front()));
    order_.push_back(key);
    entries_[key] = {std::make_shared<const PictureFile>(std::move(picture)), std::prev(order_.end())};
    bytes_ += size;
  }
  std::size_t bytes() const {
    const std::lock_guard lock(mutex_);
    return bytes_;
  }

 private:
  struct Entry {
    std::shared_ptr<const PictureFile> picture;
    std::list<PictureKey>::iterator at;
  };
  using Entries = std::map<PictureKey, Entry>;
  static std::size_t size_of(const PictureFile& picture) { return picture.bytes.size() + 256; }  // and its entry
  void remove(Entries::iterator entry) {
    bytes_ -= size_of(*entry->second.picture);
    order_.erase(entry->second.at);
    entries_.erase(entry);
  }

  const std::size_t most_;
  mutable std::mutex mutex_;
  Entries entries_;
  std::list<PictureKey> order_;  // the one used last at the end
  std::size_t bytes_ = 0;
};

}  // namespace citylearn
