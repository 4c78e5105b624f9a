// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/ros2/subscription.h"
#include "core/util/types.h"
#include "ros2/ros2.h"

namespace citylearn {

/// The time of nodes: this host's, or what a simulator or a player of bags publishes on /clock (use_sim_time). The
/// latter may stand still, run at any speed, and be set back. Used by the participant's thread.
class Ros2Clock {
 public:
  using Topic = Ros2Subscription<rosgraph_msgs::msg::dds_::Clock_>;

  /// Lets the time be that of /clock from now on.
  void follow(Topic topic);
  /// Takes what has come on /clock. Logs that nothing has for five seconds of this host, or that it was set back.
  void poll(Clock::time_point now);

  bool simulated() const { return topic_.has_value(); }
  /// Returns whether the time is known: the first one has come.
  bool known() const { return !simulated() || heard_; }
  /// Returns nanoseconds since 1970, for stamps; 0 while the time is not known.
  std::uint64_t time() const;
  /// Returns the time by which deadlines go when the steady clock says `now`. It never goes back: what is set back
  /// goes on from there.
  Clock::time_point at(Clock::time_point now) const { return simulated() ? at_ : now; }
  /// Returns how often it was set back. Stamps from before that are not comparable with later ones.
  int setbacks() const { return setbacks_; }
  /// Says why time stands still, where that is nobody's wish; empty: it does not.
  const std::string& trouble() const { return trouble_; }

 private:
  void set(std::uint64_t time);

  std::optional<Topic> topic_;
  bool heard_ = false;
  std::uint64_t time_ = 0;
  Clock::time_point at_, last_alive_;  // last_alive_: somebody published it
  int setbacks_ = 0;
  std::string trouble_;
};

}  // namespace citylearn
