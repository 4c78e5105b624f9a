// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>

#include "core/exchange/incumbent.h"

namespace citylearn {

/// Says when a command goes out: at once, then less and less often until its target shows that it obeys. It knows
/// neither the command nor a clock. Used by one thread.
class CommandSender {
 public:
  /// Begins with a new command, or anew with one that its target has forgotten.
  void begin(Clock::time_point now) {
    since_ = next_ = now;
    interval_ = kCommandResend;
  }
  /// Notes that the target obeys.
  void confirm() { next_ = Clock::time_point::max(); }
  bool unconfirmed() const { return next_ != Clock::time_point::max(); }
  /// Returns whether to send the command now, which then counts as sent.
  bool take_due(Clock::time_point now) {
    if (now < next_) return false;
    next_ = now + interval_;
    interval_ = std::min<Clock::duration>(2 * interval_, kCommandResendMax);
    return true;
  }
  /// Returns when the command goes out next; the clock's end once it is confirmed.
  Clock::time_point due() const { return next_; }
  /// Notes that the target cannot obey now. unconfirmed_for() counts from here.
  void hold(Clock::time_point now) { since_ = now; }
  /// Returns for how long the target could have obeyed, but did not.
  Clock::duration unconfirmed_for(Clock::time_point now) const {
    return unconfirmed() ? now - since_ : Clock::duration();
  }

 private:
  Clock::time_point since_{}, next_ = Clock::time_point::max();
  Clock::duration interval_{};
};

/// A command whose version is further ahead of the last one obeyed is forged: no commander loses so many.
inline constexpr std::uint32_t kMaxVersionsAhead = 1u << 20;

/// Decides which commands a target obeys. In charge is the first commander that gave it work, until that one releases
/// the target, leaves or is silent. Commanders are named by their incarnations, and each numbers its commands from 1.
/// Used by one thread.
class CommandTarget {
 public:
  enum class Verdict {
    kNew,          ///< its sender is in charge from now on
    kOld,          ///< it was obeyed before, or a newer one was
    kTooFarAhead,  ///< it is forged (kMaxVersionsAhead)
    kNotInCharge,  ///< another commander is in charge
  };
  /// Judges a command. The target then carries out a new one and calls obey(), or refuses it.
  Verdict take(std::uint64_t commander, std::uint32_t version, Clock::time_point now) {
    const auto known = obeyed_.find(commander);
    const std::uint32_t obeyed = known == obeyed_.end() ? 0 : known->second;
    if (version <= obeyed) return Verdict::kOld;
    if (version - obeyed > kMaxVersionsAhead) return Verdict::kTooFarAhead;
    // Not for the same commander: leave() would outlast its new command, and any other could take over at once.
    if (!works_ && commander != incumbent_.incarnation()) incumbent_.leave();
    const std::uint64_t before = works_ ? incumbent_.incarnation() : 0;
    const Incumbent::Heard heard = incumbent_.hear(commander, now);
    if (heard == Incumbent::Heard::kOther) return Verdict::kNotInCharge;
    if (heard == Incumbent::Heard::kSuccessor) replaced_ = before;
    works_ = false;
    return Verdict::kNew;
  }
  /// Notes that the target obeys the command that take() found new: it works from now on, or is released. A command
  /// that is refused does not become old, so that a forged one cannot make the true ones old.
  void obey(std::uint32_t version, bool works) {
    if (obeyed_.size() >= kMaxCommanders) obeyed_.clear();
    obeyed_[incumbent_.incarnation()] = version;
    works_ = works;
  }
  /// Notes a message of a commander, which shows that it lives, or that it leaves.
  void hear(std::uint64_t commander, Clock::time_point now, bool leaves = false) {
    if (!in_charge(commander)) return;
    incumbent_.hear(commander, now);
    if (leaves) incumbent_.leave();
  }

  /// Returns whether any commander, or this one, has given the target work and not released it since.
  bool in_charge() const { return works_; }
  bool in_charge(std::uint64_t commander) const { return works_ && commander == incumbent_.incarnation(); }
  /// Returns whether this commander was in charge before the present one, which took the target over from it.
  bool replaced(std::uint64_t commander) const { return works_ && commander != 0 && commander == replaced_; }
  /// Returns when the commander in charge, or else the last one that was, was last heard.
  Clock::time_point last_heard() const { return incumbent_.last_heard(); }
  bool silent(Clock::time_point now) const { return !incumbent_.here(now); }

 private:
  static constexpr std::size_t kMaxCommanders = 256;  // remembered
  std::map<std::uint64_t, std::uint32_t> obeyed_;     // newest version obeyed, by commander
  Incumbent incumbent_;
  std::uint64_t replaced_ = 0;
  bool works_ = false;
};

}  // namespace citylearn
