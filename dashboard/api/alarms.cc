// SPDX-License-Identifier: Apache-2.0
// Alarms of runs, and the rules by which they are raised.
#include "dashboard/alarms/alarms.h"

#include <cmath>

#include "dashboard/api/api.h"
#include "dashboard/api/parameters.h"
#include "dashboard/api/text_member.h"
#include "dashboard/logged/logged_runs.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::initializer_list<const char*> kMembers = {"runs",   "when",  "figure", "value",
                                                         "points", "steps", "minutes"};

constexpr std::size_t kLongestWhen = 16;

Json rule_json(const AlarmRule& rule) {
  return {{"id", rule.id},
          {"runs", rule.runs},
          {"when", name_of(rule.when)},
          {"figure", rule.figure.empty() ? Json(nullptr) : Json(rule.figure)},
          {"value", rule.value},
          {"points", rule.points},
          {"steps", rule.steps},
          {"minutes", rule.minutes},
          {"created", rule.created},
          {"text", described(rule)}};
}

/// Takes a member, where it is given. Throws RequestError when it is of another type.
void take_text(const Json& body, const char* name, std::size_t longest, std::string& text) {
  text = read_request([&] { return text_member(body, name, longest); }).value_or(text);
}
void take_number(const Json& body, const char* name, double& number) {
  if (!body.contains(name) || body[name].is_null()) return;
  if (!body[name].is_number()) throw RequestError(400, "'" + std::string(name) + "' must be a number");
  number = body[name].get<double>();
}

AlarmRule rule_of(const Query& query) {
  const Json body = object_of(query, kMembers);
  AlarmRule rule;
  std::string when;
  take_text(body, "when", kLongestWhen, when);
  const auto known = when_of(when);
  if (!known) throw RequestError(400, "'when' must be below, above, not_finite, silent or lost");
  rule.when = *known;
  take_text(body, "runs", kLongestAlarmRuns, rule.runs);
  take_text(body, "figure", kLongestMetric, rule.figure);
  const bool bounded = rule.when == AlarmRule::When::kBelow || rule.when == AlarmRule::When::kAbove;
  if (bounded && !(body.contains("value") && body["value"].is_number()))
    throw RequestError(400, "'value' is missing: the number that the figure must not be " + when);
  if (bounded) take_number(body, "value", rule.value);
  if (counts_points(rule)) {
    auto points = static_cast<double>(rule.points);
    take_number(body, "points", points);
    if (!(points >= 1 && points <= 1e9 && points == std::floor(points)))
      throw RequestError(400, "'points' must be a whole number from 1 on");
    rule.points = static_cast<std::uint64_t>(points);
    take_number(body, "steps", rule.steps);
  }
  if (rule.when == AlarmRule::When::kSilent) take_number(body, "minutes", rule.minutes);
  if (rule.when == AlarmRule::When::kLost) rule.figure.clear();
  if (const auto fault = fault_of(rule)) throw RequestError(400, *fault);
  return rule;
}

}  // namespace

Json alarms_json(Alarms& alarms) {
  Json rules = Json::array(), raised = Json::array();
  for (const AlarmRule& rule : alarms.rules()) rules.push_back(rule_json(rule));
  for (const RunAlarm& alarm : alarms.alarms())
    raised.push_back({{"id", alarm.id},
                      {"rule", alarm.rule},
                      {"run", alarm.run},
                      {"since", alarm.since},
                      {"over", alarm.over ? Json(*alarm.over) : Json(nullptr)},
                      {"text", alarm.text}});
  return {{"rules", std::move(rules)}, {"alarms", std::move(raised)}};
}

Answer Api::alarms(const Query& query) {
  if (!options_.alarms) {
    if (query.method != "GET") throw RequestError(409, "a recording is shown here: runs have no alarms");
    return json_answer({{"rules", Json::array()}, {"alarms", Json::array()}});
  }
  Alarms& alarms = *options_.alarms;
  if (query.method == "GET") {
    allow_only(query, {});
    return json_answer(alarms_json(alarms));
  }
  if (query.method == "POST") {
    const AlarmRule rule = rule_of(query);
    if (const auto fault = alarms.refusal(rule)) throw RequestError(400, *fault);
    return json_answer(rule_json(alarms.add(rule)));
  }
  allow_only(query, {});
  const std::string& name = query.path[1];
  const auto id = parsed<std::int64_t>(name);
  if (query.method == "PATCH") {
    const Json body = object_of(query, {"over"});
    if (body != Json{{"over", true}}) throw RequestError(400, "an alarm can be changed to {\"over\": true} alone");
    if (!id || !alarms.dismiss(*id)) not_found("alarm '" + name + "' does not last (GET /api/alarms lists them)");
    return json_answer(alarms_json(alarms));
  }
  if (!id || !alarms.remove(*id)) not_found("rule '" + name + "' not found (GET /api/alarms lists them)");
  Answer answer;
  answer.status = 204;
  return answer;
}

}  // namespace citylearn
