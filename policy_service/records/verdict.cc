// SPDX-License-Identifier: Apache-2.0
#include "policy_service/records/verdict.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <map>
#include <optional>

#include "core/util/wrap.h"

namespace citylearn {
namespace {

// Differences of SPL that 2,000 tasks can show.
constexpr double kSame = 0.02;
// From here on we say that an agent finds its way, and that a control shows a task to be possible.
constexpr double kGood = 0.9;

/// SPL by policy and traversal.
using Table = std::map<std::string, std::map<std::string, double>>;

Table table_of(const std::vector<ScoreRow>& rows) {
  Table result;
  for (const ScoreRow& row : rows) result[row.policy][row.traversal] = row.score.spl;
  return result;
}

std::optional<double> find(const Table& table, const std::string& policy, const std::string& traversal) {
  const auto row = table.find(policy);
  if (row == table.end()) return std::nullopt;
  const auto cell = row->second.find(traversal);
  return cell == row->second.end() ? std::nullopt : std::optional<double>(cell->second);
}

/// Returns the names in the order of the rows, each once, `first` before all others.
std::vector<std::string> names(const std::vector<ScoreRow>& rows, std::string ScoreRow::*name,
                               const std::string& first = "") {
  std::vector<std::string> result;
  for (const ScoreRow& row : rows)
    if (std::find(result.begin(), result.end(), row.*name) == result.end()) {
      if (row.*name == first)
        result.insert(result.begin(), first);
      else
        result.push_back(row.*name);
    }
  return result;
}

/// Returns why an agent fails on a traversal and what to try, as far as the controls tell; empty if they do not.
std::string cause(const Table& table, const std::string& traversal) {
  const auto oracle = find(table, "oracle_filter", traversal), filter = find(table, "sequence_filter", traversal);
  if (oracle && *oracle < kGood)
    return fmt::format(
        "Places of this route look alike: oracle_filter, which was given '{}' itself, reaches {:.3f}. Try an encoder "
        "with more detail (--encoder, --dimension), or another part of the route (--frames).",
        traversal, *oracle);
  if (oracle && filter && *filter < kGood)
    return fmt::format(
        "Its frames differ too much from the training's: sequence_filter reaches {:.3f}, and {:.3f} if given '{}' "
        "itself. Try another encoder (./run vpr compares them) or more recordings to train on (--train A,B).",
        *filter, *oracle, traversal);
  if (filter && *filter >= kGood)
    return fmt::format(
        "Its frames suffice: sequence_filter reaches {:.3f}. Train longer (--steps) or try another agent.", *filter);
  return "";
}

}  // namespace

std::string spl_matrix(const std::string& agent, const std::vector<ScoreRow>& rows) {
  const std::vector<std::string> policies = names(rows, &ScoreRow::policy, agent);
  const Table table = table_of(rows);
  std::size_t first = 9;
  for (const ScoreRow& row : rows) first = std::max(first, row.traversal.size());
  // A policy's name takes two lines, so that its column is narrow.
  std::string upper = fmt::format("{:<{}}", "SPL", first), lower = fmt::format("{:<{}}", "traversal", first);
  std::vector<std::size_t> widths;
  for (const std::string& policy : policies) {
    const std::size_t cut = policy.find('_');
    const std::string above = cut == std::string::npos ? "" : policy.substr(0, cut);
    const std::string below = cut == std::string::npos ? policy : policy.substr(cut + 1);
    widths.push_back(std::max<std::size_t>({5, above.size(), below.size()}));
    upper += fmt::format("  {:>{}}", above, widths.back());
    lower += fmt::format("  {:>{}}", below, widths.back());
  }
  std::string text = upper + "\n" + lower + "\n";
  for (const std::string& traversal : names(rows, &ScoreRow::traversal)) {
    text += fmt::format("{:<{}}", traversal, first);
    for (std::size_t i = 0; i < policies.size(); ++i) {
      const auto spl = find(table, policies[i], traversal);
      text += fmt::format("  {:>{}}", spl ? fmt::format("{:.3f}", *spl) : "-", widths[i]);
    }
    text += "\n";
  }
  return text;
}

std::string verdict(const std::string& agent, const std::vector<ScoreRow>& rows) {
  const Table table = table_of(rows);
  if (table.size() < 2) return "";
  std::vector<std::string> good;
  double lowest = 1, highest = 0;
  std::string others;
  bool sees = true;
  for (const std::string& traversal : names(rows, &ScoreRow::traversal)) {
    const auto own = find(table, agent, traversal);
    if (!own) continue;
    const auto blind = find(table, "blind", traversal), filter = find(table, "sequence_filter", traversal);
    const auto shuffled = find(table, "shuffled", traversal);
    if (shuffled && *shuffled >= *own - kSame) sees = false;
    std::string fault;
    if (blind && agent != "blind" && *own < *blind + kSame)
      fault = fmt::format("is no better than blind, which never looks ({:.3f})", *blind);
    else if (filter && *own < *filter - kSame)
      fault = fmt::format("is worse than sequence_filter, which has learned nothing ({:.3f})", *filter);
    else if (*own < kGood)
      fault = "finds its way in part";
    if (fault.empty()) {
      good.push_back(traversal);
      lowest = std::min(lowest, *own);
      highest = std::max(highest, *own);
      continue;
    }
    others += wrapped(fmt::format("In {} {} {}: SPL {:.3f}.", traversal, agent, fault, *own)) + "\n";
    if (const std::string why = cause(table, traversal); !why.empty()) others += "  " + wrapped(why, 2) + "\n";
  }
  std::string text;
  if (!good.empty())
    text = wrapped(fmt::format("{} finds its way in {} (SPL {:.3f}{}).", agent, fmt::join(good, ", "), lowest,
                               highest - lowest < 0.0005 ? "" : fmt::format(" to {:.3f}", highest))) +
           "\n";
  if (!sees) text += "It does as well on shuffled frames, so it does not use what it sees.\n";
  return text + others;
}

}  // namespace citylearn
