// SPDX-License-Identifier: Apache-2.0
// citylearn teach: records what a robot sees along a route.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <limits>
#include <utility>

#include "core/wire/service.h"
#include "tools/robot/teacher.h"

namespace {

using namespace citylearn;

struct CommandLine {
  TeachOptions teach;
  Ros2Options ros = ros2_defaults();
  int frames = std::numeric_limits<int>::max();
};

void add_options(CLI::App& app, CommandLine& line) {
  TeachOptions& teach = line.teach;
  {
    const OptionGroup group(app, "Recording");
    app.add_option("--output", teach.folder,
                   "Folder of recordings, DIR: the frames go to DIR/NAME/, their places to "
                   "DIR/NAME.poses.csv")
        ->type_name("DIR")
        ->required();
    app.add_option("--traversal", teach.traversal, "Its name, NAME: \"summer\"")->type_name("NAME")->required();
    app.add_option("--spacing", teach.spacing, "Metres from one frame to the next, with --position")
        ->capture_default_str()
        ->check(CLI::Range(0.05, 1000.0));
    app.add_option("--interval", teach.interval, "Seconds from one frame to the next, without --position")
        ->capture_default_str()
        ->check(CLI::Range(0.01, 3600.0));
    app.add_option("--frames", line.frames, "End after so many frames; without, Ctrl-C ends it")
        ->check(CLI::Range(2, std::numeric_limits<int>::max()));
    app.add_flag("--start-paused", teach.paused, "Record only once a node calls ~/record (std_srvs/SetBool) with true");
  }
  const OptionGroup group(app, "Robot");
  add_robot_topics(app, teach.topics, line.ros);
}

int teach(const CommandLine& line) {
  using std::chrono::seconds;
  Ros2Participant ros(line.ros, "teach", nullptr);
  Teacher teacher(line.teach, ros);
  spdlog::info("listens to {} in domain {} of ROS 2 over {}", line.teach.topics.camera, line.ros.domain, line.ros.name);
  Clock::time_point next_report = Clock::now() + seconds(2);
  int reported = -1, cameras = 0;
  while (!stop_requested() && teacher.frames() < line.frames) {
    ros.wait(Clock::now() + std::chrono::milliseconds(20));
    teacher.poll();
    for (const std::string& fault : ros.poll()) spdlog::error("{}", fault);
    if (std::exchange(cameras, teacher.senses().cameras()) != teacher.senses().cameras())
      spdlog::log(cameras > 1 ? spdlog::level::warn : spdlog::level::info, "listens to {} camera{} on {}", cameras,
                  cameras == 1 ? "" : "s", line.teach.topics.camera);
    if (Clock::now() < next_report) continue;
    next_report = Clock::now() + seconds(2);
    if (teacher.frames() > 0 && teacher.frames() != reported) spdlog::info("{} frames", reported = teacher.frames());
    if (const std::string trouble = teacher.trouble(Clock::now()); !trouble.empty()) spdlog::warn("{}", trouble);
  }
  const MessageFaults& pictures = teacher.senses().picture_faults();
  const std::string route = line.teach.folder + "/" + line.teach.traversal;
  spdlog::info("{} frames in {}; of {} pictures, {} were not used", teacher.frames(), route, pictures.came(),
               pictures.came() - pictures.used());
  if (teacher.frames() < 2)
    throw Error("has " + std::to_string(teacher.frames()) + " frames; a route needs 2", route, teacher.why_no_route());
  for (const std::string& shortcoming : teacher.shortcomings()) spdlog::warn("{}", shortcoming);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "Records what a robot's camera sees along a route, as a traversal of dataset plain.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return teach(line); });
}
