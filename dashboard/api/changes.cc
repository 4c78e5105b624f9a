// SPDX-License-Identifier: Apache-2.0
// What a client may change: the runs that it logs, what people write about a run, and how a recording is played.
#include <algorithm>
#include <cmath>
#include <set>

#include "core/files/json.h"
#include "core/util/text.h"
#include "dashboard/api/api.h"
#include "dashboard/api/log_frame.h"
#include "dashboard/api/parameters.h"
#include "dashboard/api/text_member.h"
#include "dashboard/playback/moment.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostTags = 32;
constexpr std::size_t kLongestTag = 64, kLongestNote = 2000, kLongestTitle = 256;  // bytes
constexpr std::size_t kLongestRun = 1024;                                          // likewise, of an ID
constexpr double kSlowest = 0.01, kFastest = 1000;

std::vector<std::string> tags_of(const Json& json) {
  const RequestError wrong(400, "'tags' must be at most " + std::to_string(kMostTags) + " different texts of 1 to " +
                                    std::to_string(kLongestTag) +
                                    " bytes on one line, without commas, or spaces at their ends");
  if (!json.is_array() || json.size() > kMostTags) throw wrong;
  std::vector<std::string> tags;
  for (const Json& one : json) {
    if (!one.is_string()) throw wrong;
    const auto& tag = one.get_ref<const std::string&>();
    if (tag.empty() || tag.size() > kLongestTag || tag.front() == ' ' || tag.back() == ' ' || has_control(tag) ||
        tag.find(',') != tag.npos || std::find(tags.begin(), tags.end(), tag) != tags.end())
      throw wrong;
    tags.push_back(tag);
  }
  return tags;
}

std::optional<std::string> note_of(const Json& object) {
  return read_request([&] { return text_member(object, "note", kLongestNote, Lines::kAny); });
}

double number_of(const Json& json) { return json.is_number() ? json.get<double>() : std::nan(""); }

/// Returns the line of a member; empty where it is missing.
std::string line_of(const Json& object, const char* name, std::size_t longest) {
  return read_request([&] { return text_member(object, name, longest); }).value_or("");
}

LogBeginning beginning_of(const Json& json) {
  LogBeginning beginning;
  const double now = seconds_since_epoch();
  beginning.started = json.contains("started") ? number_of(json["started"]) : now;
  if (!(beginning.started > 0 && beginning.started < 1e11))
    throw RequestError(400, "'started' must be seconds since 1970");
  beginning.title = line_of(json, "title", kLongestTitle);
  if (json.contains("tags")) beginning.tags = tags_of(json["tags"]);
  beginning.note = note_of(json).value_or("");
  return beginning;
}

/// Adds a record of a log. Throws RequestError, naming the record, when it is none.
void add_record(LogBatch& batch, const Json& record) {
  const std::string where = "record " + std::to_string(batch.end_record()) + ": ";
  const auto member = [&](const char* name) { return record.is_object() && record.contains(name); };
  if (member("values") && record["values"].is_object()) {
    const double step = member("step") ? number_of(record["step"]) : std::nan("");
    const double time = member("time") ? number_of(record["time"]) : std::nan("");
    if (!std::isfinite(step) || !std::isfinite(time))
      throw RequestError(400, where + "'values' need the numbers 'step' and 'time'");
    for (const auto& [metric, value] : record["values"].items()) {
      if (const auto fault = fault_of_metric(metric)) throw RequestError(400, where + *fault);
      if (!value.is_number() && !value.is_null())
        throw RequestError(400, where + "the value of '" + metric + "' must be a number or null");
      batch.add(metric, step, time, number_of(value));
    }
    batch.points_done();
  } else if (member("config") && record["config"].is_object()) {
    batch.configure(text_of(record["config"]));
  } else if (member("summary") && record["summary"].is_object()) {
    batch.summarise(text_of(record["summary"]));
  } else if (member("begin") && record["begin"].is_object()) {
    batch.begin(beginning_of(record["begin"]));
  } else if (member("end")) {
    batch.end();
  } else {
    throw RequestError(400, where + "must have 'values', 'config', 'summary', 'begin' or 'end'");
  }
}

LogBatch batch_of_json(const Query& query) {
  const Json body = object_of(query, {"source", "log", "first", "records", "ended"});
  if (!body.contains("first") || !body["first"].is_number_unsigned() || body["first"] < 1 ||
      body["first"] > kMostRecords)
    throw RequestError(400, "'first' must be the number of the first record, from 1 on");
  if (!body.contains("records") || !body["records"].is_array())
    throw RequestError(400, "'records' must be a list of records");
  LogBatch batch(body["first"].get<std::uint64_t>());
  batch.source = line_of(body, "source", kLongestSource);
  batch.log = line_of(body, "log", kLongestSource);
  for (const Json& record : body["records"]) add_record(batch, record);
  if (body.contains("ended")) {
    if (!body["ended"].is_boolean()) throw RequestError(400, "'ended' must be true or false");
    batch.ended = body["ended"].get<bool>();
  }
  return batch;
}

LogBatch batch_of_frame(const Query& query) {
  allow_only(query, {});
  return read_request([&] { return parse_log_frame(query.body); });
}

Json speed_json(double speed) { return speed == 0 ? Json("max") : Json(speed); }

double speed_of(const Json& json) {
  if (json == "max") return 0;
  const double speed = json.is_number() ? json.get<double>() : 0;
  if (!(speed >= kSlowest && speed <= kFastest))
    throw RequestError(400, "'speed' must be \"max\" or a number from 0.01 to 1000, is " + text_of(json));
  return speed;
}

Moment moment_of(const Json& json) {
  const RequestError wrong(400, "'moment' must be the 'run' and one number from 0 on: " + joined(moment_axes()));
  const std::string run = line_of(json, "run", kLongestRun);
  if (run.empty() || json.size() != 2) throw wrong;
  for (const std::string& axis : moment_axes())
    if (json.contains(axis) && number_of(json[axis]) >= 0) return {run, axis, number_of(json[axis])};
  throw wrong;
}

/// Returns where to go for a moment; nothing when the recording is there.
std::optional<double> position_of(const Moment& moment, const PlaybackControl& playback) {
  const auto outline = playback.outline();
  if (!outline) {
    RequestError early(503, "the recording is still being read: ask again in a second");
    early.answer.headers.emplace_back("Retry-After", "1");
    throw early;
  }
  try {
    return position_of(moment, *outline, playback.state());
  } catch (const Error& error) {
    not_found(error.what());
  }
}

}  // namespace

Json playback_json(const PlaybackControl& playback) {
  const ReplayState state = playback.state();
  const auto outline = playback.outline();
  return {{"position", state.position},
          {"length", outline ? Json(std::max(outline->seconds, state.position)) : Json(nullptr)},
          {"speed", speed_json(state.speed)},
          {"paused", state.paused},
          {"seeking", state.seeking},
          {"ended", state.ended},
          {"generation", playback.generation()},
          {"runs", outline ? moments_at(*outline, state.position) : Json::object()}};
}

Answer Api::playback(const Query& query) {
  if (!options_.playback) not_found("no recording is open: start the dashboard with --open FILE");
  if (query.method == "PATCH") {
    const Json wanted = object_of(query, {"paused", "speed", "position", "moment"});
    PlaybackChange change;
    if (wanted.contains("paused")) {
      if (!wanted["paused"].is_boolean()) throw RequestError(400, "'paused' must be true or false");
      change.paused = wanted["paused"].get<bool>();
    }
    if (wanted.contains("speed")) change.speed = speed_of(wanted["speed"]);
    if (wanted.contains("position")) {
      const Json& position = wanted["position"];
      if (!position.is_number() || !(position.get<double>() >= 0 && position.get<double>() <= 1e9))
        throw RequestError(400, "'position' must be seconds from the beginning on, is " + text_of(position));
      change.position = position.get<double>();
    }
    if (wanted.contains("moment")) {
      if (change.position) throw RequestError(400, "'position' and 'moment' are two ways to say where: give one");
      change.position = position_of(moment_of(wanted["moment"]), *options_.playback);
    }
    options_.playback->change(change);
  } else {
    allow_only(query, {});
  }
  Json json = playback_json(*options_.playback);
  const auto outline = options_.playback->outline();
  json["marks"] = outline ? Json({{"updates", outline->updates}, {"episodes", outline->episodes}}) : Json(nullptr);
  json["spans"] = outline ? moment_spans(*outline) : Json(nullptr);
  return json_answer(json);
}

Answer Api::log(const std::string& name, const Query& query) {
  if (options_.playback) throw RequestError(409, "a recording is shown here: log to another dashboard");
  if (const auto fault = fault_of_logged_id(name)) throw RequestError(400, *fault);
  const LogBatch batch = query.type == kLogFrameType ? batch_of_frame(query) : batch_of_json(query);
  if (batch.source.empty() || batch.log.empty())
    throw RequestError(400, "'source' and 'log' must say what logs, and identify the log");
  const LoggedRuns::Outcome outcome = logged_.append(name, batch);
  if (outcome.other_log)
    throw RequestError(409, "run '" + name + "' has been logged by another program: choose another name, or resume it");
  return json_answer({{"id", name}, {"received", outcome.received}});
}

Answer Api::annotate(const std::string& name, const Query& query) {
  const Json wanted = object_of(query, {"tags", "note"});
  std::optional<std::vector<std::string>> tags;
  if (wanted.contains("tags")) tags = tags_of(wanted["tags"]);
  const auto note = note_of(wanted);
  if (!store_.annotate(name, tags, note)) not_found("run '" + name + "' not found (GET /api/runs lists them)");
  std::optional<RunRow> row;
  {
    BorrowedReader reader(*this);
    row = reader->run(name);
  }
  if (!row) not_found("run '" + name + "' not found (GET /api/runs lists them)");
  return json_answer(run_json(*row));
}

}  // namespace citylearn
