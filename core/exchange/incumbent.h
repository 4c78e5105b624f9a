// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "core/exchange/presence.h"
#include "core/exchange/timing.h"

namespace citylearn {

/// Decides which of several processes with one id counts, the incumbent: the one heard first, until it leaves or is
/// silent. It does not compare clocks of other hosts, so a wrong clock or a forged start time replaces no process. Used
/// by one thread.
class Incumbent {
 public:
  enum class Heard {
    kIncumbent,  ///< the incumbent
    kSuccessor,  ///< a process that has just become the incumbent
    kOther,      ///< another process
  };
  /// Notes a message of a process, by its incarnation (Header). No process has 0.
  Heard hear(std::uint64_t incarnation, Clock::time_point now) {
    if (incarnation == 0) return Heard::kOther;  // forged
    if (incarnation == incarnation_) {
      presence_.heard(now);
      rival_ = 0;
      return Heard::kIncumbent;
    }
    if (presence_.here(now) && !leaves_) {
      if (rival_ != incarnation) rival_since_ = now;
      rival_ = incarnation;
      if (now - rival_since_ < kHandover) return Heard::kOther;
    }
    previous_ = incarnation_;
    incarnation_ = incarnation;
    rival_ = 0;
    leaves_ = false;
    presence_.heard(now);
    return Heard::kSuccessor;
  }
  /// Notes that the incumbent ends or gives up its id: the next process that is heard takes over.
  void leave() { leaves_ = true; }

  /// Returns the incumbent, also when it is gone; 0: none was heard.
  std::uint64_t incarnation() const { return incarnation_; }
  /// Returns whether this process was the incumbent before the present one.
  bool preceded(std::uint64_t incarnation) const { return incarnation == previous_ && previous_ != 0; }
  bool here(Clock::time_point now) const { return presence_.here(now); }
  /// Returns whether another process is heard that may soon take over.
  bool has_rival(Clock::time_point now) const { return rival_ != 0 && now - rival_since_ < kHandover + kSilence; }
  Clock::time_point last_heard() const { return presence_.last_heard(); }

 private:
  std::uint64_t incarnation_ = 0, previous_ = 0, rival_ = 0;
  Clock::time_point rival_since_{};
  bool leaves_ = false;
  Presence presence_;
};

}  // namespace citylearn
