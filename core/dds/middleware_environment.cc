// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <filesystem>

#include "core/dds/middleware_internal.h"

namespace citylearn::internal {
namespace {

struct Variable {
  const char* name;
  const char* effect;               // of the variable here, for people
  const char* meanwhile = nullptr;  // its value while a vendor starts; by default it has none
};

constexpr const char* kServers = "ROS_DISCOVERY_SERVER";
constexpr const char* kNoProfiles = "ignored; profiles of Fast DDS do not apply";

// Those that Fast DDS 2.9 to 3.2, Cyclone DDS 0.10 and ROS 2 know. Fast DDS remembers its servers within a process, and
// forgets them when the variable is empty.
constexpr Variable kVariables[] = {
    {kServers, "ignored, but by what meets nodes of ROS 2 over fastdds; services have --discovery-server", ""},
    {"ROS_SUPER_CLIENT", "ignored"},
    {"ROS2_EASY_MODE", "ignored; services have --discovery-server"},
    {"FASTDDS_ENVIRONMENT_FILE", "ignored"},
    {"FASTRTPS_DEFAULT_PROFILES_FILE", kNoProfiles},
    {"FASTDDS_DEFAULT_PROFILES_FILE", kNoProfiles},
    {"SKIP_DEFAULT_XML_FILE", kNoProfiles, "1"},
    {"SKIP_DEFAULT_XML", kNoProfiles, "1"},
    {"FASTDDS_BUILTIN_TRANSPORTS", "ignored; services use UDP on --interface"},
    {"FASTDDS_STATISTICS", "ignored"},
    {"CYCLONEDDS_URI", "ignored; services have --interface, --peers and --domain"},
    {"ROS_DOMAIN_ID", "the default of --ros-domain; services have --domain"},
    {"ROS_DISTRO", "the default of --ros-distro"},
    {"ROS_LOCALHOST_ONLY", "ignored; say --ros-interface lo"},
    {"ROS_AUTOMATIC_DISCOVERY_RANGE", "ignored; say --ros-interface"},
    {"ROS_STATIC_PEERS", "ignored; say --ros-peers"},
    {"RMW_IMPLEMENTATION", "ignored; say --ros-middleware"},
};

void set(const char* name, const char* value) { value ? setenv(name, value, 1) : unsetenv(name); }

}  // namespace

ForeignVariables::ForeignVariables(bool ros2) {
  for (const Variable& variable : kVariables) {
    if (ros2 && variable.name == kServers) continue;
    const char* value = std::getenv(variable.name);
    before_.emplace_back(variable.name, value ? std::optional<std::string>(value) : std::nullopt);
    set(variable.name, variable.meanwhile);
  }
}

ForeignVariables::~ForeignVariables() {
  for (const auto& [name, value] : before_) set(name, value ? value->c_str() : nullptr);
}

std::vector<std::string> ForeignVariables::found() {
  std::vector<std::string> lines;
  for (const Variable& variable : kVariables)
    if (std::getenv(variable.name)) lines.push_back(std::string(variable.name) + " is set: " + variable.effect);
  for (const char* file : {"DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml"})
    if (std::filesystem::exists(file)) lines.push_back(std::string(file) + " is in this folder: " + kNoProfiles);
  return lines;
}

}  // namespace citylearn::internal
