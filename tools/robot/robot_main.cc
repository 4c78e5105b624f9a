// SPDX-License-Identifier: Apache-2.0
// citylearn robot: a simulated robot in the drawn city, which speaks the messages of ROS 2.
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>

#include "core/util/text.h"
#include "core/wire/service.h"
#include "tools/robot/simulated_robot.h"

namespace {

using namespace citylearn;

struct CommandLine {
  SimulatedRobotOptions robot;
  Ros2Options ros = ros2_defaults();
};

void add_options(CLI::App& app, CommandLine& line) {
  SimulatedRobotOptions& robot = line.robot;
  const CLI::Range share(0.0, 1.0);
  {
    const OptionGroup city(app, "City");
    app.add_option("--look", robot.look, "Season, weather and light: " + joined(drawn_names()))
        ->capture_default_str()
        ->check(CLI::IsMember(drawn_names()));
    app.add_option("--metres", robot.metres, "Length of the route")->capture_default_str()->check(CLI::Range(1.0, 1e5));
    app.add_option("--city", robot.drawn.seed, "Seed of the city")->capture_default_str();
  }
  {
    const OptionGroup group(app, "Robot");
    app.add_option("--drive", robot.drive, "Drive to the end at this speed (m/s) and end, instead of by commands")
        ->check(CLI::Range(0.01, 100.0));
    app.add_option("--rate", robot.rate, "Pictures and positions a second")
        ->capture_default_str()
        ->check(CLI::Range(0.1, 200.0));
    app.add_option("--slip", robot.slip, "Wheels slip: standard deviation of the way driven, as a share of it")
        ->capture_default_str()
        ->check(share);
    app.add_option("--position-noise", robot.position_noise, "Standard deviation of the poses, metres")
        ->capture_default_str()
        ->check(CLI::Range(0.0, 100.0));
    app.add_option("--lost", robot.lost, "Share of pictures that are lost")->capture_default_str()->check(share);
    app.add_option("--repeated", robot.repeated, "Share that comes twice")->capture_default_str()->check(share);
    app.add_option("--late", robot.late, "Share that comes after the next one")->capture_default_str()->check(share);
    app.add_option("--seed", robot.seed, "Seed of slips, noise and faults")->capture_default_str();
  }
  const OptionGroup group(app, "ROS 2");
  const auto topic = [&app](const char* option, std::string& name, const char* help) {
    app.add_option(option, name, help)->capture_default_str()->type_name("TOPIC");
  };
  topic("--camera", robot.camera, "Pictures, sensor_msgs/CompressedImage");
  topic("--odometry", robot.odometry, "Way by its wheels, nav_msgs/Odometry: slips mislead it");
  topic("--pose", robot.pose, "Position as measured from outside, geometry_msgs/PoseStamped");
  topic("--cmd-vel", robot.cmd_vel, "Commands, geometry_msgs/Twist");
  add_ros2_options(app, line.ros);
}

int drive(const CommandLine& line) {
  Ros2Participant ros(line.ros, "simulated_robot", nullptr);
  SimulatedRobot robot(line.robot, ros);
  spdlog::info("a robot in {}, on {} m of road, in domain {} of ROS 2 over {}", line.robot.look, line.robot.metres,
               line.ros.domain, line.ros.name);
  while (!stop_requested() && !robot.at_end()) {
    robot.advance(Clock::now());
    ros.wait(robot.due());
    for (const std::string& fault : ros.poll()) spdlog::error("{}", fault);
  }
  spdlog::info("the robot ends at {:.1f} m; {} pictures", robot.metres(), robot.pictures());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line;
  return service_main(
      argc, argv, "A simulated robot in the drawn city. It hears and speaks the messages of ROS 2.",
      [&](CLI::App& app) { add_options(app, line); }, [&] { return drive(line); });
}
