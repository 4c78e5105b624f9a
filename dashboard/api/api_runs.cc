// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <type_traits>

#include "core/files/json.h"
#include "core/task/path.h"
#include "core/task/spl.h"
#include "core/util/random.h"
#include "core/util/text.h"
#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"
#include "dashboard/live/json.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxCachedFigures = 10000;
constexpr int kResamples = 1000;
constexpr std::uint64_t kBootstrapStream = 0x626F6F74;  // names the random numbers

double shortest(double value) {
  if (!std::isfinite(value)) return value;
  std::string text;
  append_number(text, static_cast<float>(value));
  return std::strtod(text.c_str(), nullptr);
}

Json number_or_null(double value) { return std::isfinite(value) ? Json(shortest(value)) : Json(nullptr); }

/// Returns the frames stood at, the start's first, from the actions of EpisodeStat.path. Null where these are not
/// known, or the streets are not, on which `map` says where they lead.
Json positions_of(const StoreReader::Replay& replay, const RouteMap* map) {
  if (!replay.path || replay.path->size() < path_octets(replay.row.steps)) return nullptr;
  const bool line = replay.rule == StateRule::kLine;
  if (!line && (!map || !map->streets || replay.row.start >= map->frames)) return nullptr;
  constexpr int kEndless = 1 << 30;  // a line whose end the actions know
  const StateMap states = line ? StateMap(kEndless) : StateMap(*map->streets, map->rule, map->frames);
  Json positions = Json::array();
  auto frame = static_cast<int>(replay.row.start);
  positions.push_back(frame);
  for (std::uint64_t step = 0; step < replay.row.steps; ++step)
    positions.push_back(frame = states.after(frame, static_cast<std::uint8_t>(action_at(*replay.path, step)), 1));
  return positions;
}

// Tables are written by hand: a run may have a million rows.

/// Appends a float, or null where there is none.
void append_float(std::string& text, double value) {
  if (std::isfinite(value))
    append_number(text, static_cast<float>(value));
  else
    text += "null";
}

/// Appends a training figure; null where it is undefined.
void append_figure(std::string& text, const TrainingFigure& figure, double value) {
  if (std::isfinite(value) && figure.type == TrainingFigure::kCount)
    append_number(text, static_cast<std::int64_t>(value));
  else if (std::isfinite(value) && figure.type == TrainingFigure::kDouble)
    append_number(text, value);
  else
    append_float(text, value);
}

/// Appends the fields of an episode as a JSON object without its last brace.
struct EpisodeFields {
  std::string& text;
  bool first = true;
  template <class Value>
  void operator()(const char* name, const char*, const Value& value) {
    text += std::string(first ? "{\"" : ",\"") + name + "\":";
    first = false;
    if constexpr (std::is_same_v<Value, std::string>)
      text += text_of(value);
    else if constexpr (std::is_same_v<Value, bool>)
      text += value ? "true" : "false";
    else if constexpr (std::is_same_v<Value, float>)
      append_float(text, value);
    else
      append_number(text, value);
  }
};

/// Returns the figures of one policy on the tasks of one traversal, of which there is one or more: means over tasks;
/// fractions are 0..1. Of failed tasks all steps count; excess is that of completed ones. The interval of SPL is one of
/// 95 %, the same for the same tasks.
Json figures_of(const std::vector<StoreReader::TaskRow>& tasks) {
  const double count = static_cast<double>(tasks.size());
  double completed = 0, mean_steps = 0, shortest_mean = 0, reward = 0, spl = 0, excess = 0;
  for (const StoreReader::TaskRow& task : tasks) {
    mean_steps += static_cast<double>(task.steps) / count;
    shortest_mean += static_cast<double>(task.shortest) / count;
    reward += task.reward / count;
    spl += task.spl / count;
    if (!task.completed) continue;
    ++completed;
    excess += excess_of(static_cast<double>(task.shortest), static_cast<double>(task.steps));
  }
  // Percentile bootstrap: Efron & Tibshirani, An Introduction to the Bootstrap (1993), chapter 13.
  Random random{kBootstrapStream, tasks.size()};
  std::vector<double> means(kResamples);
  for (double& mean : means) {
    double sum = 0;
    for (std::size_t i = 0; i < tasks.size(); ++i) sum += tasks[random.below(tasks.size())].spl;
    mean = sum / count;
  }
  std::sort(means.begin(), means.end());
  return {{"tasks", tasks.size()},
          {"completed", completed / count},
          {"failed", (count - completed) / count},
          {"spl", spl},
          {"spl_low", means[kResamples * 25 / 1000]},
          {"spl_high", means[kResamples * 975 / 1000 - 1]},
          {"reward", reward},
          {"mean_steps", mean_steps},
          {"shortest_mean", shortest_mean},
          {"excess", completed > 0 ? Json(excess / completed) : Json(nullptr)}};
}

}  // namespace

Json Api::run_json(const RunRow& row) {
  const Store::Liveness liveness = store_.liveness(row.id);
  const double last = std::max(row.last, liveness.last);
  bool heard = seconds_since_epoch() - last < options_.silence;
  if (options_.replays && live_ && row.policy) heard = live_->alive(row.session, *row.policy).value_or(heard);
  const char* state = row.ended ? "ended" : heard ? "running" : row.policy ? "lost" : "ended";
  Json json = {{"id", row.name},
               {"session", row.session},
               {"policy", row.policy ? Json(*row.policy) : Json(nullptr)},
               {"seed", row.seed ? Json(*row.seed) : Json(nullptr)},
               {"agent", row.agent.empty() ? Json(nullptr) : Json(row.agent)},
               {"learner", row.learner.empty() ? Json(nullptr) : Json(row.learner)},
               {"state", state},
               {"started", row.started},
               {"last", last},
               {"updates", std::max(row.updates, liveness.updates)},
               {"recorded_episodes", row.recorded}};
  const char* const names[] = {"steps", "episodes", "reward", "spl", "wall", "steps_per_second"};
  for (const char* name : names) json[name] = nullptr;
  if (row.newest) {
    json["updates"] = std::max({row.updates, liveness.updates, row.newest->update});
    json["steps"] = row.newest->steps;
    json["episodes"] = row.newest->episodes;
    json["reward"] = number_or_null(row.newest->reward);
    json["spl"] = number_or_null(row.newest->spl);
    json["wall"] = row.newest->wall;
    json["steps_per_second"] = number_or_null(row.newest->steps_per_second);
  }
  return json;
}

Json Api::runs() {
  Json list = Json::array();
  BorrowedReader reader(*this);
  for (const RunRow& row : reader->runs())
    // A row of unclaimed episodes that a run has claimed since is empty.
    if (row.policy || row.recorded > 0) list.push_back(run_json(row));
  return {{"runs", std::move(list)}};
}

Answer Api::answer_run(const Query& query) {
  const std::string& name = query.path[1];
  if (query.method == "DELETE") {
    allow_only(query, {});
    return remove(name);
  }
  std::optional<RunRow> row;
  {
    BorrowedReader reader(*this);
    row = reader->run(name);
  }
  if (!row) not_found("run '" + name + "' not found (GET /api/runs lists them)");
  const std::string part = query.path.size() == 3 ? query.path[2] : "";
  if (part == "training") return training(*row, query);
  if (part == "episodes") return episodes(*row, query);
  allow_only(query, {});
  if (part.empty()) return run(*row);
  if (part == "evaluations") return evaluations(*row);
  not_found("a run has no '" + part + "' (training, episodes, evaluations)");
}

Answer Api::run(const RunRow& row) {
  Json json = run_json(row);
  BorrowedReader reader(*this);
  const Json manifest = parse_json_or_null(reader->manifest(row.id));
  json["manifest"] = manifest.is_object() ? manifest : Json(nullptr);
  json["traversals"] = Json::array();
  for (const TraversalRow& traversal : reader->traversals(row.id))
    json["traversals"].push_back(traversal_json(traversal));
  if (!live_ || json["state"] != "running") return json_answer(json);
  // Those it has no episodes on yet: the siblings that it will be evaluated on.
  for (Json& hosted : live_->traversals(row.session)) {
    const auto same = [&](const Json& one) { return one["environment"] == hosted["environment"]; };
    if (std::none_of(json["traversals"].begin(), json["traversals"].end(), same))
      json["traversals"].push_back(std::move(hosted));
  }
  return json_answer(json);
}

Answer Api::remove(const std::string& name) {
  switch (store_.remove(name)) {
    case Store::Removal::kUnknown:
      not_found("run '" + name + "' not found (GET /api/runs lists them)");
    case Store::Removal::kRunning:
      throw RequestError(409, "run '" + name + "' is running: end it first");
    case Store::Removal::kDone:
      break;
  }
  Answer answer;
  answer.status = 204;
  return answer;
}

Answer Api::training(const RunRow& row, const Query& query) {
  allow_only(query, {"columns", "points", "x", "from", "to"});
  static const std::map<std::string, const char*> kOrders = {
      {"updates", "update"}, {"episodes", "episodes"}, {"steps", "steps"}, {"wall", "wall"}};
  const std::string x = text_parameter(query, "x").value_or("updates");
  const auto order = kOrders.find(x);
  if (order == kOrders.end())
    throw RequestError(400, "parameter 'x' must be updates, episodes, steps or wall, is '" + x + "'");
  StoreReader::TrainingQuery wanted;
  wanted.run = row.id;
  wanted.x = find_training_figure(order->second);
  const std::string columns = text_parameter(query, "columns").value_or("reward,spl");
  for (std::size_t begin = 0; begin <= columns.size();) {
    const std::size_t end = std::min(columns.find(',', begin), columns.size());
    const std::string name = columns.substr(begin, end - begin);
    begin = end + 1;
    const TrainingFigure* column = find_training_figure(name);
    if (!column)
      throw RequestError(400, "parameter 'columns' names '" + name + "', which is none of " +
                                  joined(training_figures(), &TrainingFigure::name));
    if (std::find(wanted.columns.begin(), wanted.columns.end(), column) != wanted.columns.end())
      throw RequestError(400, "parameter 'columns' names '" + name + "' twice");
    wanted.columns.push_back(column);
  }
  constexpr double kMaxValue = 1e18;
  wanted.from = number_parameter<double>(query, "from", -kMaxValue, kMaxValue);
  wanted.to = number_parameter<double>(query, "to", -kMaxValue, kMaxValue);
  const int points = number_parameter<int>(query, "points", 10, 20000).value_or(2000);
  BorrowedReader reader(*this);
  const Decimator rows = reader->training(wanted, static_cast<std::size_t>(points));
  Answer answer;
  std::string& text = answer.body;
  text = "{\"id\":" + text_of(row.name) + ",\"x\":\"" + x + "\",\"total\":";
  append_number(text, rows.total());
  text += std::string(",\"decimated\":") + (rows.decimated() ? "true" : "false") + ",\"columns\":{";
  const std::size_t width = wanted.columns.size() + 1;
  for (std::size_t i = 0; i < width; ++i) {
    const TrainingFigure& column = i == 0 ? *wanted.x : *wanted.columns[i - 1];
    text += (i == 0 ? "\"" : ",\"") + std::string(i == 0 ? "x" : column.name) + "\":[";
    for (std::size_t at = 0; at < rows.rows(); ++at) {
      if (at > 0) text += ',';
      append_figure(text, column, rows.values()[at * width + i]);
    }
    text += ']';
  }
  text += "}}";
  return answer;
}

Answer Api::episodes(const RunRow& row, const Query& query) {
  allow_only(query,
             {"limit", "before", "evaluation", "traversal", "policy", "update", "shuffled", "completed", "order"});
  constexpr std::int64_t kMaxValue = std::numeric_limits<std::int64_t>::max();
  EpisodeFilter filter;
  filter.evaluation = flag_parameter(query, "evaluation");
  filter.completed = flag_parameter(query, "completed");
  filter.shuffled = flag_parameter(query, "shuffled");
  filter.traversal = text_parameter(query, "traversal");
  filter.policy = text_parameter(query, "policy");
  if (const auto update = number_parameter<std::int64_t>(query, "update", 0, kMaxValue))
    filter.update = static_cast<std::uint64_t>(*update);
  const auto before = number_parameter<std::int64_t>(query, "before", 0, kMaxValue);
  const int limit = number_parameter<int>(query, "limit", 1, 10000).value_or(100);
  const std::string order = text_parameter(query, "order").value_or("newest");
  if (order != "newest" && order != "worst")
    throw RequestError(400, "parameter 'order' must be newest or worst, is '" + order + "'");
  if (before && order == "worst") throw RequestError(400, "parameter 'before' goes with order=newest only");
  BorrowedReader reader(*this);
  const bool all = query.parameters.empty();
  const std::uint64_t total = all ? row.recorded : reader->count(row.id, filter);
  filter.before = before;
  Answer answer;
  answer.body = "{\"total\":" + std::to_string(total) + ",\"episodes\":[";
  bool first = true;
  for (const EpisodeRow& one : reader->episodes(row.id, filter, order == "worst", static_cast<std::size_t>(limit))) {
    if (!first) answer.body += ',';
    first = false;
    visit_episode(one, EpisodeFields{answer.body});
    answer.body += '}';
  }
  answer.body += "]}";
  return answer;
}

Answer Api::evaluations(const RunRow& row) {
  Json list = Json::array();
  BorrowedReader reader(*this);
  for (const StoreReader::EvaluationGroup& group : reader->evaluations(row.id)) {
    const std::pair key(row.id, group.key);
    Json figures;
    {
      std::lock_guard lock(mutex_);
      const auto found = evaluations_.find(key);
      if (found != evaluations_.end() && found->second.episodes == group.episodes &&
          found->second.newest == group.newest)
        figures = found->second.figures;
    }
    if (figures.is_null()) {
      figures = figures_of(reader->tasks(row.id, group.key));
      figures.update({{"policy", group.key.policy},
                      {"update", group.key.update},
                      {"shuffled", group.key.shuffled},
                      {"traversal", group.key.traversal}});
      std::lock_guard lock(mutex_);
      if (evaluations_.size() >= kMaxCachedFigures) evaluations_.clear();
      evaluations_[key] = {group.episodes, group.newest, figures};
    }
    list.push_back(std::move(figures));
  }
  return json_answer({{"evaluations", std::move(list)}});
}

Answer Api::episode(const Query& query) {
  allow_only(query, {});
  const auto rowid = parsed<std::int64_t>(query.path[1]);
  if (!rowid) throw RequestError(400, "an episode is named by its rowid, a number; '" + query.path[1] + "' is none");
  BorrowedReader reader(*this);
  const auto replay = reader->episode(*rowid);
  if (!replay) not_found("episode " + query.path[1] + " not found");
  Answer answer;
  visit_episode(replay->row, EpisodeFields{answer.body});
  const bool streets = replay->hash && replay->rule != StateRule::kLine;
  const std::optional<RouteMap> stored = streets ? reader->map(*replay->hash) : std::nullopt;
  const LiveView::Map hosted = streets && !stored && live_ ? live_->map(*replay->hash) : LiveView::Map();
  answer.body += ",\"positions\":" + positions_of(*replay, stored ? &*stored : hosted.map.get()).dump() +
                 ",\"hash\":" + (replay->hash ? "\"" + hash_text(*replay->hash) + "\"" : std::string("null")) + "}";
  return answer;
}

}  // namespace citylearn
