// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>

namespace citylearn {

/// A set of numbers from 1 on, kept as ranges, for things that are counted without gaps and arrive in any order.
class NumberSet {
 public:
  /// Returns false when the number was there already. 0 is never there.
  bool add(std::uint64_t number) {
    if (number == 0 || contains(number)) return false;
    add(number, number);
    return true;
  }
  void add(std::uint64_t first, std::uint64_t last) {
    first = std::max<std::uint64_t>(first, 1);
    if (last < first) return;
    auto next = ranges_.upper_bound(first);
    if (next != ranges_.begin() && std::prev(next)->second >= first - 1) {
      --next;
      first = next->first;
    }
    while (next != ranges_.end() && (last == kMaxNumber || next->first <= last + 1)) {
      last = std::max(last, next->second);
      next = ranges_.erase(next);
    }
    ranges_[first] = last;
  }
  void add(const NumberSet& others) {
    for (const auto& [first, last] : others.ranges_) add(first, last);
  }
  /// Removes all numbers from `first` on.
  void remove_from(std::uint64_t first) {
    ranges_.erase(ranges_.lower_bound(first), ranges_.end());
    if (!ranges_.empty() && ranges_.rbegin()->second >= first) ranges_.rbegin()->second = first - 1;
  }
  bool contains(std::uint64_t number) const {
    const auto next = ranges_.upper_bound(number);
    return next != ranges_.begin() && std::prev(next)->second >= number;
  }
  /// Returns the largest number up to which all are there.
  std::uint64_t reach() const { return ranges_.empty() || ranges_.begin()->first != 1 ? 0 : ranges_.begin()->second; }
  /// Returns how many of first..last are there.
  std::uint64_t count(std::uint64_t first, std::uint64_t last) const {
    std::uint64_t sum = 0;
    for (const auto& [from, to] : ranges_)
      if (from <= last && to >= first) sum += std::min(to, last) - std::max(from, first) + 1;
    return sum;
  }

 private:
  static constexpr std::uint64_t kMaxNumber = std::numeric_limits<std::uint64_t>::max();
  std::map<std::uint64_t, std::uint64_t> ranges_;  // first to last, neither touching nor overlapping
};

/// Numbers that were recorded of a stream that its sender counts from 1 without gaps, and numbers that were given up
/// because they will never come. The latter rest on a message of others. So a number that comes all the same is
/// recorded, and from it on nothing counts as given up: one wrong message does not silence what follows.
class RecordedNumbers {
 public:
  /// Returns false when the number was recorded already.
  bool record(std::uint64_t number) {
    if (!recorded_.add(number)) return false;
    if (!settled_.add(number)) {
      settled_.remove_from(number);
      settled_.add(recorded_);
    }
    return true;
  }
  void record(const NumberSet& numbers) {
    recorded_.add(numbers);
    settled_.add(numbers);
  }
  void give_up(std::uint64_t first, std::uint64_t last) { settled_.add(first, last); }
  const NumberSet& recorded() const { return recorded_; }
  const NumberSet& settled() const { return settled_; }  ///< recorded or given up

 private:
  NumberSet recorded_, settled_;
};

}  // namespace citylearn
