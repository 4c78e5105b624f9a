// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/work.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/command_line/progress.h"
#include "core/dds/middleware.h"
#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/wire/service.h"

namespace citylearn::paper {

void throw_if_stopped() {
  if (stop_requested()) throw Stopped{};
}

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json repeatable(const Json& outcome) {
  if (!outcome.is_structured()) return outcome;
  Json kept = outcome.is_array() ? Json::array() : Json::object();
  for (const auto& [key, value] : outcome.items()) {
    if (outcome.is_array())
      kept.push_back(repeatable(value));
    else if (key != "seconds")
      kept[key] = repeatable(value);
  }
  return kept;
}

Json measured(const Json& outcome) {
  Json found;
  if (!outcome.is_object()) return found;
  for (const auto& [key, value] : outcome.items())
    if (key == "seconds")
      found[key] = value;
    else if (const Json inner = measured(value); !inner.is_null())
      found[key] = inner;
  return found;
}

Work::Work(std::string folder) : folder_(std::move(folder)) { create_folder(folder_, "choose another --work"); }

std::string Work::path_of(const Json& spec) const {
  return folder_ + "/" + sha256(spec.dump() + "#" + std::to_string(kVersion)).substr(0, 20) + ".json";
}

/// Returns the outcome that an earlier run wrote; null when there is none, or one that cannot be read.
Work::Done Work::read(const std::string& path, const Json& spec) {
  std::ifstream file(path);
  if (!file) return {};
  const Json stored = parse_json_or_null(std::string(std::istreambuf_iterator(file), {}));
  if (!stored.is_object() || !stored.contains("outcome") || stored.value("spec", Json()) != spec ||
      !stored.value("seconds", Json()).is_number())
    return {};
  return {stored["outcome"], stored["seconds"].get<double>()};
}

int Work::add(Unit unit) {
  const auto [known, fresh] = numbers_.try_emplace(path_of(unit.spec), units());
  if (fresh) {
    units_.push_back(std::move(unit));
    done_.emplace_back();
  }
  return known->second;
}

bool Work::run() {
  std::vector<std::size_t> open;
  double left = 0;
  for (std::size_t i = 0; i < units_.size(); ++i) {
    const std::string path = path_of(units_[i].spec);
    if (done_[i].outcome.is_null()) done_[i] = read(path, units_[i].spec);
    if (!done_[i].outcome.is_null()) continue;
    if (std::filesystem::exists(path)) spdlog::warn("{}: not an outcome of this program; computing it again", path);
    open.push_back(i);
    left += units_[i].seconds;
  }
  if (open.size() < units_.size())
    spdlog::info("{} of {} pieces of work are there", units_.size() - open.size(), units_.size());
  // Estimates are for an idle machine of two cores; the units done so far show how slow this one is.
  double estimated = 0, taken = 0;
  bool well = true;
  for (std::size_t i = 0; i < open.size(); ++i) {
    const Unit& unit = units_[open[i]];
    throw_if_stopped();
    const std::string path = path_of(unit.spec);
    Done& done = done_[open[i]];
    done = read(path, unit.spec);
    if (!done.outcome.is_null()) {  // another run did it meanwhile
      left -= unit.seconds;
      continue;
    }
    const double slowness = estimated > 0 ? taken / estimated : 1;
    spdlog::info("[{} of {}, {} left] {}", i + 1, open.size(), clock_time(left * slowness), unit.name);
    const Clock::time_point start = Clock::now();
    try {
      const Json outcome = unit.compute();
      const double seconds = seconds_since(start);
      write_file(path, Json{{"spec", unit.spec}, {"outcome", outcome}, {"seconds", seconds}}.dump() + "\n");
      done = {outcome, seconds};
    } catch (const Error& error) {
      spdlog::error("{}: {}", unit.name, error.what());
      well = false;
    }
    left -= unit.seconds;
    estimated += unit.seconds;
    taken += seconds_since(start);
  }
  return well;
}

const Json& Work::outcome(int unit) const { return done_.at(static_cast<std::size_t>(unit)).outcome; }

std::string Work::results() const {
  std::string text;
  for (std::size_t i = 0; i < units_.size(); ++i)
    text += (text.empty() ? "[" : ",\n") +
            Json{{"name", units_[i].name}, {"spec", units_[i].spec}, {"outcome", repeatable(done_[i].outcome)}}.dump();
  return (text.empty() ? "[" : text) + "]\n";
}

Json Work::measurements() const {
  Json all = Json::array();
  for (const Done& done : done_) all.push_back(measured(done.outcome));
  return all;
}

Json Work::times() const {
  Json times = Json::array();
  for (std::size_t i = 0; i < units_.size(); ++i)
    times.push_back(
        {{"name", units_[i].name}, {"seconds", done_[i].outcome.is_null() ? Json() : Json(done_[i].seconds)}});
  return times;
}

}  // namespace citylearn::paper
