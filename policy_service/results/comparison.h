// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace citylearn {

/// A figure over several runs. Runs without it (an SPL of 0.95 that was never reached) are not counted.
struct Spread {
  int count = 0;  ///< runs that have it; 0: the others mean nothing
  double mean = 0, median = 0, minimum = 0, maximum = 0;
  double deviation = 0;  ///< standard, of the sample; 0 for one run
};
Spread spread_of(std::vector<double> values);

/// Values of each figure, one a run; NaN where a run does not have it.
using Figures = std::map<std::string, std::vector<double>>;

/// Results of one agent: a single run, or the runs of a sweep.
struct RunGroup {
  struct Row {
    std::string policy, traversal;
    Figures figures;
  };
  std::string name;  ///< of the folder
  std::string agent, learner, middleware, traversal;
  std::vector<std::uint64_t> seeds;
  Figures training;       ///< empty when nothing was trained
  std::vector<Row> rows;  ///< those of the agent first
};

/// Reads a run's summary.json and the manifest beside it. Throws Error naming the file.
RunGroup read_summary(const std::string& path);
/// Joins runs of one agent.
RunGroup join(const std::vector<RunGroup>& runs);
/// Returns the text of sweep.json; `failed` says why, by seed.
std::string sweep_json(const RunGroup& group, const std::map<std::uint64_t, std::string>& failed);

/// Returns Markdown tables of several groups side by side: median (lowest..highest) of each figure. Where there is
/// sequence_filter, which learns nothing, also how much the agent differs from it in the same run.
std::string tables(const std::vector<RunGroup>& groups);
/// Returns, in a sentence, how far an agent's SPL lies above that of sequence_filter: the median of the runs, and the
/// lowest and highest.
std::string gain_sentence(const std::vector<double>& gains);
/// Returns the sentence, and a line break, for the runs of a group, each one's gain being the mean over the traversals
/// where it did not train; empty where there is nothing to compare with.
std::string gain_sentence(const RunGroup& group);
/// Returns tables() for folders with a sweep.json or a summary.json, or these files. Throws Error naming the one that
/// is neither.
std::string tables_of(const std::vector<std::string>& runs);

}  // namespace citylearn
