// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/work.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "core/util/files.h"
#include "core/dds/middleware.h"
#include "core/wire/service.h"
#include "core/util/sha256.h"
#include "tools/vpr/progress.h"

namespace citylearn::paper {
namespace {

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

}  // namespace

void make_folder(const std::string& folder, const std::string& option) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error("cannot create '" + folder + "': " + error.message(), option);
}

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json repeatable(const Json& outcome) {
  if (!outcome.is_structured()) return outcome;
  Json kept = outcome.is_array() ? Json::array() : Json::object();
  for (const auto& [key, value] : outcome.items()) {
    if (outcome.is_array())
      kept.push_back(repeatable(value));
    else if (key != "seconds" && key != "bytes")
      kept[key] = repeatable(value);
  }
  return kept;
}

Work::Work(std::string folder) : folder_(std::move(folder)) { make_folder(folder_, "--work"); }

std::string Work::path_of(const Json& spec) const {
  return folder_ + "/" + sha256(spec.dump() + "#" + std::to_string(kVersion)).substr(0, 20) + ".json";
}

/// What a run left; nothing when it left nothing, or something that cannot be read.
Work::Done Work::read(const std::string& path, const Json& spec) {
  std::ifstream file(path);
  if (!file) return {};
  const Json stored = Json::parse(file, nullptr, /*allow_exceptions=*/false);
  if (!stored.is_object() || !stored.contains("outcome") || stored.value("spec", Json()) != spec ||
      !stored.value("seconds", Json()).is_number())
    return {};
  return {stored["outcome"], stored["seconds"].get<double>()};
}

void Work::add(Unit unit) {
  if (outcomes_.try_emplace(path_of(unit.spec)).second) units_.push_back(std::move(unit));
}

bool Work::run() {
  std::vector<const Unit*> open;
  double left = 0;
  for (const Unit& unit : units_) {
    const std::string path = path_of(unit.spec);
    Done& done = outcomes_[path];
    if (done.outcome.is_null()) done = read(path, unit.spec);
    if (!done.outcome.is_null()) continue;
    if (std::filesystem::exists(path)) spdlog::warn("{} is not an outcome of this program: done again", path);
    open.push_back(&unit);
    left += unit.seconds;
  }
  if (open.size() < units_.size())
    spdlog::info("{} of {} pieces of work are there", units_.size() - open.size(), units_.size());
  // Guesses are of a quiet machine of two cores; what was done tells how slow this one is.
  double guessed = 0, taken = 0;
  bool well = true;
  for (std::size_t i = 0; i < open.size(); ++i) {
    const Unit& unit = *open[i];
    if (stop_requested()) throw Stopped{};
    const std::string path = path_of(unit.spec);
    Done& done = outcomes_[path];
    done = read(path, unit.spec);
    if (!done.outcome.is_null()) {  // by another run meanwhile
      left -= unit.seconds;
      continue;
    }
    const double slowness = guessed > 0 ? taken / guessed : 1;
    spdlog::info("[{} of {}, {} left] {}", i + 1, open.size(), vpr::clock_time(left * slowness), unit.name);
    const Clock::time_point start = Clock::now();
    try {
      const Json outcome = unit.compute();
      const double seconds = since(start);
      write_file(path, Json{{"spec", unit.spec}, {"outcome", outcome}, {"seconds", seconds}}.dump() + "\n");
      done = {outcome, seconds};
    } catch (const Error& error) {
      spdlog::error("{}: {}", unit.name, error.what());
      well = false;
    }
    left -= unit.seconds;
    guessed += unit.seconds;
    taken += since(start);
  }
  return well;
}

const Json& Work::outcome(const Json& spec) const {
  static const Json none;
  const auto found = outcomes_.find(path_of(spec));
  return found == outcomes_.end() ? none : found->second.outcome;
}

std::string Work::results() const {
  std::string text;
  for (const Unit& unit : units_)
    text += (text.empty() ? "[" : ",\n") +
            Json{{"name", unit.name}, {"spec", unit.spec}, {"outcome", repeatable(outcome(unit.spec))}}.dump();
  return (text.empty() ? "[" : text) + "]\n";
}

Json Work::times() const {
  Json times = Json::array();
  for (const Unit& unit : units_) {
    const Done& done = outcomes_.at(path_of(unit.spec));
    times.push_back({{"name", unit.name}, {"seconds", done.outcome.is_null() ? Json() : Json(done.seconds)}});
  }
  return times;
}

}  // namespace citylearn::paper
