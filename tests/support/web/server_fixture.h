// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <cstring>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>

#include "dashboard/http/server.h"
#include "tests/support/processes/service.h"
#include "tests/support/web/web_client.h"

namespace citylearn::testing {

using namespace std::chrono_literals;
using Json = nlohmann::json;
using Merge = Hub::Merge;

inline constexpr std::size_t kMemory = 16 << 20;  // bytes that an attack may cost

/// Returns the resident bytes of this process; 0 under a sanitizer, which keeps what was freed.
inline std::size_t resident() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return 0;
#endif
  std::ifstream statm("/proc/self/statm");
  std::size_t all = 0, pages = 0;
  statm >> all >> pages;
  return pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

inline std::vector<std::byte> bytes(std::size_t size, char value = 'x') {
  return std::vector<std::byte>(size, static_cast<std::byte>(value));
}

/// Writes a new key and a certificate that it signed itself.
inline void write_certificate(const std::string& certificate, const std::string& key) {
  const Folder folder;
  Service openssl({"/usr/bin/openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                   "-subj", "/CN=localhost", "-keyout", key, "-out", certificate},
                  folder / "log");
  EXPECT_EQ(openssl.wait(seconds(60)), 0) << openssl.output();
}

/// The header of a live frame, and the length of its payload.
struct News {
  Json header;
  std::size_t payload = 0;
};

inline std::optional<News> news_of(const std::optional<WebClient::Frame>& frame) {
  if (!frame || frame->opcode != 2 || frame->payload.size() < 4) return std::nullopt;
  std::uint32_t length = 0;
  std::memcpy(&length, frame->payload.data(), 4);
  EXPECT_EQ((4 + length) % 8, 0u);
  return News{Json::parse(frame->payload.substr(4, length)), frame->payload.size() - 4 - length};
}

/// A server with a page of three files and an API that answers with its query.
class ServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    rlimit files{};
    getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = files.rlim_max;
    setrlimit(RLIMIT_NOFILE, &files);
    make_file(folder_ / "secret", "secret");
    make_file(folder_ / "page/index.html", "<!doctype html>");
    make_file(folder_ / "page/assets/index-a1B2c3_4.js", "let x = 1;");
    make_file(folder_ / "page/assets/index-a1B2c3_4.js.gz", "gzip");
    options_.port = 0;
    options_.page = folder_ / "page";
  }
  void TearDown() override { release(); }

  void start() {
    server_ = std::make_unique<Server>(options_, hub_,
                                       Server::Handlers{[this](const Query& query) { return answer(query); }, {}});
  }
  std::unique_ptr<WebClient> client(const char* from = "127.0.0.1", int receive_buffer = 0) {
    return std::make_unique<WebClient>(server_->port(), !options_.tls_certificate.empty(), from, receive_buffer);
  }
  WebClient::Response get(const std::string& target, const WebClient::Headers& headers = {}) {
    return client()->get(target, headers);
  }
  std::unique_ptr<WebClient> watching(const std::vector<std::string>& topics, int receive_buffer = 0) {
    auto one = client("127.0.0.1", receive_buffer);
    EXPECT_EQ(one->upgrade().status, 101);
    one->say(Json{{"watch", topics}}.dump());
    for (const std::string& topic : topics)
      EXPECT_TRUE(poll_until([&] { return watched(topic); }, WebClient::kTimeout));
    return one;
  }
  bool watched(const std::string& topic) const {
    const auto all = hub_.watched();
    return std::find(all.begin(), all.end(), topic) != all.end();
  }
  double metric(const std::string& name) {
    const std::string all = "\n" + get("/metrics").body;
    const std::size_t place = all.find("\n" + name + " ");
    return place == std::string::npos ? -1 : std::stod(all.substr(place + name.size() + 2));
  }
  /// Returns how soon the server answers: the best of some times, as the machine may be busy.
  std::chrono::milliseconds health(const char* from = "127.0.0.1") {
    auto best = 1'000'000ms;
    for (int time = 0; time < 5; ++time) {
      const auto begin = Clock::now();
      if (client(from)->get("/healthz").body != "ok\n") return 1'000'000ms;
      best = std::min(best, std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - begin));
    }
    return best;
  }

  /// An API that returns its query. One of its calls is slow.
  Answer answer(const Query& query) {
    if (query.path == std::vector<std::string>{"slow"}) {
      std::unique_lock guard(lock_);
      ++slow_;
      released_.wait_for(guard, WebClient::kTimeout, [this] { return free_; });
    }
    if (query.path == std::vector<std::string>{"broken"}) throw Error("the disk is full", "store");
    if (query.path == std::vector<std::string>{"large"}) return {200, "text/csv", std::string(8 << 20, 'l'), {}};
    if (query.path == std::vector<std::string>{"cached"})
      return {200, "image/jpeg", "jpeg", {{"Cache-Control", "max-age=9"}, {"X-Name", "a\r\nSet-Cookie: b"}}};
    const Json heard = {{"method", query.method}, {"path", query.path}, {"of", query.parameters}};
    return {200, "application/json", heard.dump(), {}};
  }
  void release() {
    const std::lock_guard guard(lock_);
    free_ = true;
    released_.notify_all();
  }
  int slow() {
    const std::lock_guard guard(lock_);
    return slow_;
  }

  Folder folder_;
  ServerOptions options_;
  ClientHub hub_{{.linger = 0ms}};
  std::mutex lock_;
  std::condition_variable released_;
  bool free_ = false;
  int slow_ = 0;
  std::unique_ptr<Server> server_;
};

/// One that serves with these options.
class RunningServerTest : public ServerTest {
 protected:
  void SetUp() override {
    ServerTest::SetUp();
    start();
  }
};

}  // namespace citylearn::testing
