// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/verdict.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <tuple>

#include "core/command_line/wrap.h"
#include "core/task/imperfections.h"
#include "policy_service/results/comparison.h"

namespace citylearn {
namespace {

// Differences of SPL that 2,000 tasks can show.
constexpr double kSplTolerance = 0.02;
// From here on we say that an agent finds its way, and that a control shows a task to be possible.
constexpr double kGoodSpl = 0.9;
// Percent of its tasks that shortest_path completes at least where the step limit suffices.
constexpr double kMostCompleted = 95;

/// A figure by policy and traversal.
using Table = std::map<std::string, std::map<std::string, double>>;

Table table_of(const std::vector<ScoreRow>& rows, double Score::*figure = &Score::spl, double unit = 1) {
  Table result;
  for (const ScoreRow& row : rows) result[row.policy][row.traversal] = unit * (row.score.*figure);
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

enum class Fault { kNone, kBlind, kFilter, kPart };
enum class Cause { kUnknown, kSteps, kPairs, kAlike, kUnlike, kChanged, kAgent, kUnchecked };

/// Traversals on which the same can be said of an agent, with the SPL of each.
struct Group {
  std::vector<std::string> traversals;
  std::vector<double> own, blind, filter, oracle;
  std::vector<double> shortest_completed;  // percent of tasks
  std::vector<double> apart;               // places
};

Fault fault_of(double own, std::optional<double> blind, std::optional<double> filter) {
  if (blind && own < *blind + kSplTolerance) return Fault::kBlind;
  if (filter && own < *filter - kSplTolerance) return Fault::kFilter;
  return own < kGoodSpl ? Fault::kPart : Fault::kNone;
}

Cause cause_of(std::optional<double> filter, std::optional<double> oracle, std::optional<double> shortest_completed,
               const Pairing& pairing) {
  if (shortest_completed && *shortest_completed < kMostCompleted) return Cause::kSteps;
  if (pairing.apart > 0) return Cause::kPairs;
  if (oracle && *oracle < kGoodSpl) return Cause::kAlike;
  if (filter && *filter >= kGoodSpl) return Cause::kAgent;
  if (pairing.unlike) return Cause::kUnlike;
  return oracle && filter ? Cause::kChanged : Cause::kUnknown;
}

/// Returns "0.970", or "0.969 to 1.000".
std::string range(const std::vector<double>& values, int digits = 3) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  const std::string from = fmt::format("{:.{}f}", *low, digits), to = fmt::format("{:.{}f}", *high, digits);
  return from == to ? from : from + " to " + to;
}

std::string sentence(const std::string& agent, Fault fault, const Group& group, bool trained) {
  const std::string own = range(group.own);
  const std::string where = fmt::format("{}{}", fmt::join(group.traversals, ", "), trained ? ", where it trained" : "");
  switch (fault) {
    case Fault::kNone:
      return fmt::format("{} finds its way in {} (SPL {}).", agent, where, own);
    case Fault::kBlind:
      return fmt::format("{} is no better than blind, which never looks, in {} (SPL {}, blind {}).", agent, where, own,
                         range(group.blind));
    case Fault::kFilter:
      return fmt::format("{} is worse than sequence_filter, which has learned nothing, in {} (SPL {}, filter {}).",
                         agent, where, own, range(group.filter));
    case Fault::kPart:
      return fmt::format("{} finds its way only in part in {} (SPL {}).", agent, where, own);
  }
  return "";
}

/// Returns why an agent fails and what to try, as far as the controls tell; empty if they do not.
std::string advice(Cause cause, const Group& group) {
  switch (cause) {
    case Cause::kUnknown:
      return "";
    case Cause::kSteps:
      return fmt::format(
          "The step limit is too low: shortest_path, which sees its position, reaches {} % of its goals. Raise "
          "--max-steps, or leave it out.",
          range(group.shortest_completed, 0));
    case Cause::kPairs:
      return fmt::format(
          "The pairs are wrong there: by what they show, frames of one index are about {} places apart. Have "
          "them matched by what they show (--align-by sight), or tell which show the same place (DIR/matches.csv).",
          range(group.apart, 0));
    case Cause::kAlike:
      return fmt::format(
          "Places look alike there: oracle_filter, which was given the very frames, reaches {}. Try an encoder with "
          "more detail (--encoder, --dimension), or another part of the route (--frames).",
          range(group.oracle));
    case Cause::kUnlike:
      return fmt::format(
          "No part of it looks like the training's, in whatever order: it may show another street, or nothing that "
          "tells places apart. Look at it (citylearn data check). If it is the right one, try another encoder "
          "(citylearn vpr compares them).");
    case Cause::kChanged:
      return fmt::format(
          "The frames differ too much from the training's: sequence_filter reaches {}, and {} if given the very "
          "frames. Try another encoder (citylearn vpr compares them) or more recordings to train on (--train A,B).",
          range(group.filter), range(group.oracle));
    case Cause::kAgent:
      return fmt::format("The frames suffice: sequence_filter reaches {}. Train longer (--steps) or try another agent.",
                         range(group.filter));
    case Cause::kUnchecked:
      return fmt::format(
          "The frames suffice: sequence_filter reaches {}. The checkpoint does not say what the agent learned from: "
          "evaluate it with the recordings, frames and encoder of its training.",
          range(group.filter));
  }
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

void take_world(std::vector<ScoreRow>& rows, VerdictOptions& options) {
  const std::string world = rows.empty() ? "" : world_of(rows.front().traversal);
  for (const ScoreRow& row : rows)
    if (world_of(row.traversal) != world) return;
  if (world.empty()) return;
  const auto without = [&world](const std::string& name) {
    return name.ends_with("-" + world) ? name.substr(0, name.size() - world.size() - 1) : name;
  };
  for (ScoreRow& row : rows) row.traversal = without(row.traversal);
  for (std::string& name : options.trained_on) name = without(name);
  std::map<std::string, Pairing> pairings;
  for (const auto& [name, pairing] : options.pairings) pairings[without(name)] = pairing;
  options.pairings = pairings;
  options.world = world;
}

std::string verdict(const std::string& agent, const std::vector<ScoreRow>& rows, const VerdictOptions& options) {
  const Table table = table_of(rows), completed = table_of(rows, &Score::completed, 100);
  if (table.size() < 2) return "";
  std::map<std::tuple<bool, Fault, Cause>, Group> groups;
  bool shown = false, looks = false;  // shuffled frames; at what it sees
  bool finds = false;                 // its way, where it did not train
  std::vector<double> gains;          // of learning, where the agent did not train
  for (const std::string& traversal : names(rows, &ScoreRow::traversal)) {
    const auto own = find(table, agent, traversal), shuffled = find(table, "shuffled", traversal);
    if (!own) continue;
    const auto blind = agent == "blind" ? std::nullopt : find(table, "blind", traversal);
    const auto filter = find(table, "sequence_filter", traversal), oracle = find(table, "oracle_filter", traversal);
    shown = shown || shuffled;
    looks = looks || (shuffled && *shuffled < *own - kSplTolerance);
    const auto shortest = find(completed, "shortest_path", traversal);
    const Fault fault = fault_of(*own, blind, filter);
    const bool trained =
        std::find(options.trained_on.begin(), options.trained_on.end(), traversal) != options.trained_on.end();
    const auto pairs = options.pairings.find(traversal);
    const Pairing pairing = pairs == options.pairings.end() ? Pairing() : pairs->second;
    finds = finds || (fault == Fault::kNone && !trained);
    Cause cause = fault == Fault::kNone ? Cause::kUnknown : cause_of(filter, oracle, shortest, pairing);
    if (cause == Cause::kAgent && options.unchecked) cause = Cause::kUnchecked;
    if (filter && !trained && agent != "sequence_filter") gains.push_back(*own - *filter);
    Group& group = groups[{trained, fault, cause}];
    group.traversals.push_back(traversal);
    group.own.push_back(*own);
    if (blind) group.blind.push_back(*blind);
    if (filter) group.filter.push_back(*filter);
    if (oracle) group.oracle.push_back(*oracle);
    if (pairing.apart > 0) group.apart.push_back(pairing.apart);
    if (shortest) group.shortest_completed.push_back(*shortest);
  }
  std::string text;
  for (const auto& [kind, group] : groups) {
    const auto [trained, fault, cause] = kind;
    text += wrapped(sentence(agent, fault, group, trained)) + "\n";
    if (const std::string what = advice(cause, group); !what.empty()) text += "  " + wrapped(what, 2) + "\n";
  }
  if (!gains.empty()) {
    const double gain = std::accumulate(gains.begin(), gains.end(), 0.0) / static_cast<double>(gains.size());
    text += gain_sentence({gain}) + "\n";
    if (finds && options.world.empty() && std::abs(gain) < kSplTolerance)
      text += wrapped("It pays where actions slip (docs/how-to/try-an-imperfect-world.md).") + "\n";
  }
  if (shown && !looks)
    text += wrapped(agent + " does as well on shuffled frames, so it does not use what it sees.") + "\n";
  return text;
}

}  // namespace citylearn
