// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/api.h"

#include <sys/stat.h>

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <initializer_list>

#include "core/task/path.h"
#include "core/wire/service.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kReadersKept = 16;
constexpr std::size_t kFiguresKept = 10000;

/// What is wrong with a request. Its text goes to whoever sent it.
class Refusal : public std::exception {
 public:
  Refusal(int status, std::string what) : answer(error_answer(status, what)) {}
  const char* what() const noexcept override { return answer.body.c_str(); }
  Answer answer;
};

[[noreturn]] void not_found(const std::string& what) { throw Refusal(404, what); }

/// Names and texts of services may be no UTF-8.
std::string text_of(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

Answer json_answer(const Json& json) {
  Answer answer;
  answer.body = text_of(json);
  return answer;
}

/// The shortest number that is this float: 0.9, not 0.899999976.
template <class Number>
void append(std::string& text, Number value) {
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
  text.append(digits, static_cast<std::size_t>(end - digits));
}

double shortest(double value) {
  if (!std::isfinite(value)) return value;
  std::string text;
  append(text, static_cast<float>(value));
  return std::strtod(text.c_str(), nullptr);
}

Json number_or_null(double value) { return std::isfinite(value) ? Json(shortest(value)) : Json(nullptr); }

std::string hash_text(std::uint64_t hash) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text(16, '0');
  for (int i = 15; i >= 0; --i, hash >>= 4) text[static_cast<std::size_t>(i)] = kDigits[hash & 15];
  return text;
}

// Parameters.

void only(const Query& query, std::initializer_list<const char*> known) {
  for (const auto& [name, value] : query.parameters) {
    bool found = false;
    std::string names;
    for (const char* one : known) {
      found = found || name == one;
      names += (names.empty() ? "" : ", ") + std::string(one);
    }
    if (!found)
      throw Refusal(400,
                    "parameter '" + name + "' is not known here (" + (names.empty() ? "there are none" : names) + ")");
  }
}

template <class Number>
std::optional<Number> parsed(const std::string& text) {
  Number number{};
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (fault != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return number;
}

std::optional<std::string> given(const Query& query, const char* name) {
  const auto found = query.parameters.find(name);
  return found == query.parameters.end() ? std::nullopt : std::optional(found->second);
}

template <class Number>
std::optional<Number> number(const Query& query, const char* name, Number least, Number most) {
  const auto text = given(query, name);
  if (!text) return std::nullopt;
  const auto value = parsed<Number>(*text);
  if (!value || !(*value >= least && *value <= most)) {
    std::string range;
    append(range, least);
    range += "..";
    append(range, most);
    throw Refusal(400, "parameter '" + std::string(name) + "' must be a number " + range + ", is '" + *text + "'");
  }
  return value;
}

std::optional<bool> flag(const Query& query, const char* name) {
  const auto text = given(query, name);
  if (text && *text != "0" && *text != "1")
    throw Refusal(400, "parameter '" + std::string(name) + "' must be 0 or 1, is '" + *text + "'");
  return text ? std::optional(*text == "1") : std::nullopt;
}

std::uint64_t hash_of(const std::string& text) {
  std::uint64_t hash = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), hash, 16);
  if (text.size() != 16 || fault != std::errc() || end != text.data() + text.size() ||
      text.find_first_of("ABCDEF") != text.npos)
    throw Refusal(400, "a hash has 16 hexadecimal digits, '" + text + "' has not");
  return hash;
}

// Texts of whole tables, put together by hand: a run may have a million rows.

void append_json(std::string& text, const std::string& value) { text += text_of(Json(value)); }

void append_csv(std::string& text, const std::string& value) {
  if (value.find_first_of(",\"\r\n") == value.npos) {
    text += value;
    return;
  }
  text += '"';
  for (const char c : value) text += c == '"' ? "\"\"" : std::string(1, c);
  text += '"';
}

/// A float; nothing (CSV) or null (JSON) where there is none.
void append_float(std::string& text, double value, bool csv) {
  if (std::isfinite(value)) {
    append(text, static_cast<float>(value));
  } else if (!csv) {
    text += "null";
  }
}

void append_training(std::string& text, const TrainingColumn& column, double value, bool csv) {
  if (std::isfinite(value) && column.whole) {
    append(text, static_cast<std::int64_t>(value));
  } else if (std::isfinite(value) && column.name == std::string_view("wall")) {
    append(text, value);
  } else {
    append_float(text, value, csv);
  }
}

/// Fields of EPISODE, each handed to `field(name, value)` in the document's order.
template <class Field>
void visit(const EpisodeRow& e, Field field) {
  field("rowid", e.rowid);
  field("environment", e.environment);
  field("incarnation", e.incarnation);
  field("episode", e.episode);
  field("agent", e.agent);
  field("evaluation", e.evaluation);
  field("task", e.task);
  field("traversal", e.traversal);
  field("policy", e.policy);
  field("update", e.update);
  field("shuffled", e.shuffled);
  field("start", e.start);
  field("goal", e.goal);
  field("steps", e.steps);
  field("shortest", e.shortest);
  field("reward", static_cast<float>(e.reward));
  field("completed", e.completed);
  field("spl", static_cast<float>(e.spl));
  field("recorded", e.recorded);
}

struct JsonFields {
  std::string& text;
  bool first = true;
  template <class Value>
  void operator()(const char* name, const Value& value) {
    text += first ? "{\"" : ",\"";
    first = false;
    text += name;
    text += "\":";
    if constexpr (std::is_same_v<Value, std::string>) {
      append_json(text, value);
    } else if constexpr (std::is_same_v<Value, bool>) {
      text += value ? "true" : "false";
    } else if constexpr (std::is_same_v<Value, float>) {
      append_float(text, value, false);
    } else {
      append(text, value);
    }
  }
};

struct CsvFields {
  std::string& text;
  bool first = true;
  template <class Value>
  void operator()(const char*, const Value& value) {
    if (!first) text += ',';
    first = false;
    if constexpr (std::is_same_v<Value, std::string>) {
      append_csv(text, value);
    } else if constexpr (std::is_same_v<Value, bool>) {
      text += value ? '1' : '0';
    } else if constexpr (std::is_same_v<Value, float>) {
      append_float(text, value, true);
    } else {
      append(text, value);
    }
  }
};

void append_episode(std::string& text, const EpisodeRow& row) {
  visit(row, JsonFields{text});
  text += '}';
}

/// An answer to be kept as a file.
Answer file_answer(const std::string& run, const std::string& what, bool csv) {
  Answer answer;
  answer.type = csv ? "text/csv; charset=utf-8" : "application/json";
  std::string name;
  for (const char c : run + "-" + what) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '.';
    name += plain ? c : '-';
  }
  if (csv) answer.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + name + "\"");
  return answer;
}

/// Frames stood at, the start's first: the actions of EpisodeStat.path one after the other.
Json positions_of(const StoreReader::Replay& replay) {
  if (!replay.path || replay.path->size() < path_octets(replay.row.steps)) return nullptr;
  Json positions = Json::array();
  auto frame = static_cast<std::int64_t>(replay.row.start);
  positions.push_back(frame);
  for (std::uint64_t step = 0; step < replay.row.steps; ++step) {
    const int action = action_at(*replay.path, step);
    frame += action == kNext ? 1 : action == kPrevious ? -1 : 0;
    positions.push_back(frame);
  }
  return positions;
}

std::uint64_t bytes_of(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
}

Answer coming() {
  Answer answer = error_answer(503, "is being fetched: ask again in a second");
  answer.headers.emplace_back("Retry-After", "1");
  return answer;
}

Json control_json(const ControlFigures& figures) {
  return {{"spl", figures.spl}, {"reward", figures.reward}, {"steps", figures.steps}, {"completed", figures.completed}};
}

}  // namespace

Api::Lent::Lent(Api& api) : api_(api), unwinding_(std::uncaught_exceptions()) {
  {
    std::lock_guard lock(api_.mutex_);
    if (!api_.readers_.empty()) {
      reader_ = std::move(api_.readers_.back());
      api_.readers_.pop_back();
    }
  }
  if (!reader_) reader_ = std::make_unique<StoreReader>(api_.store_.path());
}

Api::Lent::~Lent() {
  // One that failed may stand in the middle of its rows.
  if (std::uncaught_exceptions() > unwinding_) return;
  std::lock_guard lock(api_.mutex_);
  if (api_.readers_.size() < kReadersKept) api_.readers_.push_back(std::move(reader_));
}

Api::Api(const Options& options, Store& store, LiveView* live)
    : options_(options), store_(store), live_(live), recognition_(options.recognition) {}
Api::~Api() = default;

Answer Api::answer(const Query& query) {
  try {
    const std::string first = query.path.empty() ? "" : query.path[0];
    const std::size_t depth = query.path.size();
    const bool removes = query.method == "DELETE" && first == "runs" && depth == 2;
    if (query.method != "GET" && !removes) {
      Answer answer = error_answer(405, "method " + query.method + " is not possible here");
      answer.headers.emplace_back("Allow", first == "runs" && depth == 2 ? "GET, DELETE" : "GET");
      return answer;
    }
    if (first == "runs" && depth == 1) {
      only(query, {});
      return json_answer(runs());
    }
    if (first == "runs" && (depth == 2 || depth == 3)) return of_run(query);
    if (first == "episodes" && depth == 2) return episode(query);
    if (first == "controls" && depth == 1) return controls(query);
    if (first == "services" && depth == 1) return services();
    if (first == "events" && depth == 1) return events(query);
    if (first == "map" && depth == 2) return map(query);
    if (first == "frames" && depth == 3) return frame(query);
    if (first == "recognition" && (depth == 1 || depth == 3)) return recognition(query);
    if (first == "about" && depth == 1) return about();
    not_found("there is nothing of this name (docs/reference/dashboard-api.md lists what there is)");
  } catch (Refusal& refusal) {
    return std::move(refusal.answer);
  } catch (const Error& error) {
    return error_answer(503, error.what());
  }
}

Json Api::run_json(const RunRow& row) {
  const Store::Pulse pulse = store_.pulse(row.id);
  const double last = std::max(row.last, pulse.last);
  const bool heard = now_seconds() - last < options_.silence;
  const char* state = row.ended ? "ended" : heard ? "running" : row.policy ? "lost" : "ended";
  Json json = {{"id", row.name},
               {"run", row.run},
               {"policy", row.policy ? Json(*row.policy) : Json(nullptr)},
               {"seed", row.seed ? Json(*row.seed) : Json(nullptr)},
               {"agent", row.agent.empty() ? Json(nullptr) : Json(row.agent)},
               {"learner", row.learner.empty() ? Json(nullptr) : Json(row.learner)},
               {"state", state},
               {"started", row.started},
               {"last", last},
               {"updates", std::max(row.updates, pulse.updates)},
               {"recorded_episodes", row.recorded}};
  const char* const names[] = {"steps", "episodes", "reward", "spl", "wall", "steps_per_second"};
  for (const char* name : names) json[name] = nullptr;
  if (row.newest) {
    json["updates"] = std::max({row.updates, pulse.updates, row.newest->update});
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
  Lent reader(*this);
  for (const RunRow& row : reader->runs())
    // Nobody's episodes are claimed when their run is heard of: what is left of it then is nothing.
    if (row.policy || row.recorded > 0) list.push_back(run_json(row));
  return {{"runs", std::move(list)}};
}

Answer Api::of_run(const Query& query) {
  const std::string& name = query.path[1];
  if (query.method == "DELETE") {
    only(query, {});
    return remove(name);
  }
  std::optional<RunRow> row;
  {
    Lent reader(*this);
    row = reader->run(name);
  }
  if (!row) not_found("there is no run '" + name + "' (GET /api/runs lists them)");
  const std::string part = query.path.size() == 3 ? query.path[2] : "";
  if (part == "training") return training(*row, query);
  if (part == "episodes") return episodes(*row, query);
  only(query, {});
  if (part.empty()) return run(*row);
  if (part == "training.csv" || part == "training.json") return all_training(*row, part == "training.csv");
  if (part == "episodes.csv" || part == "episodes.json") return all_episodes(*row, part == "episodes.csv");
  if (part == "evaluations") return evaluations(*row);
  not_found("a run has no '" + part +
            "' (training, training.csv, training.json, episodes, episodes.csv, episodes.json, "
            "evaluations)");
}

Answer Api::run(const RunRow& row) {
  Json json = run_json(row);
  Lent reader(*this);
  const Json manifest = Json::parse(reader->manifest(row.id), nullptr, false);
  json["manifest"] = manifest.is_object() ? manifest : Json(nullptr);
  json["traversals"] = Json::array();
  for (const TraversalRow& traversal : reader->traversals(row.id))
    json["traversals"].push_back({{"environment", traversal.environment},
                                  {"dataset", traversal.dataset},
                                  {"traversal", traversal.traversal},
                                  {"condition", traversal.condition},
                                  {"hash", hash_text(traversal.hash)},
                                  {"frames", traversal.frames},
                                  {"agents", traversal.agents},
                                  {"images", traversal.images}});
  if (!live_ || json["state"] != "running") return json_answer(json);
  // Those it has not been on yet: the siblings that it will be evaluated on.
  for (Json& hosted : live_->traversals(row.run)) {
    const auto same = [&](const Json& one) { return one["environment"] == hosted["environment"]; };
    if (std::none_of(json["traversals"].begin(), json["traversals"].end(), same))
      json["traversals"].push_back(std::move(hosted));
  }
  return json_answer(json);
}

Answer Api::remove(const std::string& name) {
  switch (store_.remove(name)) {
    case Store::Removal::kUnknown:
      not_found("there is no run '" + name + "' (GET /api/runs lists them)");
    case Store::Removal::kRunning:
      throw Refusal(409, "run '" + name + "' is running: end it first");
    case Store::Removal::kDone:
      break;
  }
  Answer answer;
  answer.status = 204;
  return answer;
}

Answer Api::training(const RunRow& row, const Query& query) {
  only(query, {"columns", "points", "x", "from", "to"});
  static const std::map<std::string, const char*> kOrders = {
      {"updates", "update"}, {"episodes", "episodes"}, {"steps", "steps"}, {"wall", "wall"}};
  const std::string x = given(query, "x").value_or("updates");
  const auto order = kOrders.find(x);
  if (order == kOrders.end())
    throw Refusal(400, "parameter 'x' must be updates, episodes, steps or wall, is '" + x + "'");
  StoreReader::TrainingQuery wanted;
  wanted.run = row.id;
  wanted.x = find_training_column(order->second);
  const std::string columns = given(query, "columns").value_or("reward,spl");
  for (std::size_t begin = 0; begin <= columns.size();) {
    const std::size_t end = std::min(columns.find(',', begin), columns.size());
    const std::string name = columns.substr(begin, end - begin);
    begin = end + 1;
    const TrainingColumn* column = find_training_column(name);
    if (!column) {
      std::string names;
      for (const TrainingColumn& one : training_columns()) names += (names.empty() ? "" : ", ") + std::string(one.name);
      throw Refusal(400, "parameter 'columns' names '" + name + "', which is none of " + names);
    }
    if (std::find(wanted.columns.begin(), wanted.columns.end(), column) != wanted.columns.end())
      throw Refusal(400, "parameter 'columns' names '" + name + "' twice");
    wanted.columns.push_back(column);
  }
  constexpr double kMost = 1e18;
  wanted.from = number<double>(query, "from", -kMost, kMost);
  wanted.to = number<double>(query, "to", -kMost, kMost);
  const int points = number<int>(query, "points", 10, 20000).value_or(2000);
  Lent reader(*this);
  const Decimator rows = reader->training(wanted, static_cast<std::size_t>(points));
  Answer answer;
  std::string& text = answer.body;
  text = "{\"id\":";
  append_json(text, row.name);
  text += ",\"x\":\"" + x + "\",\"total\":";
  append(text, rows.total());
  text += std::string(",\"decimated\":") + (rows.decimated() ? "true" : "false") + ",\"columns\":{";
  const std::size_t width = wanted.columns.size() + 1;
  for (std::size_t i = 0; i < width; ++i) {
    const TrainingColumn& column = i == 0 ? *wanted.x : *wanted.columns[i - 1];
    text += (i == 0 ? "\"" : ",\"") + std::string(i == 0 ? "x" : column.name) + "\":[";
    for (std::size_t at = 0; at < rows.rows(); ++at) {
      if (at > 0) text += ',';
      append_training(text, column, rows.values()[at * width + i], false);
    }
    text += ']';
  }
  text += "}}";
  return answer;
}

Answer Api::all_training(const RunRow& row, bool csv) {
  const std::vector<TrainingColumn>& columns = training_columns();
  Answer answer = file_answer(row.name, csv ? "training.csv" : "training.json", csv);
  Lent reader(*this);
  if (csv) {
    for (const TrainingColumn& column : columns)
      answer.body += (answer.body.empty() ? "" : ",") + std::string(column.name);
    answer.body += '\n';
    reader->training(row.id, [&](const Statement& values) {
      for (std::size_t i = 0; i < columns.size(); ++i) {
        if (i > 0) answer.body += ',';
        append_training(answer.body, columns[i], values.real(static_cast<int>(i)), true);
      }
      answer.body += '\n';
    });
    return answer;
  }
  std::vector<std::string> texts(columns.size());
  std::uint64_t total = 0;
  reader->training(row.id, [&](const Statement& values) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      if (total > 0) texts[i] += ',';
      append_training(texts[i], columns[i], values.real(static_cast<int>(i)), false);
    }
    ++total;
  });
  answer.body = "{\"id\":";
  append_json(answer.body, row.name);
  answer.body += ",\"total\":" + std::to_string(total) + ",\"columns\":{";
  for (std::size_t i = 0; i < columns.size(); ++i)
    answer.body += (i == 0 ? "\"" : ",\"") + std::string(columns[i].name) + "\":[" + texts[i] + "]";
  answer.body += "}}";
  return answer;
}

Answer Api::episodes(const RunRow& row, const Query& query) {
  only(query, {"limit", "before", "evaluation", "traversal", "policy", "update", "shuffled", "completed", "order"});
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  EpisodeFilter filter;
  filter.evaluation = flag(query, "evaluation");
  filter.completed = flag(query, "completed");
  filter.shuffled = flag(query, "shuffled");
  filter.traversal = given(query, "traversal");
  filter.policy = given(query, "policy");
  if (const auto update = number<std::int64_t>(query, "update", 0, kMost))
    filter.update = static_cast<std::uint64_t>(*update);
  const auto before = number<std::int64_t>(query, "before", 0, kMost);
  const int limit = number<int>(query, "limit", 1, 10000).value_or(100);
  const std::string order = given(query, "order").value_or("newest");
  if (order != "newest" && order != "worst")
    throw Refusal(400, "parameter 'order' must be newest or worst, is '" + order + "'");
  if (before && order == "worst") throw Refusal(400, "parameter 'before' goes with order=newest only");
  Lent reader(*this);
  const bool all = query.parameters.empty();
  const std::uint64_t total = all ? row.recorded : reader->count(row.id, filter);
  filter.before = before;
  Answer answer;
  answer.body = "{\"total\":" + std::to_string(total) + ",\"episodes\":[";
  bool first = true;
  for (const EpisodeRow& one : reader->episodes(row.id, filter, order == "worst", static_cast<std::size_t>(limit))) {
    if (!first) answer.body += ',';
    first = false;
    append_episode(answer.body, one);
  }
  answer.body += "]}";
  return answer;
}

Answer Api::all_episodes(const RunRow& row, bool csv) {
  Answer answer = file_answer(row.name, csv ? "episodes.csv" : "episodes.json", csv);
  std::string& text = answer.body;
  Lent reader(*this);
  if (csv) {
    visit(EpisodeRow(), [&](const char* name, const auto&) { text += (text.empty() ? "" : ",") + std::string(name); });
    text += '\n';
    reader->episodes(row.id, [&](const EpisodeRow& one) {
      visit(one, CsvFields{text});
      text += '\n';
    });
    return answer;
  }
  text = "{\"episodes\":[";
  std::uint64_t total = 0;
  reader->episodes(row.id, [&](const EpisodeRow& one) {
    if (total++ > 0) text += ',';
    append_episode(text, one);
  });
  text += "],\"total\":" + std::to_string(total) + "}";
  return answer;
}

Answer Api::evaluations(const RunRow& row) {
  Json list = Json::array();
  Lent reader(*this);
  for (const StoreReader::EvaluationGroup& group : reader->evaluations(row.id)) {
    const std::pair key(row.id, group.key);
    std::optional<EvaluationFigures> known;
    {
      std::lock_guard lock(mutex_);
      const auto found = evaluations_.find(key);
      if (found != evaluations_.end() && found->second.episodes == group.episodes &&
          found->second.newest == group.newest)
        known = found->second.figures;
    }
    if (!known) {
      known = evaluate(reader->tasks(row.id, group.key));
      std::lock_guard lock(mutex_);
      if (evaluations_.size() >= kFiguresKept) evaluations_.clear();
      evaluations_[key] = {group.episodes, group.newest, *known};
    }
    list.push_back({{"policy", group.key.policy},
                    {"update", group.key.update},
                    {"shuffled", group.key.shuffled},
                    {"traversal", group.key.traversal},
                    {"tasks", known->tasks},
                    {"completed", known->completed},
                    {"failed", known->failed},
                    {"spl", known->spl},
                    {"spl_low", known->spl_low},
                    {"spl_high", known->spl_high},
                    {"reward", known->reward},
                    {"mean_steps", known->mean_steps},
                    {"shortest_mean", known->shortest_mean},
                    {"excess", std::isfinite(known->excess) ? Json(known->excess) : Json(nullptr)}});
  }
  return json_answer({{"evaluations", std::move(list)}});
}

Answer Api::episode(const Query& query) {
  only(query, {});
  const auto rowid = parsed<std::int64_t>(query.path[1]);
  if (!rowid) throw Refusal(400, "an episode is named by its rowid, a number; '" + query.path[1] + "' is none");
  Lent reader(*this);
  const auto replay = reader->episode(*rowid);
  if (!replay) not_found("there is no episode " + query.path[1]);
  Answer answer;
  append_episode(answer.body, replay->row);
  answer.body.pop_back();
  answer.body += ",\"positions\":" + text_of(positions_of(*replay)) +
                 ",\"hash\":" + (replay->hash ? "\"" + hash_text(*replay->hash) + "\"" : std::string("null")) + "}";
  return answer;
}

Answer Api::controls(const Query& query) {
  only(query, {"frames", "max_steps"});
  const auto frames = number<int>(query, "frames", 2, 4096);
  if (!frames) throw Refusal(400, "parameter 'frames' is missing: places of the route");
  const auto max_steps = number<int>(query, "max_steps", 1, 1 << 30);
  if (!max_steps) throw Refusal(400, "parameter 'max_steps' is missing: step limit of an episode");
  return json_answer({{"blind", control_json(blind_figures(*frames, *max_steps))},
                      {"shortest_path", control_json(shortest_path_figures(*frames, *max_steps))}});
}

Answer Api::services() {
  if (live_) return json_answer(live_->services());
  return json_answer({{"now", now_seconds()}, {"services", Json::array()}});
}

Answer Api::events(const Query& query) {
  only(query, {"limit"});
  const auto limit = static_cast<std::size_t>(number<int>(query, "limit", 1, 10000).value_or(200));
  Json all = live_ ? live_->events(limit) : Json::array();
  for (const Event& event : store_.events(limit)) {
    Json one = {{"time", event.time},
                {"run", event.run},
                {"service", event.service},
                {"kind", event.kind},
                {"text", event.text}};
    if (std::find(all.begin(), all.end(), one) == all.end()) all.push_back(std::move(one));
  }
  std::stable_sort(all.begin(), all.end(), [](const Json& a, const Json& b) { return a["time"] > b["time"]; });
  if (all.size() > limit) all.erase(all.begin() + static_cast<std::ptrdiff_t>(limit), all.end());
  return json_answer({{"events", std::move(all)}});
}

Answer Api::map(const Query& query) {
  only(query, {});
  const std::uint64_t hash = hash_of(query.path[1]);
  const LiveView::Map map = live_ ? live_->map(hash) : LiveView::Map();
  if (map.readiness == LiveView::Readiness::kComing) return coming();
  if (map.readiness == LiveView::Readiness::kNone) not_found("no env_service that is there hosts " + query.path[1]);
  return json_answer(map.json);
}

Answer Api::frame(const Query& query) {
  only(query, {});
  const std::uint64_t hash = hash_of(query.path[1]);
  const auto index = parsed<std::uint32_t>(query.path[2]);
  if (!index) throw Refusal(400, "a frame is named by its index, a number; '" + query.path[2] + "' is none");
  LiveView::Picture picture = live_ ? live_->frame(hash, *index) : LiveView::Picture();
  if (picture.readiness == LiveView::Readiness::kComing) return coming();
  if (picture.readiness == LiveView::Readiness::kNone)
    not_found("no env_service that is there has a picture of frame " + query.path[2] + " of " + query.path[1]);
  Answer answer;
  answer.type = std::move(picture.type);
  answer.body = std::move(picture.bytes);
  answer.headers.emplace_back("Cache-Control", "private, max-age=31536000, immutable");
  return answer;
}

Answer Api::recognition(const Query& query) {
  if (query.path.size() == 1) {
    only(query, {});
    return json_answer({{"results", recognition_.list()}});
  }
  const std::string &name = query.path[1], &part = query.path[2];
  Answer answer;
  std::optional<std::string> found;
  if (part == "curve") {
    only(query, {});
    found = recognition_.curves(name);
  } else if (part == "matrix") {
    only(query, {"file"});
    found = recognition_.matrix(name, given(query, "file").value_or(""));
    answer.type = "image/png";
  }
  if (!found)
    not_found("there is no '" + part + "' of a result '" + name +
              "' (GET /api/recognition lists them; where an older vpr "
              "wrote no curves, run it again)");
  answer.body = std::move(*found);
  return answer;
}

Answer Api::about() {
  Lent reader(*this);
  const std::string& path = store_.path();
  return json_answer(
      {{"version", version()},
       {"vendor", options_.vendor},
       {"run", options_.run},
       {"domain", options_.domain},
       {"store",
        {{"file", path}, {"bytes", bytes_of(path) + bytes_of(path + "-wal")}, {"episodes", reader->episodes()}}},
       {"recording", !options_.recording || options_.recording()}});
}

}  // namespace citylearn
