// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/comparison.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// What summary.json calls the figures, in the order of sweep.json.
const std::vector<std::string> kTrainingFigures = {
    "episodes", "steps", "wall_s", "steps_per_s", "reward", "spl", "episodes_to_spl95", "wall_s_to_spl95"};
const std::vector<std::string> kScoreFigures = {"completed", "spl", "excess", "mean_steps", "shortest_mean", "reward"};

constexpr const char* kUnlearned = "sequence_filter";

/// Returns a figure, NaN for null. Throws Error naming it, as one of `where`, when it cannot be.
double checked_figure(const Json& value, const std::string& figure, const std::string& where) {
  const bool share = figure == "completed" || figure == "spl", any = figure == "reward";
  if (value.is_null()) return std::numeric_limits<double>::quiet_NaN();
  if (const double number = value.is_number() ? value.get<double>() : std::nan("");
      (any || number >= 0) && (share ? number <= 1 : std::isfinite(number)))
    return number;
  const char* const range = share ? " from 0 to 1" : any ? "" : " of 0 or more";
  throw Error("'" + figure + "' is " + value.dump().substr(0, 40) + ", not a number" + range, where,
              "was it edited? A run that ends writes it anew");
}

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json parse_file(const std::string& path) {
  return parse_json<Json>(read_file(path), path, "a run that ended writes it anew");
}

void append(Figures& to, const Figures& from) {
  for (const auto& [figure, values] : from) to[figure].insert(to[figure].end(), values.begin(), values.end());
}

Json figures_json(const Figures& figures, const std::vector<std::string>& order) {
  Json json = Json::object();
  for (const std::string& figure : order) {
    const std::vector<double>& values = figures.at(figure);
    const Spread s = spread_of(values);
    Json& one = json[figure] = {{"count", s.count}};
    for (const auto& [name, value] : {std::pair{"mean", s.mean},
                                      std::pair{"median", s.median},
                                      {"min", s.minimum},
                                      {"max", s.maximum},
                                      {"deviation", s.deviation}})
      one[name] = s.count > 0 ? Json(value) : Json(nullptr);
    for (const double value : values) one["values"].push_back(or_null(value));
  }
  return json;
}

/// Reads a run's summary.json, with the manifest beside it, or a sweep.json, whose figures have values of several runs.
RunGroup read_group(const std::string& path, bool sweep) {
  const Json file = parse_file(path);
  const auto figures = [&](const Json& from, const std::vector<std::string>& names, const std::string& of) {
    Figures read;
    for (const std::string& figure : names)
      for (const Json& value : sweep ? from.at(figure).at("values") : Json::array({from.at(figure)}))
        read[figure].push_back(checked_figure(value, figure, path + ": " + of));
    return read;
  };
  try {
    RunGroup group;
    group.agent = file.at("agent");
    group.middleware = file.at("middleware");
    group.seeds = (sweep ? file.at("seeds") : Json::array({file.at("seed")})).get<std::vector<std::uint64_t>>();
    if (sweep || file.contains("train")) {
      const Json& training = file.at("train");
      group.traversal = (sweep ? file : training).at("traversal");
      group.training = figures(training, kTrainingFigures, "train");
      group.learner =
          (sweep ? file : parse_file((fs::path(path).parent_path() / "manifest.json").string())).at("learner");
    }
    const auto add = [&](const std::string& policy, const Json& traversals) {
      for (const auto& [traversal, scores] : traversals.items())
        group.rows.push_back({policy, traversal, figures(scores, kScoreFigures, policy + " on " + traversal)});
    };
    add(group.agent, file.at("evaluate"));
    for (const auto& [control, traversals] : file.at("controls").items()) add(control, traversals);
    return group;
  } catch (const nlohmann::json::exception&) {
    throw Error("is not the summary of a run or a sweep", path, "name a folder with summary.json or sweep.json");
  }
}

/// "0.991 (0.985..0.994)", the median first; one number where all are alike; how many, where some runs lack it; "-"
/// where all do.
std::string cell(const Figures& figures, const std::string& figure, int digits, double scale = 1) {
  const std::vector<double>& values = figures.at(figure);
  const Spread s = spread_of(values);
  if (s.count == 0) return "-";
  const auto text = [&](double value) { return fmt::format("{:.{}f}", scale * value, digits); };
  std::string more;
  if (text(s.minimum) != text(s.maximum)) more = text(s.minimum) + ".." + text(s.maximum);
  if (s.count < static_cast<int>(values.size()))
    more += fmt::format("{}{} of {}", more.empty() ? "" : "; ", s.count, values.size());
  return text(s.median) + (more.empty() ? "" : " (" + more + ")");
}

using Cells = std::vector<std::string>;

std::string markdown(const std::vector<Cells>& rows) {
  std::vector<std::size_t> widths(rows.at(0).size(), 3);
  for (const Cells& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  std::string text;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t i = 0; i < widths.size(); ++i) text += fmt::format("| {:<{}} ", rows[r][i], widths[i]);
    text += "|\n";
    if (r > 0) continue;
    for (const std::size_t width : widths) text += "|" + std::string(width + 2, '-');
    text += "|\n";
  }
  return text;
}

/// Returns what the agent gained over sequence_filter, which learns nothing: the differences of all figures, run by
/// run.
std::vector<RunGroup::Row> gains(const RunGroup& group) {
  std::vector<RunGroup::Row> rows;
  for (const RunGroup::Row& own : group.rows) {
    if (own.policy != group.agent || group.agent == kUnlearned) continue;
    const auto filter = std::find_if(group.rows.begin(), group.rows.end(), [&own](const RunGroup::Row& row) {
      return row.policy == kUnlearned && row.traversal == own.traversal;
    });
    if (filter == group.rows.end() || filter->figures.at("spl").size() != own.figures.at("spl").size()) continue;
    RunGroup::Row& row = rows.emplace_back(RunGroup::Row{"gained by learning", own.traversal, own.figures});
    for (auto& [figure, values] : row.figures)
      for (std::size_t run = 0; run < values.size(); ++run) values[run] -= filter->figures.at(figure)[run];
  }
  return rows;
}

}  // namespace

RunGroup read_summary(const std::string& path) { return read_group(path, false); }

RunGroup join(const std::vector<RunGroup>& runs) {
  RunGroup joined = runs.at(0);
  for (auto run = runs.begin() + 1; run != runs.end(); ++run) {
    joined.seeds.insert(joined.seeds.end(), run->seeds.begin(), run->seeds.end());
    append(joined.training, run->training);
    for (const RunGroup::Row& row : run->rows) {
      const auto like = std::find_if(joined.rows.begin(), joined.rows.end(), [&row](const RunGroup::Row& other) {
        return other.policy == row.policy && other.traversal == row.traversal;
      });
      if (like == joined.rows.end())
        joined.rows.push_back(row);
      else
        append(like->figures, row.figures);
    }
  }
  return joined;
}

std::string sweep_json(const RunGroup& group, const std::map<std::uint64_t, std::string>& failed) {
  Json sweep = {{"agent", group.agent},
                {"learner", group.learner},
                {"middleware", group.middleware},
                {"traversal", group.traversal},
                {"seeds", group.seeds},
                {"failed", Json::array()},
                {"train", figures_json(group.training, kTrainingFigures)},
                {"evaluate", Json::object()},
                {"controls", Json::object()}};
  for (const auto& [seed, why] : failed) sweep["failed"].push_back({{"seed", seed}, {"error", why}});
  for (const RunGroup::Row& row : group.rows) {
    Json& place = row.policy == group.agent ? sweep["evaluate"] : sweep["controls"][row.policy];
    place[row.traversal] = figures_json(row.figures, kScoreFigures);
  }
  return sweep.dump(2) + "\n";
}

namespace {

RunGroup read_run(const std::string& run) {
  const fs::path path = fs::path(run).lexically_normal();
  const fs::path folder = fs::is_directory(path) ? path : path.parent_path();
  RunGroup group;
  if (fs::exists(folder / "sweep.json") && path.filename() != "summary.json")
    group = read_group((folder / "sweep.json").string(), true);
  else if (fs::exists(folder / "summary.json") && path.filename() != "sweep.json")
    group = read_group((folder / "summary.json").string(), false);
  else
    throw Error("holds neither sweep.json nor summary.json", run, "has the run ended?");
  // "runs/today/" has no last name, its parent has.
  group.name = folder.has_filename() ? folder.filename().string() : folder.parent_path().filename().string();
  return group;
}

}  // namespace

Spread spread_of(std::vector<double> values) {
  std::erase_if(values, [](double value) { return !std::isfinite(value); });
  Spread s;
  s.count = static_cast<int>(values.size());
  if (values.empty()) return s;
  std::sort(values.begin(), values.end());
  const std::size_t count = values.size();
  const double n = static_cast<double>(count);
  s.minimum = values.front();
  s.maximum = values.back();
  s.median = (values[(count - 1) / 2] + values[count / 2]) / 2;
  s.mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0;
  for (const double value : values) squares += (value - s.mean) * (value - s.mean);
  if (count > 1) s.deviation = std::sqrt(squares / (n - 1));
  return s;
}

std::string gain_sentence(const std::vector<double>& gains) {
  const Spread s = spread_of(gains);
  const auto text = [](double value) { return fmt::format("{:.3f}", std::round(1000 * value) / 1000 + 0.0); };  // no -0
  return fmt::format("Learning gained {} SPL{} over the untrained sequence_filter.", text(s.median),
                     s.count > 1 ? fmt::format(" ({} to {})", text(s.minimum), text(s.maximum)) : "");
}

std::string gain_sentence(const RunGroup& group) {
  std::vector<double> sums(group.seeds.size());
  int traversals = 0;
  for (const RunGroup::Row& row : gains(group)) {
    const std::vector<double>& values = row.figures.at("spl");
    if (values.size() != sums.size() ||
        (" " + group.traversal + ",").find(" " + row.traversal + ",") != std::string::npos)
      continue;
    ++traversals;
    for (std::size_t run = 0; run < sums.size(); ++run) sums[run] += values[run];
  }
  if (traversals == 0) return "";
  for (double& sum : sums) sum /= traversals;
  return gain_sentence(sums) + "\n";
}

std::string tables(const std::vector<RunGroup>& groups) {
  std::vector<Cells> scores = {
      {"run", "policy", "learner", "traversal", "runs", "completed %", "SPL", "mean steps", "reward"}};
  std::vector<Cells> training = {{"run", "agent", "learner", "seeds", "steps", "episodes", "episodes to SPL .95",
                                  "s to SPL .95", "training s", "steps/s"}};
  std::set<Cells> known;  // the controls walk the same tasks in each run of the same seeds: once is enough
  for (const RunGroup& group : groups) {
    std::vector<RunGroup::Row> rows = gains(group);
    rows.insert(rows.begin(), group.rows.begin(), group.rows.end());
    for (const RunGroup::Row& row : rows) {
      const bool agent = row.policy == group.agent;
      Cells cells = {row.policy == "shuffled" ? group.agent + ", shuffled" : row.policy,
                     agent && !group.learner.empty() ? group.learner : "-",
                     row.traversal,
                     std::to_string(row.figures.at("spl").size()),
                     cell(row.figures, "completed", 1, 100),
                     cell(row.figures, "spl", 3),
                     cell(row.figures, "mean_steps", 1),
                     cell(row.figures, "reward", 3)};
      if (!agent && !known.insert(cells).second) continue;
      cells.insert(cells.begin(), group.name);
      scores.push_back(std::move(cells));
    }
    if (group.training.empty()) continue;
    std::string seeds;
    for (const std::uint64_t seed : group.seeds) seeds += (seeds.empty() ? "" : ",") + std::to_string(seed);
    training.push_back({group.name, group.agent, group.learner, seeds, cell(group.training, "steps", 0),
                        cell(group.training, "episodes", 0), cell(group.training, "episodes_to_spl95", 0),
                        cell(group.training, "wall_s_to_spl95", 1), cell(group.training, "wall_s", 1),
                        cell(group.training, "steps_per_s", 0)});
  }
  if (groups.size() == 1)
    for (std::vector<Cells>* rows : {&scores, &training})
      for (Cells& cells : *rows) cells.erase(cells.begin());
  return markdown(scores) + (training.size() > 1 ? "\n" + markdown(training) : "");
}

std::string tables_of(const std::vector<std::string>& runs) {
  std::vector<RunGroup> groups;
  for (const std::string& run : runs) groups.push_back(read_run(run));
  if (groups.empty()) throw Error("needs folders with summary.json or sweep.json", "--mode table");
  return tables(groups);
}

}  // namespace citylearn
