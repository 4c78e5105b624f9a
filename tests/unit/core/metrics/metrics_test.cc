// SPDX-License-Identifier: Apache-2.0
#include "core/metrics/metrics.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>
#include <sys/socket.h>
#include <unistd.h>

#include <deque>
#include <regex>

#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "idl/message_fields.h"
#include "tests/support/log.h"
#include "tests/support/text.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

msg::ServiceStatus running() {
  msg::ServiceStatus status;
  status.header().sender() = "env-a";
  status.header().session() = "demo";
  status.service() = "env_service";
  status.host() = "an \"odd\\ host\n";
  status.middleware() = "fastdds";
  status.service_state(msg::RUNNING);
  return status;
}

/// A TCP connection to a server on this machine, for requests of any shape.
class Client {
 public:
  explicit Client(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval patience{kMaxWait.count(), 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    connected_ = ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  ~Client() { ::close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool connected() const { return connected_; }
  void send(const std::string& text) { ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL); }
  /// Returns all that comes until the server closes the connection; "timed out" if it does not.
  std::string rest() {
    std::string all;
    char part[4096];
    while (true) {
      const ssize_t size = ::recv(socket_, part, sizeof part, 0);
      if (size < 0 && errno == EAGAIN) return "timed out";
      if (size <= 0) return all;
      all.append(part, static_cast<std::size_t>(size));
    }
  }

 private:
  const int socket_;
  bool connected_ = false;
};

/// Metrics that are served, on a free port.
class ServedMetrics : public ::testing::Test {
 protected:
  void SetUp() override {
    std::smatch found;
    const std::string text = log_.text();
    ASSERT_TRUE(std::regex_search(text, found, std::regex("http://127\\.0\\.0\\.1:([0-9]+)/metrics"))) << text;
    port_ = static_cast<std::uint16_t>(std::stoi(found[1]));
  }
  std::string request(const std::string& line) {
    Client client(port_);
    client.send(line + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
    return client.rest();
  }

  Log log_;
  Metrics metrics_{"0"};
  std::uint16_t port_ = 0;
};

TEST(Metrics, HaveEveryFigureOfTheMessages) {
  Metrics metrics("");
  EXPECT_EQ(metrics.text(), "");
  msg::ServiceStatus status = running();
  status.rate(12.5F);
  status.sent_bytes(12345678901);
  metrics.set(status);
  const std::string before = metrics.text();
  visit_metrics(status, [&](const std::string& name, const std::string& help, auto value) {
    EXPECT_TRUE(contains(before, "# HELP " + name + " " + help + "\n# TYPE " + name +
                                     (name.ends_with("_total") ? " counter\n" : " gauge\n") + name + " " +
                                     fmt::format("{}\n", static_cast<double>(value))))
        << name << before;
  });
  EXPECT_TRUE(contains(before, "\ncitylearn_steps_per_second 12.5\n"));
  EXPECT_TRUE(contains(before, "\ncitylearn_sent_bytes_total 12345678901\n")) << before;
  EXPECT_TRUE(contains(before, "\ncitylearn_state{state=\"running\"} 1\n"));
  EXPECT_TRUE(contains(before, "\ncitylearn_state{state=\"waiting\"} 0\n"));
  EXPECT_TRUE(contains(before, "\ncitylearn_alarm 0\n"));
  EXPECT_TRUE(contains(before,
                       "citylearn_info{service=\"env_service\",id=\"env-a\",session=\"demo\",host=\"an "
                       "\\\"odd\\\\ host\\n\",middleware=\"fastdds\",version="))
      << before;
  EXPECT_FALSE(contains(before, "training")) << "it does not train";

  msg::TrainingStat stat;
  stat.update(7);
  stat.wall(1.5);
  metrics.set(stat);
  metrics.set_queue("episodes", 3, 10);
  const std::string after = metrics.text();
  for (const TrainingFigure& figure : training_figures())
    EXPECT_TRUE(contains(after, std::string("\ncitylearn_training_") + figure.name)) << figure.name;
  EXPECT_TRUE(contains(after, "\ncitylearn_training_update 7\n"));
  EXPECT_TRUE(contains(after, "\ncitylearn_training_wall_seconds 1.5\n"));
  EXPECT_TRUE(contains(after, "\ncitylearn_queue_length{queue=\"episodes\"} 3\n"));
  EXPECT_TRUE(contains(after, "\ncitylearn_queue_capacity{queue=\"episodes\"} 10\n"));
}

TEST(Metrics, SayWhyAServiceIsNotWell) {
  Metrics metrics("");
  EXPECT_EQ(metrics.problem(true), "starting");
  msg::ServiceStatus status = running();
  metrics.set(status);
  EXPECT_EQ(metrics.problem(true), "");
  status.alarm() = "checkpoint: the disk is full";
  metrics.set(status);
  EXPECT_EQ(metrics.problem(true), "checkpoint: the disk is full");
  EXPECT_EQ(metrics.problem(false), "") << "to start it again would not help";
  EXPECT_TRUE(contains(metrics.text(), "\ncitylearn_alarm 1\n"));
  status.alarm() = "";
  status.service_state(msg::FAILED);
  status.activity() = "refused settings";
  metrics.set(status);
  EXPECT_EQ(metrics.problem(false), "failed: refused settings");
}

TEST(Metrics, RefuseAddressesThatAreNone) {
  for (const std::string address :
       {"x", "65536", "-1", "1.2.3:80", "1.2.3.4:", "localhost:80", "80s", "80,81", ":80", "::1:80"}) {
    EXPECT_TRUE(contains(metrics_address_problem(address), "'" + address + "' is not [ADDRESS:]PORT")) << address;
    EXPECT_THROW(Metrics{address}, Error) << address;
  }
  for (const std::string address : {"", "0", "9464", "0.0.0.0:9464"}) EXPECT_EQ(metrics_address_problem(address), "");
}

TEST_F(ServedMetrics, AnswersProbesAndPrometheus) {
  EXPECT_TRUE(request("GET /healthz").starts_with("HTTP/1.1 503 Service Unavailable\r\n"));
  msg::ServiceStatus status = running();
  metrics_.set(status);
  const std::string reply = request("GET /metrics");
  EXPECT_TRUE(reply.starts_with("HTTP/1.1 200 OK\r\n")) << reply;
  EXPECT_TRUE(contains(reply, "\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n"));
  EXPECT_TRUE(contains(reply, "\r\n\r\n# HELP citylearn_info ")) << reply;
  EXPECT_TRUE(request("GET /healthz").ends_with("\r\n\r\nok\n"));
  EXPECT_TRUE(request("HEAD /healthz").ends_with("\r\n\r\n"));
  status.alarm() = "episodes: too many";
  metrics_.set(status);
  EXPECT_TRUE(request("GET /healthz").ends_with("\r\n\r\nepisodes: too many\n"));
  EXPECT_TRUE(request("GET /livez").ends_with("\r\n\r\nok\n"));
  EXPECT_TRUE(eventually([] {}, [&] { return contains(request("GET /livez"), " 503 "); })) << "no heartbeat comes";
  EXPECT_TRUE(contains(request("GET /livez"), "the main loop stands"));
  for (const std::string path : {"/", "/metrics/", "/../etc/passwd", "/%2e%2e/etc/passwd"})
    EXPECT_TRUE(request("GET " + path).starts_with("HTTP/1.1 404 ")) << path;
  EXPECT_TRUE(request("PUT /metrics").starts_with("HTTP/1.1 405 "));
}

TEST_F(ServedMetrics, SlowAndHostileClientsHoldItUpForAMoment) {
  metrics_.set(running());
  std::deque<Client> slow;
  for (int i = 0; i < 40; ++i) slow.emplace_back(port_).send("GET /metrics HTTP/1.1\r\nHost: ");
  Client endless(port_), garbage(port_);
  endless.send("GET /" + std::string(100'000, 'x'));
  garbage.send(std::string("\x16\x03\x01\0\xFF\r\n\r\n", 9));
  EXPECT_TRUE(request("GET /metrics").starts_with("HTTP/1.1 200 OK\r\n"));
  for (Client& client : slow) EXPECT_FALSE(contains(client.rest(), " 200 ")) << "none is kept";
  EXPECT_FALSE(contains(endless.rest(), " 200 "));
  EXPECT_FALSE(contains(garbage.rest(), " 200 "));
  EXPECT_TRUE(request("GET /livez").starts_with("HTTP/1.1 ")) << "it goes on";
}

TEST_F(ServedMetrics, AnUsedPortIsAnErrorThatNamesIt) {
  try {
    Metrics second(std::to_string(port_));
    FAIL();
  } catch (const Error& error) {
    EXPECT_TRUE(contains(error.what(), "--metrics " + std::to_string(port_) + ": cannot listen")) << error.what();
  }
}

}  // namespace
}  // namespace citylearn::testing
