// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor/host.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

namespace citylearn::doctor {
namespace {

namespace fs = std::filesystem;

constexpr int kProbeInterval = 250;  // ms

std::string first_line(const std::string& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

/// Returns the processes that this user may look at, by the inodes of their sockets.
std::map<std::string, int> owners(const std::map<std::string, int>& wanted) {
  std::map<std::string, int> found;
  std::error_code none;
  for (const auto& process : fs::directory_iterator("/proc", none)) {
    const std::string name = process.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::error_code hidden;
    for (const auto& file : fs::directory_iterator(process.path() / "fd", hidden)) {
      const std::string target = fs::read_symlink(file.path(), hidden);
      if (!target.starts_with("socket:[")) continue;
      const std::string inode = target.substr(8, target.size() - 9);
      if (wanted.contains(inode)) found[inode] = std::stoi(name);
    }
  }
  return found;
}

}  // namespace

std::vector<Port> ports_taken(int first, int last, int but_of) {
  std::map<std::string, int> by_inode;
  std::ifstream in("/proc/net/udp");
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    // sl local_address rem_address st tx:rx tr:when retransmits uid timeout inode ...
    std::istringstream words(line);
    std::vector<std::string> fields;
    for (std::string word; words >> word;) fields.push_back(word);
    if (fields.size() < 10) continue;
    const std::size_t colon = fields[1].find(':');
    if (colon == std::string::npos) continue;
    const int port = static_cast<int>(std::strtol(fields[1].c_str() + colon + 1, nullptr, 16));
    if (port >= first && port <= last) by_inode[fields[9]] = port;
  }
  const std::map<std::string, int> processes = owners(by_inode);
  std::map<int, Port> taken;  // one socket for each interface may have the same port
  for (const auto& [inode, port] : by_inode) {
    const auto owner = processes.find(inode);
    const int process = owner == processes.end() ? 0 : owner->second;
    if (process == but_of) continue;
    taken[port] = {port, process, process ? first_line("/proc/" + std::to_string(process) + "/comm") : ""};
  }
  std::vector<Port> all;
  for (const auto& [number, port] : taken) all.push_back(port);
  return all;
}

std::vector<Limit> limits_too_small() {
  constexpr std::int64_t kBuffer = 4 << 20;
  const std::vector<Limit> needed = {
      {"net.core.rmem_max", 0, kBuffer, "bursts of large messages overrun a smaller receive buffer"},
      {"net.core.wmem_max", 0, kBuffer, "senders of large messages wait for room in a smaller one"},
      {"net.ipv4.ipfrag_high_thresh", 0, kBuffer, "packets that a narrower link cuts in pieces are put together here"},
  };
  std::vector<Limit> small;
  for (Limit limit : needed) {
    std::string path = "/proc/sys/" + limit.name;
    std::replace(path.begin() + 10, path.end(), '.', '/');
    const std::string value = first_line(path);
    if (value.empty()) continue;  // a network namespace need not show it
    limit.value = std::atoll(value.c_str());
    if (limit.value < limit.wanted) small.push_back(limit);
  }
  return small;
}

Answer probe(const std::string& from, const std::string& address, int port, int patience_ms) {
  const int handle = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in here{}, there{};
  here.sin_family = there.sin_family = AF_INET;
  inet_pton(AF_INET, from.c_str(), &here.sin_addr);
  inet_pton(AF_INET, address.c_str(), &there.sin_addr);
  there.sin_port = htons(static_cast<std::uint16_t>(port));
  Answer answer = Answer::kSilent;
  if (handle < 0 || bind(handle, reinterpret_cast<const sockaddr*>(&here), sizeof here) != 0 ||
      connect(handle, reinterpret_cast<const sockaddr*>(&there), sizeof there) != 0)
    answer = Answer::kNoHost;
  // One byte is not RTPS, so a listener drops it. A host without a listener says so (ICMP), which the socket reports.
  // Probed repeatedly, because hosts say so once a second at most, and discovery has asked at many ports before.
  for (int left = patience_ms; answer == Answer::kSilent && left > 0; left -= kProbeInterval) {
    const char byte = 0;
    char reply = 0;
    pollfd ready{handle, POLLIN, 0};
    if (::send(handle, &byte, 1, 0) < 0 ||
        (poll(&ready, 1, std::min(left, kProbeInterval)) > 0 && recv(handle, &reply, 1, MSG_DONTWAIT) < 0))
      answer = errno == ECONNREFUSED ? Answer::kRefused : Answer::kNoHost;  // EHOSTUNREACH, ENETUNREACH
  }
  if (handle >= 0) close(handle);
  if (answer != Answer::kSilent) return answer;
  // On the same network the kernel has asked for the address (ARP).
  std::ifstream neighbours("/proc/net/arp");
  std::string line;
  while (std::getline(neighbours, line)) {
    std::istringstream words(line);
    std::string who, type, flags;
    words >> who >> type >> flags;
    if (who == address && flags == "0x0") return Answer::kNoHost;
  }
  return Answer::kSilent;
}

}  // namespace citylearn::doctor
