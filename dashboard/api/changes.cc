// SPDX-License-Identifier: Apache-2.0
// What a client may change: what people write about a run, and how a recording is played.
#include <algorithm>
#include <cmath>

#include "core/files/json.h"
#include "core/util/text.h"
#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"
#include "dashboard/playback/moment.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxTags = 32;
constexpr std::size_t kMaxTagBytes = 64, kMaxNoteBytes = 2000;  // bytes
constexpr std::size_t kMaxRunIdBytes = 1024;                    // likewise, of an ID
constexpr double kMinSpeed = 0.01, kMaxSpeed = 1000;

/// Returns whether a text has control characters (those of ASCII) but `allowed` ones.
bool has_control(std::string_view text, std::string_view allowed = "") {
  return std::any_of(text.begin(), text.end(),
                     [&](char c) { return ((c >= 0 && c < ' ') || c == '\x7F') && allowed.find(c) == allowed.npos; });
}

enum class Lines { kOne, kAny };  // kAny: line feeds and tabs are allowed

/// Returns a text of the object that a client sent; nothing when it is missing or null. Throws RequestError naming the
/// member when it is of another type, longer than `longest` bytes, or has control characters (but those of `lines`).
std::optional<std::string> text_member(const Json& object, const char* name, std::size_t longest,
                                       Lines lines = Lines::kOne) {
  const auto member = object.find(name);
  if (member == object.end() || member->is_null()) return std::nullopt;
  const auto* text = member->get_ptr<const std::string*>();
  if (!text || text->size() > longest || has_control(*text, lines == Lines::kAny ? "\n\t" : ""))
    throw RequestError(400, "'" + std::string(name) + "' must be " + (lines == Lines::kAny ? "a text" : "one line") +
                                " of at most " + std::to_string(longest) + " bytes without control characters");
  return *text;
}

std::vector<std::string> tags_of(const Json& json) {
  const RequestError wrong(400, "'tags' must be at most " + std::to_string(kMaxTags) + " different texts of 1 to " +
                                    std::to_string(kMaxTagBytes) +
                                    " bytes on one line, without commas, or spaces at their ends");
  if (!json.is_array() || json.size() > kMaxTags) throw wrong;
  std::vector<std::string> tags;
  for (const Json& one : json) {
    if (!one.is_string()) throw wrong;
    const auto& tag = one.get_ref<const std::string&>();
    if (tag.empty() || tag.size() > kMaxTagBytes || tag.front() == ' ' || tag.back() == ' ' || has_control(tag) ||
        tag.find(',') != tag.npos || std::find(tags.begin(), tags.end(), tag) != tags.end())
      throw wrong;
    tags.push_back(tag);
  }
  return tags;
}

double number_of(const Json& json) { return json.is_number() ? json.get<double>() : std::nan(""); }

Json speed_json(double speed) { return speed == 0 ? Json("max") : Json(speed); }

double speed_of(const Json& json) {
  if (json == "max") return 0;
  const double speed = json.is_number() ? json.get<double>() : 0;
  if (!(speed >= kMinSpeed && speed <= kMaxSpeed))
    throw RequestError(400, "'speed' must be \"max\" or a number from 0.01 to 1000, is " + text_of(json));
  return speed;
}

Moment moment_of(const Json& json) {
  const RequestError wrong(400, "'moment' must be the 'run' and one number from 0 on: " + joined(moment_axes()));
  const std::string run = text_member(json, "run", kMaxRunIdBytes).value_or("");
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

Answer Api::annotate(const std::string& name, const Query& query) {
  const Json wanted = object_of(query, {"tags", "note"});
  std::optional<std::vector<std::string>> tags;
  if (wanted.contains("tags")) tags = tags_of(wanted["tags"]);
  const auto note = text_member(wanted, "note", kMaxNoteBytes, Lines::kAny);
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
