// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace citylearn {

struct ReplayOptions {
  std::vector<std::string> files;   ///< one after the other
  double speed = 1;                 ///< relative to the recording; 0: as fast as readers can follow
  std::vector<std::string> topics;  ///< "scene" or "citylearn/scene"; empty: those that a dashboard reads
  std::string session;              ///< played in this session; empty: in the one recorded
};

/// Returns the default topics of ReplayOptions: what services say about themselves, and nothing that a service obeys.
std::vector<std::string> watched_topics();

/// Parses ReplayOptions::speed: a number above 0, or max. Throws Error when it is neither.
double replay_speed(const std::string& text);

struct ReplayFigures {
  std::map<std::string, std::uint64_t> played;   ///< messages by topic
  std::map<std::string, std::uint64_t> skipped;  ///< messages by what was wrong with them
  std::uint64_t bytes = 0;                       ///< played
  std::uint64_t repeated = 0;                    ///< messages sent again
  double seconds = 0;                            ///< that the recordings last
  std::vector<std::string> remarks;              ///< lines: a file that is cut short, a recorder that went away
};

}  // namespace citylearn
