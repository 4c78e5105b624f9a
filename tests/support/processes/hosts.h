// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/processes/service.h"

namespace citylearn::testing {

/// Returns what a shell command prints, without the last line end. Throws Error when it fails.
inline std::string shell(const std::string& command) {
  FILE* pipe = ::popen(("{ " + command + "\n} 2>&1").c_str(), "re");
  if (!pipe) throw Error("cannot start a shell", command);
  std::string output;
  char buffer[4096];
  while (const std::size_t count = std::fread(buffer, 1, sizeof buffer, pipe)) output.append(buffer, count);
  while (!output.empty() && output.back() == '\n') output.pop_back();
  if (::pclose(pipe) != 0) throw Error(output, command.substr(0, command.find('\n')));
  return output;
}

/// Hosts that can be cut off: network namespaces, each with an interface ("net0", "net1" ...) to every network. A
/// network is a bridge; all bridges and what they drop stand in one more namespace, so nothing of the machine's own
/// network is touched. Multicast does not pass. Everything goes with this object, or, when the test was killed, with
/// the next one made.
class Hosts {
 public:
  explicit Hosts(int hosts, int networks = 1) : networks_(networks) {
    clear_leftovers();
    try {
      add(bridges());
      for (int network = 0; network < networks; ++network)
        shell("ip -n " + bridges() + " link add br" + std::to_string(network) +
              " type bridge forward_delay 0 mcast_snooping 0\nip -n " + bridges() + " link set br" +
              std::to_string(network) + " up");
      for (int host = 0; host < hosts; ++host) {
        add(name(host));
        std::string batch = "link set lo up\n";
        for (int network = 0; network < networks; ++network) {
          const std::string end = interface(network);
          shell("ip -n " + bridges() + " link add " + port(host, network) + " type veth peer name " + end + " netns " +
                name(host) + " && ip -n " + bridges() + " link set " + port(host, network) + " master br" +
                std::to_string(network) + " up");
          batch += "addr add " + address(host, network) + "/24 dev " + end + "\nlink set " + end + " up\n";
        }
        shell("ip -n " + name(host) + " -batch - <<'END'\n" + batch + "END");
      }
      apply();
    } catch (...) {
      clear(prefix());
      throw;
    }
  }
  ~Hosts() { clear(prefix()); }
  Hosts(const Hosts&) = delete;
  Hosts& operator=(const Hosts&) = delete;

  /// Why hosts cannot be made here, for GTEST_SKIP; empty when they can.
  static std::string unavailable() {
    static const std::string reason = [] {
      try {
        Hosts probe(1);
        probe.lose(1);
      } catch (const Error& error) {
        return "no network namespaces with bridge and nft here (root, iproute2, nftables): " +
               std::string(error.what());
      }
      return std::string();
    }();
    return reason;
  }

  static std::string interface(int network = 0) { return "net" + std::to_string(network); }
  static std::string address(int host, int network = 0) {
    return "10.77." + std::to_string(network) + "." + std::to_string(host + 1);
  }

  /// A program of the project, running on a host.
  std::unique_ptr<Service> start(int host, std::vector<std::string> command, const std::string& output) const {
    const std::vector<std::string> there = {ip(), "netns", "exec", name(host)};
    command.insert(command.begin(), there.begin(), there.end());
    return std::make_unique<Service>(command, output);
  }
  /// Moves the calling thread, and those it starts from here on, to a host. Throws Error.
  void enter(int host) const {
    const std::string path = "/run/netns/" + name(host);
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    const bool entered = file >= 0 && ::setns(file, CLONE_NEWNET) == 0;
    if (file >= 0) ::close(file);
    if (!entered) throw Error("cannot be entered", path);
  }
  /// Returns what a shell command prints on a host.
  std::string run(int host, const std::string& command) const {
    return shell("ip netns exec " + name(host) + " " + command);
  }

  /// Each packet is dropped with this probability, whichever way it goes.
  void lose(int percent) {
    percent_ = percent;
    apply();
  }
  /// Nothing passes between these two.
  void cut(int a, int b) {
    cuts_.emplace_back(a, b);
    apply();
  }
  /// Nothing but ARP passes to and from this one: a firewall that drops.
  void wall_off(int host) {
    walls_.push_back(host);
    apply();
  }
  void heal() {
    cuts_.clear();
    walls_.clear();
    apply();
  }
  /// Packets that a host's interface has sent and received.
  long packets(int host, int network) const {
    const std::string folder = "/sys/class/net/" + interface(network) + "/statistics/";
    std::istringstream counts(run(host, "cat " + folder + "tx_packets " + folder + "rx_packets"));
    long sent = 0, received = 0;
    counts >> sent >> received;
    return sent + received;
  }

 private:
  static constexpr const char* kPrefix = "citylearn-";
  static std::string prefix() { return kPrefix + std::to_string(::getpid()) + "-"; }
  static std::string bridges() { return prefix() + "bridges"; }
  static std::string name(int host) { return prefix() + std::to_string(host); }
  static std::string port(int host, int network) { return "h" + std::to_string(host) + "n" + std::to_string(network); }
  static std::string ip() {
    for (const char* path : {"/usr/sbin/ip", "/usr/bin/ip", "/sbin/ip"})
      if (::access(path, X_OK) == 0) return path;
    throw Error("is not installed", "ip");
  }

  static void add(const std::string& name) {
    shell("ip netns add " + name);
    // Its own announcements would count as packets. A kernel without IPv6 has none.
    shell("ip netns exec " + name +
          " sh -c 'cd /proc/sys/net/ipv6/conf || exit 0; echo 1 >all/disable_ipv6; echo 1 >default/disable_ipv6'");
  }

  void apply() const {
    std::string rules = "flush ruleset\ntable bridge hosts {\nchain forward {\ntype filter hook forward priority 0;\n";
    rules += "ip daddr 224.0.0.0/4 drop\n";
    for (const auto& [a, b] : cuts_)
      for (int network = 0; network < networks_; ++network)
        for (const auto& [from, to] : {std::pair{a, b}, {b, a}})
          rules += "iifname " + port(from, network) + " oifname " + port(to, network) + " drop\n";
    for (const int host : walls_)
      for (int network = 0; network < networks_; ++network)
        for (const char* way : {"iifname ", "oifname "})
          rules += "meta protocol ip " + (way + port(host, network)) + " drop\n";
    if (percent_ > 0) rules += "meta protocol ip numgen random mod 100 < " + std::to_string(percent_) + " drop\n";
    shell("ip netns exec " + bridges() + " nft -f - <<'END'\n" + rules + "}\n}\nEND");
  }

  /// Returns the namespaces whose names begin so. They are listed first: deleting while listing skips some.
  static std::vector<std::string> namespaces(const std::string& prefix) {
    std::vector<std::string> names;
    std::error_code none;
    for (const auto& entry : std::filesystem::directory_iterator("/run/netns", none))
      if (const std::string name = entry.path().filename(); name.starts_with(prefix)) names.push_back(name);
    return names;
  }
  static void clear(const std::string& prefix) {
    for (const std::string& name : namespaces(prefix)) {
      // What a killed test left running there would keep the namespace alive.
      const std::string script = "for p in $(ip netns pids " + name + "); do kill -9 $p; done; ip netns del " + name;
      try {
        shell(script);
      } catch (const Error&) {
        continue;  // another test clears it at this moment
      }
    }
  }
  static void clear_leftovers() {
    for (const std::string& name : namespaces(kPrefix)) {
      const int process = std::atoi(name.c_str() + std::string_view(kPrefix).size());
      if (process > 0 && ::kill(process, 0) != 0 && errno == ESRCH) clear(kPrefix + std::to_string(process) + "-");
    }
  }

  const int networks_;
  int percent_ = 0;
  std::vector<std::pair<int, int>> cuts_;
  std::vector<int> walls_;
};

}  // namespace citylearn::testing
