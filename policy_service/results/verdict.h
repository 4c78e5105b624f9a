// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "policy_service/results/score.h"

namespace citylearn {

/// Returns SPL as a table for people: a row for each traversal, a column for each policy, the agent's first. At most 80
/// columns wide with the names of the controls and a traversal of up to 20 letters.
std::string spl_matrix(const std::string& agent, const std::vector<ScoreRow>& rows);

/// Returns, in words, how the agent does on each traversal compared with the controls among `rows`, why it fails as far
/// as the controls tell, and what to try. Each line ends with a line break. Empty when there are no rows of others to
/// compare with.
std::string verdict(const std::string& agent, const std::vector<ScoreRow>& rows);

}  // namespace citylearn
