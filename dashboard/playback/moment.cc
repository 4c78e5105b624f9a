// SPDX-License-Identifier: Apache-2.0
#include "dashboard/playback/moment.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/util/error.h"
#include "dashboard/store/store.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

double value_on(const std::string& axis, const RecordedUpdate& update) {
  if (axis == "update") return static_cast<double>(update.update);
  if (axis == "steps") return static_cast<double>(update.steps);
  if (axis == "episodes") return static_cast<double>(update.episodes);
  return update.wall;
}

std::string id_of(const RecordedRun& run) { return run_id(run.session, run.policy, run.seed, run.run_id); }

Json update_json(const RecordedUpdate& update) {
  return {{"update", update.update}, {"steps", update.steps}, {"episodes", update.episodes}, {"wall", update.wall}};
}

/// Returns the newest update up to a position; null before the first.
const RecordedUpdate* update_at(const RecordedRun& run, double position) {
  const auto after = std::upper_bound(run.updates.begin(), run.updates.end(), position,
                                      [](double at, const RecordedUpdate& update) { return at < update.position; });
  return after == run.updates.begin() ? nullptr : &*(after - 1);
}

}  // namespace

const std::vector<std::string>& moment_axes() {
  static const std::vector<std::string> axes = {"update", "steps", "episodes", "wall"};
  return axes;
}

std::optional<double> position_of(const Moment& moment, const RecordingOutline& outline, const ReplayState& state) {
  const auto run = std::find_if(outline.runs.begin(), outline.runs.end(),
                                [&](const RecordedRun& one) { return id_of(one) == moment.run; });
  if (run == outline.runs.end()) throw Error("the recording has no update of run '" + moment.run + "'");
  const auto distance = [&](const RecordedUpdate& update) {
    return std::abs(value_on(moment.axis, update) - moment.at);
  };
  // Of equally near ones the last: where a run was resumed from an older checkpoint, it is the one that counts.
  const RecordedUpdate* nearest = &run->updates.front();
  for (const RecordedUpdate& update : run->updates)
    if (distance(update) <= distance(*nearest)) nearest = &update;
  // Where it stands behind such an update it stays: to go back to it means to play everything again.
  const RecordedUpdate* here = state.seeking ? nullptr : update_at(*run, state.position);
  if (here && distance(*here) <= distance(*nearest)) return std::nullopt;
  return nearest->position;
}

Json moments_at(const RecordingOutline& outline, double position) {
  Json moments = Json::object();
  for (const RecordedRun& run : outline.runs)
    if (const RecordedUpdate* update = update_at(run, position)) moments[id_of(run)] = update_json(*update);
  return moments;
}

Json moment_spans(const RecordingOutline& outline) {
  Json spans = Json::object();
  for (const RecordedRun& run : outline.runs)
    spans[id_of(run)] = {{"first", update_json(run.updates.front())}, {"last", update_json(run.updates.back())}};
  return spans;
}

}  // namespace citylearn
