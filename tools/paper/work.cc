#include "tools/paper/work.h"

#include <openssl/sha.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "core/files.h"
#include "core/middleware.h"
#include "core/service.h"
#include "tools/vpr/progress.h"

namespace citylearn::paper {
namespace {

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

std::string digest(const std::string& text) {
  unsigned char bytes[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(text.data()), text.size(), bytes);
  std::string result;
  for (int i = 0; i < 10; ++i) result += fmt::format("{:02x}", bytes[i]);
  return result;
}

/// What an earlier run left; null when it left nothing, or something that cannot be read.
Json read_outcome(const std::string& path, const Json& spec) {
  std::ifstream file(path);
  if (!file) return nullptr;
  const Json stored = Json::parse(file, nullptr, /*allow_exceptions=*/false);
  if (!stored.is_object() || !stored.contains("outcome") || stored.value("spec", Json()) != spec) {
    spdlog::warn("{} is not an outcome of this program: done again", path);
    return nullptr;
  }
  return stored["outcome"];
}

}  // namespace

Work::Work(std::string folder) : folder_(std::move(folder)) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) throw Error("cannot create '" + folder_ + "': " + error.message(), "--output");
}

std::string Work::path_of(const Json& spec) const {
  return folder_ + "/" + digest(spec.dump() + "#" + std::to_string(kVersion)) + ".json";
}

void Work::add(Unit unit) {
  if (outcomes_.try_emplace(path_of(unit.spec)).second) units_.push_back(std::move(unit));
}

bool Work::run() {
  std::vector<const Unit*> open;
  double left = 0;
  for (const Unit& unit : units_) {
    const std::string path = path_of(unit.spec);
    Json& outcome = outcomes_[path];
    if (outcome.is_null()) outcome = read_outcome(path, unit.spec);
    if (!outcome.is_null()) continue;
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
    const double slowness = guessed > 0 ? taken / guessed : 1;
    spdlog::info("[{} of {}, {} left] {}", i + 1, open.size(), vpr::clock_time(left * slowness), unit.name);
    const Clock::time_point start = Clock::now();
    try {
      const Json outcome = unit.compute();
      const std::string path = path_of(unit.spec);
      write_file(path, Json{{"spec", unit.spec}, {"outcome", outcome}}.dump() + "\n");
      outcomes_[path] = outcome;
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
  return found == outcomes_.end() ? none : found->second;
}

}  // namespace citylearn::paper
