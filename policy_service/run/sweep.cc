// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/sweep.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <charconv>
#include <exception>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/records/output_folder.h"
#include "policy_service/records/report.h"
#include "policy_service/results/comparison.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxSeeds = 1000;

/// Throws Error unless the manifest of a finished seed agrees with the present options.
void require_same_run(const std::string& folder, const PolicyServiceOptions& options) {
  const std::string path = folder + "/manifest.json";
  const auto found = parse_json_or_null<Json>(read_file(path));
  if (!found.is_object()) throw Error("is not JSON", path, "choose another --output or leave --resume out");
  const auto wanted = manifest_json(options, {}, {}, "", 0);
  const auto refuse = [&path](const std::string& what, const Json& was, const Json& is) {
    throw Error(what + " was " + was.dump() + ", is " + is.dump(), path,
                "choose another --output or leave --resume out");
  };
  for (const char* field : {"agent", "learner", "seed", "train", "evaluate", "first_frame", "frames", "max_steps",
                            "curriculum", "steps", "time_limit", "stop_when", "tasks", "controls"}) {
    const bool capped = options.cap_frames && (std::string(field) == "frames" || std::string(field) == "max_steps");
    if (const Json was = found.value(field, Json()); was != wanted[field] && !capped) refuse(field, was, wanted[field]);
  }
  const Json parameters = found.value("parameters", Json::object());
  for (const auto& [part, given] :
       {std::pair{"network", &options.network_parameters}, std::pair{"learner", &options.learner_parameters},
        std::pair{"trainer", &options.trainer_parameters}})
    for (const auto& [name, value] : *given)
      if (const Json was = parameters.value(part, Json::object()).value(name, Json()); was != Json(value))
        refuse(name, was, value);
}

}  // namespace

std::vector<std::uint64_t> parse_seeds(const std::string& text) {
  const auto refuse = [&text](const std::string& what) {
    throw Error("'" + text + "' " + what, "seeds", "write 1..5 or 1,3,7");
  };
  const auto number = [&](std::string_view digits) {
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (error != std::errc() || end != digits.data() + digits.size())
      refuse("has '" + std::string(digits) + "' in the place of a number");
    return value;
  };
  std::vector<std::uint64_t> seeds;
  std::set<std::uint64_t> known;
  const std::string_view all = text;
  for (std::size_t begin = 0; begin <= all.size();) {
    const std::size_t end = std::min(all.find(',', begin), all.size());
    const std::string_view part = all.substr(begin, end - begin);
    const std::size_t dots = part.find("..");
    const std::uint64_t first = number(part.substr(0, dots));
    const std::uint64_t last = dots == std::string_view::npos ? first : number(part.substr(dots + 2));
    if (last < first) refuse("goes down");
    if (last - first >= kMaxSeeds || seeds.size() + (last - first) >= kMaxSeeds)
      refuse("has more than " + std::to_string(kMaxSeeds) + " seeds");
    for (std::uint64_t i = 0; i <= last - first; ++i) {
      if (!known.insert(first + i).second) refuse("names " + std::to_string(first + i) + " twice");
      seeds.push_back(first + i);
    }
    begin = end + 1;
  }
  return seeds;
}

int run_sweep(const PolicyServiceOptions& given, const std::vector<std::uint64_t>& seeds) {
  if (given.mode != "train") throw Error("only for --mode train", "--seeds");
  if (given.role != "both") throw Error("is for --role both", "--seeds");
  if (given.output.empty()) throw Error("needs --output", "--seeds", "each seed has a folder there");
  if (given.ranks_domain) throw Error("not with --seeds", "--ranks-domain", "start a run for each seed");
  const PolicyServiceOptions options = checked_options(given);
  const auto of_seed = [&options](std::uint64_t seed) {
    PolicyServiceOptions one = options;
    one.seed = seed;
    for (OptionValue& option : one.configuration)
      if (option.name == "--seed") option.origin = "option --seeds";
    one.output = options.output + "/seed-" + std::to_string(seed);
    return one;
  };
  const OutputFolder folder(options.output);
  const std::string joint = options.output + "/sweep.json";
  if (std::error_code none; !options.resume && !options.overwrite && fs::exists(joint, none))
    throw Error("belongs to an earlier sweep", joint,
                "continue it with --resume, replace it with --overwrite, or choose another --output");
  for (const std::uint64_t seed : seeds) require_no_other_run(of_seed(seed));  // before the first one begins
  std::set<std::uint64_t> complete;
  for (const std::uint64_t seed : seeds) {
    const PolicyServiceOptions one = of_seed(seed);
    const std::string summary = one.output + "/summary.json";
    std::error_code ignored;  // a file holds no summary
    if (!fs::exists(summary, ignored)) continue;
    if (options.resume) {
      require_same_run(one.output, one);
      complete.insert(seed);
    } else {
      fs::remove(summary, ignored);  // it would pass for this sweep's if the seed fails now
    }
  }
  Node node(options.node);
  const FinalStatusGuard final_status(node);
  EnvClient client(node, options.client);
  std::map<std::uint64_t, std::string> failed;
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    const std::uint64_t seed = seeds[i];
    if (complete.contains(seed)) {
      spdlog::info("seed {} is complete", seed);
      continue;
    }
    spdlog::info("seed {} ({} of {})", seed, i + 1, seeds.size());
    try {
      if (const int status = run_policy_service(of_seed(seed), node, client); status != 0) {
        spdlog::info("the sweep ended in seed {}", seed);
        return status;
      }
    } catch (const std::exception& error) {
      spdlog::error("seed {} failed: {}", seed, error.what());
      failed[seed] = error.what();
    }
  }
  std::vector<RunGroup> runs;
  for (const std::uint64_t seed : seeds)
    if (!failed.contains(seed)) runs.push_back(read_summary(of_seed(seed).output + "/summary.json"));
  if (!runs.empty()) {
    RunGroup group = join(runs);
    group.name = fs::path(options.output + "/").parent_path().filename().string();
    write_file(joint, sweep_json(group, failed));
    std::cout << "\n" << tables({group}) << "\n" << gain_sentence(group) << std::flush;
    spdlog::info("wrote {}", joint);
  }
  if (!failed.empty())
    throw Error(
        fmt::format("{} of {} failed: {}: {}", failed.size(), seeds.size(),
                    joined(failed, [](const auto& one) { return std::to_string(one.first); }), failed.begin()->second),
        "seeds", "--resume tries them again");
  return 0;
}

}  // namespace citylearn
