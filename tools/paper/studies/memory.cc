// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/memory.h"

#include <malloc.h>
#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "core/files/files.h"
#include "core/util/error.h"
#include "env_service/environment.h"
#include "tools/lab/programs.h"

namespace citylearn::paper {
namespace {

constexpr int kEnvironments = 512, kAgents = 16;
constexpr std::chrono::seconds kWaitTimeout{60};

/// Returns the resident memory of a process.
double resident(pid_t process) {
  std::ifstream file(fmt::format("/proc/{}/statm", process));
  double pages = 0, resident = 0;
  if (!(file >> pages >> resident)) throw Error("cannot be read", fmt::format("/proc/{}/statm", process));
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double of_environments(const Traversal& traversal, int frames) {
  msg::TaskSettings settings;
  settings.task_mode() = msg::TRAIN;
  settings.frames() = static_cast<std::uint32_t>(frames);
  settings.max_steps() = static_cast<std::uint32_t>(frames);
  settings.by_reference() =
      traversal.dimension == 0 || kAgents * traversal.dimension > static_cast<int>(msg::MAX_FEATURES);
  Environment first(traversal, kAgents);
  first.reset(settings);
  malloc_trim(0);  // otherwise they would reuse memory that earlier work freed
  const double before = resident(getpid());
  std::vector<Environment> environments(kEnvironments, first);
  std::vector<msg::Observation> observations(kEnvironments);
  for (std::size_t i = 0; i < environments.size(); ++i) environments[i].observe(observations[i]);
  return (resident(getpid()) - before) / kEnvironments;
}

/// Returns the command line that hosts the traversal which `world` learns from.
std::vector<std::string> command_line(const std::string& program, const World& world) {
  const Source& source = world.source();
  std::vector<std::string> command = {program, "--dataset", source.dataset};
  if (!source.folder.empty()) command.insert(command.end(), {"--data", source.folder});
  if (const auto given = source.parameters.find(source.dataset); given != source.parameters.end())
    for (const auto& [name, value] : given->second)
      command.insert(command.end(), {"--" + source.dataset + "-" + name, fmt::format("{}", value)});
  command.insert(command.end(),
                 {"--traversal", world.train(), "--frames", fmt::format("0:{}", world.recording(world.train()).frames),
                  "--agents", std::to_string(kAgents), "--session", fmt::format("memory-{}", getpid())});
  return command;
}

double of_process(const std::string& program, const World& world) {
  const std::string log = (std::filesystem::temp_directory_path() / fmt::format("memory-{}.log", getpid())).string();
  lab::Child child(command_line(program, world), log);
  const auto take_log = [&log] {
    const std::string text = read_file(log);
    std::filesystem::remove(log);
    return text;
  };
  const Clock::time_point deadline = Clock::now() + kWaitTimeout;
  // It logs what it hosts once it is ready.
  while (read_file(log).find(" agents, hash ") == std::string::npos) {
    if (child.status() || Clock::now() > deadline)
      throw Error("did not begin: " + take_log(), "'" + program + "'", "try it by hand");
    throw_if_stopped();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const double bytes = resident(child.id());
  take_log();
  return bytes;
}

}  // namespace

std::string env_service_program() {
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return "";
  for (const char* place : {"env_service", "../../env_service/env_service"}) {  // of an installation, of a build
    const std::filesystem::path program = self.parent_path() / place;
    if (std::filesystem::is_regular_file(program, error)) return program.lexically_normal().string();
  }
  return "";
}

Unit memory_unit(const std::string& representation, const std::string& program, World& world) {
  Unit unit;
  unit.name = "memory of environments";
  unit.spec = {{"kind", "memory"},
               {"representation", representation},
               {"recording", world.hash(world.train())},
               {"environments", kEnvironments},
               {"process", !program.empty()}};
  unit.seconds = 2;
  unit.compute = [representation, program, &world]() -> Json {
    const Traversal& traversal = world.traversal(representation, world.train());
    const double environment = of_environments(traversal, std::min(128, world.frames()));
    return {{"environments", kEnvironments},
            {"agents", kAgents},
            {"bytes",
             {{"environment", environment}, {"process", program.empty() ? Json() : Json(of_process(program, world))}}}};
  };
  return unit;
}

}  // namespace citylearn::paper
