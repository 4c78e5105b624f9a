// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/manifest.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <Eigen/Core>
#include <fstream>
#include <thread>

#include "core/plugin/plugins.h"
#include "core/util/version.h"
#include "core/util/wall_clock.h"

namespace citylearn::paper {
namespace {

Json machine() {
  std::string model = "unknown", line;
  for (std::ifstream file("/proc/cpuinfo"); std::getline(file, line);)
    if (const std::size_t colon = line.find(": "); line.starts_with("model name") && colon != line.npos) {
      model = line.substr(colon + 2);
      break;
    }
  return {{"processors", std::thread::hardware_concurrency()},
          {"model", model},
          {"memory", static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE))},
          {"instructions", Eigen::SimdInstructionSetsInUse()}};
}

Json data_of(World& world) {
  Json traversals = Json::object();
  for (const std::string& name : world.names()) {
    const Traversal& traversal = world.recording(name);
    traversals[name] = {{"condition", traversal.condition},
                        {"frames", traversal.frames},
                        {"features", traversal.dimension},
                        {"hash", fmt::format("{:016x}", world.hash(name))}};
  }
  return {{"dataset", world.dataset()}, {"drawn", world.drawn()}, {"train", world.train()}, {"traversals", traversals}};
}

}  // namespace

std::string manifest_of(const Context& context, const std::string& command, std::time_t begun, double seconds) {
  Json data = Json::array({data_of(context.world)});
  if (&context.drawn != &context.world) data.push_back(data_of(context.drawn));
  const Json manifest = {{"program", "citylearn_paper " + version()},
                         {"compiler", __VERSION__},
                         {"plugins", loaded_plugins()},
                         {"machine", machine()},
                         {"command", command},
                         {"begun", date_of(begun)},
                         {"seconds", seconds},
                         {"quick", context.quick},
                         {"effort", context.effort},
                         {"seeds", context.seeds},
                         {"frames", context.frames},
                         {"data", data},
                         {"work", context.work.times()}};
  return manifest.dump(2) + "\n";
}

}  // namespace citylearn::paper
