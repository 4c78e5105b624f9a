// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/measurements.h"

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
#include "tools/lab/recognition/methods.h"

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

/// Returns the path of the env_service beside this program; empty where there is none.
std::string env_service_program() {
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  for (const char* place : {"env_service", "../../env_service/env_service"}) {  // of an installation, of a build
    const std::filesystem::path program = self.parent_path() / place;
    if (std::filesystem::is_regular_file(program, error)) return program.lexically_normal().string();
  }
  return "";
}

Json recognise(World& world, const std::string& representation, const std::string& method, const std::string& query) {
  const auto matrix = [&](const std::string& name) {
    const Traversal& traversal = world.traversal(representation, name);
    return Eigen::Map<const Eigen::MatrixXf>(traversal.features.data(), traversal.dimension, traversal.frames);
  };
  const Eigen::MatrixXf reference = matrix(world.train()), frames = matrix(query);
  const auto truth =
      GroundTruth::by_index(static_cast<int>(reference.cols()), static_cast<int>(frames.cols()), kPlaceTolerance);
  const Answers answers = lab::Method(method).run(reference, frames, truth, {}).answers;
  throw_if_stopped();
  const Interval interval = auc_interval(answers, 1);
  return {{"queries", answers.queries()},
          {"auc", precision_recall(answers).auc},
          {"auc_low", interval.low},
          {"auc_high", interval.high},
          {"recall", recall_at(answers, 1)}};
}

}  // namespace

Json add_recognition(const std::string& representation, const std::string& method, const std::string& query, Work& work,
                     World& world) {
  const double size = world.frames() / 640.0;  // each frame is a class, and an example
  const int unit = work.add({"recognition of '" + query + "' by " + representation + ", " + method,
                             {{"kind", "recognition"},
                              {"representation", representation},
                              {"method", method},
                              {"frames", world.frames()},
                              {"recordings", {world.hash(world.train()), world.hash(query)}}},
                             size * size * (method == "mlp" ? 1.5 : 0.1),
                             [=, &world] { return recognise(world, representation, method, query); }});
  return {{"representation", representation}, {"method", method}, {"query", query}, {"unit", unit}};
}

Unit memory_unit(const std::string& representation, World& world) {
  const std::string program = env_service_program();
  return {"memory of environments",
          {{"kind", "memory"},
           {"representation", representation},
           {"recording", world.hash(world.train())},
           {"environments", kEnvironments},
           {"process", !program.empty()}},
          2,
          [representation, program, &world]() -> Json {
            const Traversal& traversal = world.traversal(representation, world.train());
            const double environment = of_environments(traversal, std::min(128, world.frames()));
            const Json process = program.empty() ? Json() : Json(of_process(program, world));
            return {{"environments", kEnvironments},
                    {"agents", kAgents},
                    {"bytes", {{"environment", environment}, {"process", process}}}};
          }};
}

}  // namespace citylearn::paper
