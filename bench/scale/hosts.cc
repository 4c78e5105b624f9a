// SPDX-License-Identifier: Apache-2.0
#include "bench/scale/hosts.h"

#include <fcntl.h>
#include <sched.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/files/files.h"
#include "core/util/error.h"

extern char** environ;

namespace citylearn::scale {
namespace {

const char* const kIp = "/usr/sbin/ip";

bool ip(const std::string& arguments, bool quiet = false) {
  std::vector<std::string> words{kIp};
  std::istringstream in(arguments);
  for (std::string word; in >> word;) words.push_back(word);
  std::vector<char*> command;
  for (std::string& word : words) command.push_back(word.data());
  command.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (quiet) posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  pid_t process = 0;
  const int failed = posix_spawn(&process, kIp, &actions, nullptr, command.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  int status = -1;
  return failed == 0 && waitpid(process, &status, 0) == process && status == 0;
}

void require_ip(const std::string& arguments) {
  if (!ip(arguments)) throw Error("failed", "ip " + arguments, "run as root, with iproute2 installed");
}

/// Of /proc/net/snmp: a line of names, then one of numbers.
double snmp(const std::string& text, const std::string& protocol, const std::string& wanted) {
  std::istringstream lines(text);
  std::string names, numbers;
  while (std::getline(lines, names)) {
    if (names.rfind(protocol + ":", 0) != 0 || !std::getline(lines, numbers)) continue;
    std::istringstream name(names), number(numbers);
    for (std::string each, value; name >> each && number >> value;)
      if (each == wanted) return std::stod(value);
  }
  throw Error("has no " + protocol + " " + wanted, "/proc/net/snmp");
}

}  // namespace

Hosts::Hosts(int count) : prefix_("clscale-" + std::to_string(getpid()) + "-"), count_(count) {
  if (count > 250) throw Error("at most 250 hosts, not " + std::to_string(count));
  try {
    const std::string hub = prefix_ + "hub";
    require_ip("netns add " + hub);
    require_ip("-n " + hub + " link add br0 type bridge");
    require_ip("-n " + hub + " link set br0 up");
    for (int host = 0; host < count; ++host) {
      const std::string end = "v" + std::to_string(host);
      require_ip("netns add " + name(host));
      require_ip("-n " + hub + " link add " + end + " type veth peer name eth0 netns " + name(host));
      require_ip("-n " + hub + " link set " + end + " master br0 up");
      require_ip("-n " + name(host) + " addr add " + address(host) + "/24 dev eth0");
      require_ip("-n " + name(host) + " link set lo up");
      require_ip("-n " + name(host) + " link set eth0 up");
    }
  } catch (...) {
    remove();
    throw;
  }
}

Hosts::~Hosts() { remove(); }

void Hosts::remove() {
  for (int host = 0; host < count_; ++host) ip("netns del " + name(host), true);
  ip("netns del " + prefix_ + "hub", true);
}

std::string Hosts::name(int host) const { return prefix_ + std::to_string(host); }

std::vector<std::string> Hosts::on(int host, std::vector<std::string> command) const {
  command.insert(command.begin(), {kIp, "netns", "exec", name(host)});
  return command;
}

void Hosts::enter(int host) const {
  const std::string path = "/run/netns/" + name(host);
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool entered = file >= 0 && setns(file, CLONE_NEWNET) == 0;
  const int error = errno;
  if (file >= 0) close(file);
  if (!entered) throw Error(std::strerror(error), path);
}

const std::vector<double Usage::*>& Usage::fields() {
  static const std::vector<double Usage::*> all = {&Usage::main,           &Usage::others,
                                                   &Usage::main_sleeps,    &Usage::others_sleeps,
                                                   &Usage::sent_bytes,     &Usage::received_bytes,
                                                   &Usage::sent_packets,   &Usage::received_packets,
                                                   &Usage::sent_datagrams, &Usage::received_datagrams,
                                                   &Usage::lost_datagrams, &Usage::resident};
  return all;
}

Usage& Usage::operator+=(const Usage& other) {
  for (double Usage::*field : fields()) this->*field += other.*field;
  return *this;
}

Usage& Usage::operator*=(double factor) {
  for (double Usage::*field : fields()) this->*field *= factor;
  return *this;
}

Usage& Usage::operator-=(const Usage& other) {
  Usage negative = other;
  negative *= -1;
  return *this += negative;
}

Usage usage_of(int process) {
  const std::string folder = "/proc/" + std::to_string(process);
  Usage usage;
  for (const auto& task : std::filesystem::directory_iterator(folder + "/task")) {
    std::ifstream in(task.path() / "schedstat");
    double nanoseconds = 0;
    if (!(in >> nanoseconds)) continue;  // it has just ended
    const bool main = task.path().filename() == std::to_string(process);
    (main ? usage.main : usage.others) += nanoseconds / 1e9;
    std::ifstream status(task.path() / "status");
    for (std::string word; status >> word;)
      if (double times = 0; word == "voluntary_ctxt_switches:" && status >> times)
        (main ? usage.main_sleeps : usage.others_sleeps) += times;
  }
  std::istringstream interfaces(read_file(folder + "/net/dev"));
  for (std::string line; std::getline(interfaces, line);) {
    const std::size_t colon = line.find(':');
    if (colon == line.npos || line.substr(0, colon).find("eth0") == line.npos) continue;
    double number[16];
    std::istringstream numbers(line.substr(colon + 1));
    for (double& each : number) numbers >> each;
    usage.received_bytes = number[0], usage.received_packets = number[1];
    usage.sent_bytes = number[8], usage.sent_packets = number[9];
  }
  const std::string counters = read_file(folder + "/net/snmp");
  usage.sent_datagrams = snmp(counters, "Udp", "OutDatagrams");
  usage.received_datagrams = snmp(counters, "Udp", "InDatagrams");
  usage.lost_datagrams = snmp(counters, "Udp", "RcvbufErrors");
  std::ifstream statm(folder + "/statm");
  double pages = 0, resident = 0;
  if (statm >> pages >> resident) usage.resident = resident * static_cast<double>(sysconf(_SC_PAGESIZE));
  return usage;
}

double idle_processor_seconds() {
  std::istringstream in(read_file("/proc/stat"));
  std::string name;
  double user, nice, system, idle, waiting;
  in >> name >> user >> nice >> system >> idle >> waiting;
  return (idle + waiting) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

}  // namespace citylearn::scale
