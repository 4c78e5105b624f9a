// SPDX-License-Identifier: Apache-2.0
#include "bench/scale/usage.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn::scale {
namespace {

/// Returns a counter of /proc/net/snmp, where a line of numbers follows a line of names.
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
    if (colon == line.npos || line.substr(0, colon).find("net0") == line.npos) continue;
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
