// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "policy_service/results/pairing.h"
#include "policy_service/results/score.h"

namespace citylearn {

/// Returns SPL as a table for people: a row for each traversal, a column for each policy, the agent's first. At most 80
/// columns wide with the names of the controls and a traversal of up to 20 letters.
std::string spl_matrix(const std::string& agent, const std::vector<ScoreRow>& rows);

/// What a verdict knows beside SPL.
struct VerdictOptions {
  std::vector<std::string> trained_on = {};      ///< traversals; success there shows nothing about others
  std::map<std::string, Pairing> pairings = {};  ///< by traversal, as examine_pairs() of it and the one trained on
  bool unchecked = false;                        ///< whether the agent learned from such features is not known
  std::string world = {};                        ///< what take_world() took off: "slip0.1"
};

/// Takes what the names of traversals tell of an imperfect world off them, where all tell the same.
void take_world(std::vector<ScoreRow>& rows, VerdictOptions& options);

/// Returns, in words, how the agent does on each traversal compared with the controls among `rows`, why it fails as far
/// as the controls tell, and what to try. Each line ends with a line break. Empty when there are no rows of others to
/// compare with.
std::string verdict(const std::string& agent, const std::vector<ScoreRow>& rows, const VerdictOptions& options = {});

}  // namespace citylearn
