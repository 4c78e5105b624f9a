// SPDX-License-Identifier: Apache-2.0
#include <sys/socket.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <memory>
#include <thread>

#include "bench/cases/cases.h"
#include "core/util/machine.h"
#include "dashboard/http/server.h"
#include "tests/support/web/web_client.h"

namespace citylearn::bench {
namespace {

using namespace std::chrono_literals;
using testing::WebClient;

constexpr std::size_t kScene = 64 * 6 * 4, kPicture = 20'000;
const std::string kWatch = R"({"watch": ["scene:env@run", "picture:env@run:0"]})";

/// Work of another process, which ends when this does.
class Crowd {
 public:
  explicit Crowd(const std::function<void()>& work) : process_(fork()) {
    if (process_ < 0) throw Error("cannot fork");
    if (process_ > 0) return;
    try {
      work();
    } catch (const std::exception& error) {
      std::cerr << "bench_cases live: a client: " << error.what() << "\n";
    }
    _exit(0);
  }
  ~Crowd() {
    kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
  }
  Crowd(const Crowd&) = delete;
  Crowd& operator=(const Crowd&) = delete;

 private:
  pid_t process_;
};

/// Reads from all sockets, for ever.
void drain(const std::vector<int>& sockets) {
  std::vector<pollfd> ready;
  for (const int one : sockets) ready.push_back({one, POLLIN, 0});
  std::vector<char> bytes(1 << 16);
  while (::poll(ready.data(), ready.size(), -1) > 0)
    for (pollfd& one : ready)
      if (one.revents && ::recv(one.fd, bytes.data(), bytes.size(), 0) <= 0) one.fd = -1;
}

/// Connects `count` clients and reads what all of them watch.
void watch(std::uint16_t port, int count) {
  std::vector<std::unique_ptr<WebClient>> clients;
  std::vector<int> sockets;
  for (int i = 0; i < count; ++i) {
    clients.push_back(std::make_unique<WebClient>(port));
    clients.back()->upgrade();
    clients.back()->say(kWatch);
    sockets.push_back(clients.back()->descriptor());
  }
  drain(sockets);
}

void publish(ClientHub& hub) {
  hub.publish("scene:env@run", {{"traversal", "summer"}, {"agents", 64}}, std::vector<std::byte>(kScene),
              Hub::Merge::kReplace);
  hub.publish("picture:env@run:0", {{"hash", "00112233445566aa"}, {"frame", 7}}, std::vector<std::byte>(kPicture),
              Hub::Merge::kReplace);
}

struct Rate {
  double each_second = 0;
  double longest_ms = 0;
};

/// Publishes every `period` for `duration`.
Rate publish_for(ClientHub& hub, std::chrono::microseconds period, std::chrono::seconds duration) {
  const auto begin = Clock::now();
  Rate rate;
  int count = 0;
  for (auto next = begin; next < begin + duration; next += period) {
    std::this_thread::sleep_until(next);
    const auto before = Clock::now();
    publish(hub);
    rate.longest_ms =
        std::max(rate.longest_ms, std::chrono::duration<double, std::milli>(Clock::now() - before).count());
    ++count;
  }
  rate.each_second = count / seconds_since(begin);
  return rate;
}

void wait_for(const std::function<bool()>& condition) {
  if (!testing::poll_until(condition, 20s)) throw Error("the clients do not connect");
}

/// Returns the share of a core that a bare loop needs to write the same bytes to as many sockets.
double bare_share(int clients, std::chrono::seconds duration) {
  std::vector<int> ours, theirs;
  for (int i = 0; i < clients; ++i) {
    const int listener = ::socket(AF_INET, SOCK_STREAM, 0), one = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener, reinterpret_cast<const sockaddr*>(&address), size) != 0 || ::listen(listener, 1) != 0 ||
        ::getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size) != 0 ||
        ::connect(one, reinterpret_cast<const sockaddr*>(&address), size) != 0)
      throw Error("cannot open sockets");
    ours.push_back(::accept(listener, nullptr, nullptr));
    theirs.push_back(one);
    ::close(listener);
  }
  const Crowd readers([&] { drain(theirs); });
  const std::vector<char> scene(kScene + 200), picture(kPicture + 200);
  const double before = process_use().processor_seconds;
  const auto begin = Clock::now();
  for (auto next = begin; next < begin + duration; next += 100ms) {
    std::this_thread::sleep_until(next);
    for (const int one : ours)
      if (::send(one, scene.data(), scene.size(), MSG_NOSIGNAL) < 0 ||
          ::send(one, picture.data(), picture.size(), MSG_NOSIGNAL) < 0)
        throw Error("cannot send");
  }
  const double share = (process_use().processor_seconds - before) / seconds_since(begin);
  for (const int one : ours) ::close(one);
  for (const int one : theirs) ::close(one);
  return share;
}

void measure(int clients, std::chrono::seconds duration) {
  const double bare = bare_share(clients, duration);

  ClientHub hub({.linger = 0ms});
  ServerOptions options;
  options.port = 0;
  const Server server(options, hub, {});
  {
    const Crowd crowd([&] { watch(server.port(), clients); });
    wait_for([&] { return hub.counts().clients == static_cast<std::size_t>(clients) && hub.watched().size() == 2; });
    const auto before_counts = hub.counts();
    const double before = process_use().processor_seconds;
    const auto begin = Clock::now();
    publish_for(hub, 100ms, duration);
    const double seconds = seconds_since(begin);
    const double share = (process_use().processor_seconds - before) / seconds;
    const auto counts = hub.counts();
    std::printf("%d clients, 10 scenes and 10 pictures a second: %.0f frames/s, %llu dropped\n", clients,
                double(counts.taken - before_counts.taken) / seconds,
                static_cast<unsigned long long>(counts.dropped - before_counts.dropped));
    std::printf("  server %.3f of a core, bare sockets %.3f: ratio %.2f\n", share, bare, share / bare);
  }
  wait_for([&] { return hub.counts().clients == 0; });

  const Crowd others([&] { watch(server.port(), 7); });
  wait_for([&] { return hub.counts().clients == 7 && hub.watched().size() == 2; });
  publish_for(hub, 1ms, 1s);
  const Rate without = publish_for(hub, 1ms, duration);
  const double memory = double(process_use().resident) / 1e6;
  WebClient stopped(server.port());
  stopped.upgrade();
  stopped.say(kWatch);
  wait_for([&] { return hub.counts().clients == 8; });
  const auto dropped = hub.counts().dropped;
  const Rate with = publish_for(hub, 1ms, duration);
  std::printf("a client that stops taking, beside 7 that take, 1000 a second:\n");
  std::printf("  publisher %.1f/s without it, %.1f/s with it: ratio %.4f; longest call %.2f ms, %.2f ms\n",
              without.each_second, with.each_second, with.each_second / without.each_second, without.longest_ms,
              with.longest_ms);
  std::printf("  memory +%.1f MB; %llu messages dropped\n", double(process_use().resident) / 1e6 - memory,
              static_cast<unsigned long long>(hub.counts().dropped - dropped));
}

}  // namespace

Measure live(CLI::App& command) {
  const auto clients = std::make_shared<int>(64), seconds = std::make_shared<int>(10);
  command.add_option("clients", *clients, "pages that watch");
  command.add_option("seconds", *seconds, "of each measurement");
  return [=] { measure(*clients, std::chrono::seconds(*seconds)); };
}

}  // namespace citylearn::bench
