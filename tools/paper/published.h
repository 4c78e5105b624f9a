// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <optional>
#include <string>

namespace citylearn::paper {

/// What the paper says of an agent at the end of its training (Chancan & Milford, ICRA 2020: 128 places, 16 agents,
/// mean of five seeds). NaN and "" where it gives no figure.
struct Published {
  double reward = NAN;   ///< mean of an episode
  std::string steps;     ///< an episode, in its words
  double as_many = NAN;  ///< steps that these words still cover
};

/// Of the paper's agent that is like ours: `features` with so many features a frame, `baseline`; nothing of others.
inline std::optional<Published> published(const std::string& agent, int features) {
  if (agent == "baseline") return Published{0.99, "just under 50", 50};
  if (agent == "features" && features == 64) return Published{0.92, "just over 50", 55};
  if (agent == "features" && features >= 512) return Published{NAN, "about 75", 80};
  return std::nullopt;
}

inline constexpr double kPaperFeatureMinutes = 11;        ///< of training, 64 features
inline constexpr double kPaperRawMinutes = 29 * 60 + 48;  ///< raw images
inline constexpr double kPaperGigabytes = 2;              ///< of memory per environment
inline constexpr double kStreetLearnGigabytes = 12;       ///< likewise, as the paper has it

/// An agent that the paper's authors released, walked by this project: NetVLAD features (64) of Nordland's first 128
/// frames, at most 128 steps, 2,000 to 4,000 tasks.
struct Released {
  const char* label;
  const char* agent;      ///< ours that is like it
  const char* condition;  ///< of Nordland
  bool learned;           ///< from this traversal
  double completed, steps, reward;
};
inline constexpr std::array kReleased = {
    Released{"authors' NetVLAD-64 agent", "features", "summer", true, 0.867, 64.5, 0.68},
    Released{"authors' NetVLAD-64 agent", "features", "fall", false, 0.896, 63.1, NAN},
    Released{"authors' baseline agent", "baseline", "summer", true, 1.0, 43.4, 0.998},
};

}  // namespace citylearn::paper
