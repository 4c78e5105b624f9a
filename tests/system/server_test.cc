// SPDX-License-Identifier: Apache-2.0
// The web server against clients that behave, and against those that do not.
#include "dashboard/http/server.h"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <condition_variable>
#include <cstring>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <regex>
#include <thread>

#include "core/util/random.h"
#include "tests/support/service.h"
#include "tests/support/web_client.h"

namespace citylearn {
namespace {

using namespace std::chrono_literals;
using testing::Folder;
using testing::Service;
using testing::WebClient;
using Json = nlohmann::json;
using Merge = Hub::Merge;

constexpr std::size_t kMemory = 16 << 20;  // that an attack may cost
constexpr int kDomain = 217;               // of the programs started here

/// Bytes; always the same where a sanitizer keeps what was freed.
std::size_t resident() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return 0;
#endif
  std::ifstream statm("/proc/self/statm");
  std::size_t all = 0, pages = 0;
  statm >> all >> pages;
  return pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

std::vector<std::byte> bytes(std::size_t size, char value = 'x') {
  return std::vector<std::byte>(size, static_cast<std::byte>(value));
}

/// Made anew by each test that wants one: a key, and a certificate that it signed itself.
void write_certificate(const std::string& certificate, const std::string& key) {
  EVP_PKEY* pair = EVP_EC_gen("P-256");
  X509* x509 = X509_new();
  ASN1_INTEGER_set(X509_get_serialNumber(x509), 1);
  X509_gmtime_adj(X509_getm_notBefore(x509), 0);
  X509_gmtime_adj(X509_getm_notAfter(x509), 3600);
  X509_set_pubkey(x509, pair);
  X509_NAME* name = X509_get_subject_name(x509);
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>("localhost"), -1, -1, 0);
  X509_set_issuer_name(x509, name);
  X509_sign(x509, pair, EVP_sha256());
  FILE* file = std::fopen(certificate.c_str(), "w");
  PEM_write_X509(file, x509);
  std::fclose(file);
  file = std::fopen(key.c_str(), "w");
  PEM_write_PrivateKey(file, pair, nullptr, nullptr, 0, nullptr, nullptr);
  std::fclose(file);
  X509_free(x509);
  EVP_PKEY_free(pair);
}

/// The header of a live frame, and how long its payload is.
struct News {
  Json header;
  std::size_t payload = 0;
};

std::optional<News> news_of(const std::optional<WebClient::Frame>& frame) {
  if (!frame || frame->opcode != 2 || frame->payload.size() < 4) return std::nullopt;
  std::uint32_t length = 0;
  std::memcpy(&length, frame->payload.data(), 4);
  EXPECT_EQ((4 + length) % 8, 0u);
  return News{Json::parse(frame->payload.substr(4, length)), frame->payload.size() - 4 - length};
}

class ServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    rlimit files{};
    getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = files.rlim_max;
    setrlimit(RLIMIT_NOFILE, &files);
    std::filesystem::create_directories(folder_ / "page/assets");
    std::ofstream(folder_ / "secret") << "secret";
    std::ofstream(folder_ / "page/index.html") << "<!doctype html>";
    std::ofstream(folder_ / "page/assets/index-a1B2c3_4.js") << "let x = 1;";
    std::ofstream(folder_ / "page/assets/index-a1B2c3_4.js.gz") << "gzip";
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
      EXPECT_TRUE(testing::poll_until([&] { return watched(topic); }, WebClient::kPatience));
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
  /// It still answers, and how soon; the best of some times, as the machine may be busy with something else.
  std::chrono::milliseconds health(const char* from = "127.0.0.1") {
    auto best = 1'000'000ms;
    for (int time = 0; time < 5; ++time) {
      const auto begin = Clock::now();
      if (client(from)->get("/healthz").body != "ok\n") return 1'000'000ms;
      best = std::min(best, std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - begin));
    }
    return best;
  }

  /// An API that tells what it was asked, and one call of which is slow.
  Answer answer(const Query& query) {
    if (query.path == std::vector<std::string>{"slow"}) {
      std::unique_lock guard(lock_);
      ++slow_;
      released_.wait_for(guard, WebClient::kPatience, [this] { return free_; });
    }
    if (query.path == std::vector<std::string>{"broken"}) throw Error("the disk is full", "store");
    if (query.path == std::vector<std::string>{"large"}) return {200, "text/csv", std::string(8 << 20, 'l'), {}};
    if (query.path == std::vector<std::string>{"cached"})
      return {200, "image/jpeg", "jpeg", {{"Cache-Control", "max-age=9"}, {"X-Name", "a\r\nSet-Cookie: b"}}};
    return {200,
            "application/json",
            Json{{"method", query.method}, {"path", query.path}, {"of", query.parameters}}.dump(),
            {}};
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

TEST_F(ServerTest, ServesThePageWithStrictHeaders) {
  start();
  const auto page = get("/");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.body, "<!doctype html>");
  EXPECT_EQ(page.headers.at("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.at("cache-control"), "no-cache");
  const auto script = get("/assets/index-a1B2c3_4.js");
  EXPECT_EQ(script.body, "let x = 1;");
  EXPECT_EQ(script.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(script.headers.at("vary"), "Accept-Encoding");
  const auto compressed = get("/assets/index-a1B2c3_4.js", {{"accept-encoding", "br, gzip"}});
  EXPECT_EQ(compressed.body, "gzip");
  EXPECT_EQ(compressed.headers.at("content-encoding"), "gzip");
  const auto api = get("/api/runs");
  EXPECT_EQ(api.headers.at("cache-control"), "no-store");
  const auto live = client()->upgrade();
  for (const auto& response : {page, script, compressed, api, live, get("/none"), get("/metrics"), get("/healthz")}) {
    const std::string policy = response.headers.at("content-security-policy");
    for (const std::string part : {"default-src 'self'; ", "img-src 'self' data: blob:; ", "connect-src 'self'; ",
                                   "style-src 'self'; ", "frame-ancestors 'none'; ", "base-uri 'none'; "})
      EXPECT_NE(policy.find(part), std::string::npos) << part;
    EXPECT_EQ(response.headers.at("x-content-type-options"), "nosniff");
    EXPECT_EQ(response.headers.at("referrer-policy"), "no-referrer");
    EXPECT_EQ(response.headers.at("cross-origin-opener-policy"), "same-origin");
    EXPECT_EQ(response.headers.at("cross-origin-resource-policy"), "same-origin");
    EXPECT_EQ(response.headers.count("server") ? response.headers.at("server") : "citylearn", "citylearn");
  }
}

TEST_F(ServerTest, OneConnectionServesManyRequests) {
  start();
  const auto one = client();
  const auto page = one->get("/");
  const auto unchanged = one->get("/", {{"if-none-match", page.headers.at("etag")}});
  EXPECT_EQ(unchanged.status, 304);
  EXPECT_EQ(unchanged.body, "");
  const auto head = one->request("HEAD", "/");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.headers.at("content-length"), "15");
  one->send("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\nGET /api/a HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_EQ(one->read().body, "ok\n");
  EXPECT_EQ(Json::parse(one->read().body)["path"], Json({"a"}));
  EXPECT_EQ(one->request("GET", "/api/b", {}, std::string(60'000, 'b')).status, 200);
  EXPECT_EQ(one->get("/", {{"connection", "close"}}).status, 200);
  EXPECT_TRUE(one->ended());
}

TEST_F(ServerTest, SaysThatThePageIsNotBuilt) {
  options_.page = folder_ / "none";
  start();
  const auto page = get("/");
  EXPECT_EQ(page.status, 404);
  EXPECT_NE(page.body.find("not built"), std::string::npos);
  EXPECT_NE(page.body.find("npm"), std::string::npos);
  EXPECT_EQ(get("/api/runs").status, 200);
}

TEST_F(ServerTest, TheApiGetsWhatWasAsked) {
  start();
  const auto one = client();
  const Json query = Json::parse(one->get("/api/runs/demo%2Fpolicy%2F1/training?columns=reward,spl&x=wall+time").body);
  EXPECT_EQ(query, Json({{"method", "GET"},
                         {"path", {"runs", "demo/policy/1", "training"}},
                         {"of", {{"columns", "reward,spl"}, {"x", "wall time"}}}}));
  EXPECT_EQ(Json::parse(one->request("DELETE", "/api/runs/a").body)["method"], "DELETE");
  EXPECT_EQ(one->request("HEAD", "/api/runs").body, "");
  EXPECT_EQ(one->get("/api/runs/%zz").status, 400);
  EXPECT_EQ(one->get("/api/runs?a=1&a=2").status, 400);
  const auto post = one->request("POST", "/api/runs");
  EXPECT_EQ(post.status, 405);
  EXPECT_EQ(post.headers.at("allow"), "GET, HEAD, DELETE");
  EXPECT_EQ(one->request("DELETE", "/").status, 405);
  EXPECT_EQ(one->request("TRACE", "/api/runs").status, 405);
  const auto broken = one->get("/api/broken");
  EXPECT_EQ(broken.status, 500);
  EXPECT_EQ(Json::parse(broken.body)["error"], "store: the disk is full");
  const auto cached = one->get("/api/cached");
  EXPECT_EQ(cached.headers.at("cache-control"), "max-age=9");
  EXPECT_FALSE(cached.headers.count("set-cookie")) << "a value began another header";
  EXPECT_EQ(one->get("/api/large").body, std::string(8 << 20, 'l'));
  EXPECT_EQ(one->get("/api/live").status, 400);
}

TEST_F(ServerTest, ASlowQueryHoldsUpNobodyElse) {
  options_.workers = 1;
  options_.waiting = 2;
  start();
  const auto slow = client(), waiting = client();
  slow->send("GET /api/slow HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_TRUE(testing::poll_until([&] { return this->slow() == 1; }, WebClient::kPatience));
  waiting->send("GET /api/next HTTP/1.1\r\nHost: localhost\r\n\r\n");
  std::optional<WebClient::Response> third;
  // The second one waits from some moment on; from then on there is no room for a third.
  ASSERT_TRUE(testing::poll_until([&] { return (third = get("/api/slow"))->status == 503; }, WebClient::kPatience) ||
              this->slow() > 1);
  EXPECT_EQ(third->headers.at("retry-after"), "1");
  const auto live = watching({"services"});
  hub_.publish("services", {}, bytes(10), Merge::kReplace);
  EXPECT_TRUE(news_of(live->take()));
  EXPECT_LT(health(), 100ms);
  release();
  EXPECT_EQ(slow->read().status, 200);
  EXPECT_EQ(waiting->read().status, 200);
}

TEST_F(ServerTest, NoPathLeavesTheFolder) {
  std::filesystem::create_symlink("../secret", folder_ / "page/link");
  start();
  for (const std::string target :
       {"/../secret", "/assets/../../secret", "/%2e%2e/secret", "/..%2fsecret", "/..%5csecret", "/....//secret",
        "//secret", "/link", "/assets/%2e%2e%2f%2e%2e%2fsecret", "/index.html%00.js", "/./index.html",
        "/..%c0%afsecret", "/../../../../../../../../etc/passwd"}) {
    const auto response = get(target);
    EXPECT_TRUE(response.status == 404 || response.status == 400) << target << " " << response.status;
    EXPECT_EQ(response.body.find("secret\n"), std::string::npos) << target;
    EXPECT_EQ(response.body.find("root:"), std::string::npos) << target;
  }
  for (const std::string target : {"secret", "*", "http://localhost/../secret", ""})
    EXPECT_EQ(client()->get(target).status, 400) << target;
}

TEST_F(ServerTest, WithoutTheTokenNothingIsTold) {
  options_.token_file = folder_ / "token";
  start();
  const std::string token = testing::contents(options_.token_file).substr(0, 64);
  for (const std::string target : {"/api/runs", "/metrics", "/api/live", "/login"}) {
    EXPECT_EQ(get(target).status, 401) << target;
    EXPECT_EQ(get(target, {{"authorization", "Bearer " + std::string(64, '0')}}).status, 401) << target;
    EXPECT_EQ(get(target, {{"cookie", "citylearn_" + std::to_string(server_->port()) + "=0"}}).status, 401) << target;
  }
  EXPECT_EQ(client()->upgrade().status, 401);
  EXPECT_EQ(get("/").status, 200) << "the page itself asks for the token";
  EXPECT_EQ(get("/healthz").status, 200);
  EXPECT_EQ(get("/api/runs", {{"authorization", "Bearer " + token}}).status, 200);
  EXPECT_EQ(client()->upgrade({{"authorization", "Bearer " + token}}).status, 101);
  // The page changes the token into a cookie, which the WebSocket then has.
  const auto changed = get("/login", {{"authorization", "Bearer " + token}});
  EXPECT_EQ(changed.status, 204);
  const std::string cookie = changed.headers.at("set-cookie");
  EXPECT_EQ(client()->upgrade({{"cookie", cookie.substr(0, cookie.find(';'))}}).status, 101);
}

TEST_F(ServerTest, ALinkLogsInOnce) {
  options_.token_file = folder_ / "token";
  start();
  const std::string path = server_->link().substr(server_->url().size());
  EXPECT_EQ(client()->request("HEAD", path).status, 405) << "who only looks at a link does not use it up";
  EXPECT_EQ(get("/login?once=0").status, 401);
  const auto login = get(path);
  EXPECT_EQ(login.status, 303);
  EXPECT_EQ(login.headers.at("location"), "/");
  const std::string cookie = login.headers.at("set-cookie");
  EXPECT_NE(cookie.find("; HttpOnly; SameSite=Strict"), std::string::npos);
  EXPECT_EQ(cookie.find("Secure"), std::string::npos);
  EXPECT_EQ(get("/api/runs", {{"cookie", cookie.substr(0, cookie.find(';'))}}).status, 200);
  EXPECT_EQ(get(path).status, 401);
}

TEST_F(ServerTest, StrangersAreRefused) {
  start();
  const std::string host = "localhost:" + std::to_string(server_->port());
  for (const std::string target : {"/", "/api/runs", "/healthz", "/metrics", "/login"}) {
    EXPECT_EQ(get(target, {{"host", "evil.example"}}).status, 403) << target;
    EXPECT_EQ(get(target, {{"origin", "http://evil.example"}}).status, 403) << target;
    EXPECT_EQ(get(target, {{"origin", "null"}}).status, 403) << target;
  }
  EXPECT_EQ(client()->request("DELETE", "/api/runs/a", {{"origin", "http://evil.example"}}).status, 403);
  EXPECT_EQ(client()->upgrade({{"origin", "http://evil.example"}}).status, 403);
  EXPECT_EQ(client()->upgrade({{"host", "evil.example"}}).status, 403);
  EXPECT_EQ(client()->upgrade({{"host", host}, {"origin", "http://" + host}}).status, 101);
  const auto silent = client();
  silent->send("GET / HTTP/1.1\r\n\r\n");
  EXPECT_EQ(silent->read().status, 403) << "no Host at all";
}

TEST_F(ServerTest, AHeaderWithoutEndCostsNothing) {
  start();
  ASSERT_LT(health(), 100ms);
  const std::size_t before = resident();
  const auto one = client();
  const std::string part(1 << 20, 'h');
  std::size_t sent = 0;
  bool taken = one->send("GET / HTTP/1.1\r\nHost: localhost\r\nX: ");
  for (; taken && sent < 300u << 20; sent += part.size()) {
    taken = one->send(part);
    EXPECT_LT(sent == part.size() ? health() : 0ms, 100ms);
  }
  EXPECT_FALSE(taken) << "all of it was swallowed";
  EXPECT_LT(resident(), before + kMemory);
  EXPECT_LT(health(), 100ms);
}

TEST_F(ServerTest, WhatIsTooLargeIsNamed) {
  start();
  EXPECT_EQ(get("/", {{"x", std::string(40'000, 'x')}}).status, 431);
  EXPECT_EQ(get("/" + std::string(40'000, 'x')).status, 431);
  EXPECT_EQ(get("/", {{"x", std::string(30'000, 'x')}}).status, 200);
  EXPECT_EQ(client()->request("GET", "/api/runs", {}, std::string(66'000, 'x')).status, 413);
  EXPECT_EQ(get("/api/runs", {{"content-length", "99999999999"}}).status, 413);
  const auto chunked = client();
  chunked->send("GET /api/runs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n");
  for (int i = 0; i < 8; ++i) chunked->send("4000\r\n" + std::string(0x4000, 'c') + "\r\n");
  EXPECT_EQ(chunked->read().status, 413);
  for (const std::string text : {"\r\n\r\n", "nonsense\r\n\r\n", "GET / HTTP/9.9\r\n\r\n", "GET  HTTP/1.1\r\n\r\n",
                                 "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
                                 "GET / HTTP/1.1\r\nHost : localhost\r\n\r\n"}) {
    const auto one = client();
    one->send(text);
    EXPECT_EQ(one->read().status, 400) << text;
    EXPECT_TRUE(one->ended());
  }
}

TEST_F(ServerTest, BytesOfAnyKindDoNoHarm) {
  start();
  Random random(7);
  const std::size_t before = resident();
  for (int round = 0; round < 300; ++round) {
    const auto one = client();
    std::string text = round % 2 ? "GET /api/live HTTP/1.1\r\nHost: localhost\r\n" : "";
    static const std::vector<std::string> words = {
        "Upgrade: websocket\r\n",  "Connection: Upgrade\r\n",        "\r\n", "\0",
        "Content-Length: -1\r\n",  "Transfer-Encoding: chunked\r\n", "%",    "Sec-WebSocket-Version: 13\r\n",
        "Sec-WebSocket-Key: x\r\n"};
    for (std::uint64_t part = random.below(30); part > 0; --part)
      if (random.below(2))
        text += words[random.below(words.size())];
      else
        text += static_cast<char>(random.below(256));
    one->send(text);
  }
  EXPECT_LT(health(), 100ms);
  EXPECT_LT(resident(), before + kMemory);
}

TEST_F(ServerTest, ARequestThatDripsIsCutOff) {
  options_.request_time = 300ms;
  start();
  const auto one = client(), idle = client();
  const auto begin = Clock::now();
  one->send("GET / HTTP/1.1\r\nX: ");
  EXPECT_TRUE(testing::poll_until([&] { return !one->send("x") || one->ended(1ms); }, WebClient::kPatience));
  EXPECT_GE(Clock::now() - begin, 250ms);
  EXPECT_LT(Clock::now() - begin, 5s * testing::kSlowness);
  EXPECT_TRUE(idle->ended());
  const auto body = client();
  body->send("GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nbody");
  EXPECT_TRUE(body->ended()) << "a body that does not come";
}

TEST_F(ServerTest, WhoDoesNotTakeTheAnswerIsCutOff) {
  options_.request_time = 300ms;
  start();
  const auto one = client("127.0.0.1", 4096);
  one->send("GET /api/large HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_TRUE(
      testing::poll_until([&] { return metric("citylearn_dashboard_connections") == 1; }, WebClient::kPatience));
}

TEST_F(ServerTest, AThousandIdleConnectionsLockNobodyOut) {
  start();
  ASSERT_LT(health(), 100ms);
  const std::size_t before = resident();
  std::vector<std::unique_ptr<WebClient>> idle;
  const std::vector<const char*> addresses = {"127.0.0.1", "127.0.0.2", "127.0.0.3", "127.0.0.4"};
  for (int i = 0; i < 1000; ++i) idle.push_back(client(addresses[static_cast<std::size_t>(i) % 4]));
  EXPECT_LT(health(), 100ms);
  EXPECT_GE(metric("citylearn_dashboard_connections"), 990);
  for (int i = 0; i < 300; ++i) idle.push_back(client());  // of one address, beyond all bounds
  EXPECT_LT(health(), 100ms);
  EXPECT_LT(health("127.0.0.5"), 100ms);
  EXPECT_LE(metric("citylearn_dashboard_connections"), 1024);
  EXPECT_LT(resident(), before + kMemory);
  EXPECT_TRUE(idle[0]->ended()) << "the oldest made room";
}

TEST_F(ServerTest, WhereAllAreBusyOthersAreRefused) {
  options_.connections = 6;
  options_.connections_each = 4;
  start();
  std::vector<std::unique_ptr<WebClient>> busy;
  for (int i = 0; i < 4; ++i) busy.push_back(watching({"services"}));
  const auto refused = get("/healthz");
  EXPECT_EQ(refused.status, 503);
  EXPECT_TRUE(Json::parse(refused.body).contains("error"));
  EXPECT_EQ(client("127.0.0.2")->get("/healthz").status, 200) << "another address";
  busy.pop_back();
  EXPECT_TRUE(testing::poll_until([&] { return get("/healthz").status == 200; }, WebClient::kPatience));
}

TEST_F(ServerTest, LiveNewsReachWhoWatches) {
  start();
  const auto one = watching({"scene:env@run", "events"});
  hub_.publish("scene:env@run", {{"agents", 3}}, bytes(72), Merge::kReplace);
  const auto scene = news_of(one->take());
  ASSERT_TRUE(scene);
  EXPECT_EQ(scene->header["topic"], "scene:env@run");
  EXPECT_EQ(scene->header["agents"], 3);
  EXPECT_EQ(scene->payload, 72u);
  one->say(Json{{"watch", {"runs"}}}.dump());
  EXPECT_TRUE(testing::poll_until([&] { return watched("runs") && !watched("events"); }, WebClient::kPatience));
  hub_.publish("events", {}, bytes(5), Merge::kEach);
  hub_.publish("runs", {}, bytes(100'000), Merge::kReplace);
  const auto runs = news_of(one->take());
  ASSERT_TRUE(runs);
  EXPECT_EQ(runs->header["topic"], "runs");
  EXPECT_EQ(runs->payload, 100'000u);
  one->say("", 8);
  EXPECT_TRUE(one->ended());
  EXPECT_TRUE(testing::poll_until([&] { return hub_.watched().empty(); }, WebClient::kPatience));
}

TEST_F(ServerTest, AClientThatStopsLosesFramesButNotTheNewest) {
  start();
  ASSERT_LT(health(), 100ms);
  const auto stopped = watching({"picture", "events", "training"}, 4096);
  const auto other = watching({"picture"});
  const std::size_t before = resident();
  int seen = 0;
  for (int i = 1; i <= 2000; ++i) {
    hub_.publish("picture", {{"i", i}}, bytes(50'000), Merge::kReplace);
    hub_.publish("events", {{"i", i}}, bytes(10'000), Merge::kEach);
    hub_.publish("training", {{"rows", 10}}, bytes(800), Merge::kAppend);
    if (i % 100 == 0)
      while (other->take(1ms)) ++seen;
  }
  EXPECT_LT(resident(), before + (32u << 20));
  EXPECT_GT(seen, 0) << "the other client is served meanwhile";
  std::map<std::string, Json> last;
  std::uint64_t frames = 0, rows = 0;
  while (const auto news = news_of(stopped->take(
             last.size() == 3 && last["picture"]["i"] == 2000 && last["events"]["i"] == 2000 ? 200ms
                                                                                             : WebClient::kPatience))) {
    last[news->header["topic"]] = news->header;
    ++frames;
    rows += news->header.value("rows", 0u);
  }
  EXPECT_EQ(last["picture"]["i"], 2000);
  EXPECT_EQ(last["events"]["i"], 2000);
  EXPECT_GE(rows, 2000u);
  const std::uint64_t dropped =
      std::max({last["picture"]["dropped"], last["events"]["dropped"], last["training"]["dropped"]});
  EXPECT_GT(dropped, 1000u);
  EXPECT_LT(frames, 2000u);
}

TEST_F(ServerTest, AClientThatTakesNothingIsLetGo) {
  options_.ping = 50ms;
  options_.patience = 400ms;
  start();
  const auto alive = watching({"runs"});
  const auto mute = watching({"runs"});
  const auto stopped = watching({"picture"}, 4096);
  const auto begin = Clock::now();
  for (int i = 0; i < 100; ++i) hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
  EXPECT_TRUE(testing::poll_until(
      [&] {
        alive->take(1ms);
        mute->take(1ms, true);
        hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
        return hub_.counts().clients == 1;
      },
      WebClient::kPatience));
  EXPECT_GE(Clock::now() - begin, 350ms);
  EXPECT_GE(alive->pings, 3);
  EXPECT_EQ(metric("citylearn_dashboard_live_let_go_total"), 2);
  hub_.publish("runs", {}, bytes(1), Merge::kReplace);
  EXPECT_TRUE(news_of(alive->take())) << "who answers pings stays";
}

TEST_F(ServerTest, MalformedFramesEndTheirOwnConnectionOnly) {
  start();
  const auto good = watching({"services"});
  ASSERT_LT(health(), 100ms);
  const std::size_t before = resident();
  using std::string_literals::operator""s;
  const std::string mask = "\x12\x34\x56\x78";
  for (const std::string& frame : {"\x81\x05hello"s,                                    // not masked
                                   "\xF1\x80"s + mask,                                  // reserved bits
                                   "\x83\x80"s + mask,                                  // unknown opcode
                                   "\x80\x80"s + mask,                                  // goes on with nothing
                                   "\x09\x80"s + mask,                                  // a ping in parts
                                   "\x89\xFE\x00\x7E"s + mask + std::string(126, 'p'),  // a large ping
                                   "\x81\xFF\x7F\xFF\xFF\xFF\xFF\xFF\xFF\xFF"s + mask,  // of 2^63 bytes
                                   "\x81\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"s + mask,  // of more
                                   "\x81\xFE\x00\x05"s + mask + "hello",  // a length not in its shortest form
                                   "\x88\x81"s + mask + "x",              // a close with half a code
                                   "\x81\x82"s + mask + std::string("\xFF\x12\xFE\x12", 2)}) {  // no UTF-8
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    one->send(frame);
    EXPECT_TRUE(one->ended()) << frame.size();
  }
  for (const std::string& text :
       {""s, "{}"s, "[1]"s, "{\"watch\": 1}"s, "{\"watch\": [1]}"s, "{\"watch\": [\""s + std::string(600, 't') + "\"]}",
        Json{{"watch", std::vector<std::string>(65, "t")}}.dump(), std::string(20'000, '['),
        std::string(70'000, ' ')}) {
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    one->say(text);
    const auto close = one->take();
    ASSERT_TRUE(close) << text;
    EXPECT_EQ(close->opcode, 8);
    one->say(close->payload, 8);
    EXPECT_TRUE(one->ended());
  }
  Random random(3);
  for (int round = 0; round < 200; ++round) {
    const auto one = client();
    ASSERT_EQ(one->upgrade().status, 101);
    std::string noise;
    for (std::uint64_t length = 1 + random.below(200); length > 0; --length)
      noise += static_cast<char>(random.below(256));
    one->send(noise);
  }
  EXPECT_LT(resident(), before + kMemory);
  EXPECT_LT(health(), 100ms);
  EXPECT_GE(metric("citylearn_dashboard_live_broken_total"), 10);
  hub_.publish("services", {}, bytes(1), Merge::kReplace);
  EXPECT_TRUE(news_of(good->take()));
}

TEST_F(ServerTest, MetricsAreInPrometheusTextFormat) {
  start();
  get("/none");
  const auto metrics = get("/metrics");
  EXPECT_EQ(metrics.headers.at("content-type"), "text/plain; version=0.0.4; charset=utf-8");
  const std::regex comment(R"(# (HELP|TYPE) [a-z_]+ .+)"), sample(R"([a-z_]+(\{status="\d+"\})? [0-9.e+-]+)");
  std::istringstream lines(metrics.body);
  int samples = 0;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_TRUE(std::regex_match(line, comment) || std::regex_match(line, sample)) << line;
    samples += line[0] != '#';
  }
  EXPECT_GT(samples, 10);
  EXPECT_EQ(metric("citylearn_dashboard_requests_total{status=\"404\"}"), 1);
}

TEST_F(ServerTest, SpeaksTls) {
  options_.tls_certificate = folder_ / "certificate.pem";
  options_.tls_key = folder_ / "key.pem";
  options_.token_file = folder_ / "token";
  options_.request_time = 2s;
  write_certificate(options_.tls_certificate, options_.tls_key);
  start();
  EXPECT_EQ(server_->url().substr(0, 8), "https://");
  EXPECT_EQ(get("/").body, "<!doctype html>");
  const auto login = get(server_->link().substr(server_->url().size()));
  const std::string cookie = login.headers.at("set-cookie");
  EXPECT_NE(cookie.find("; Secure"), std::string::npos);
  const WebClient::Headers known = {{"cookie", cookie.substr(0, cookie.find(';'))}};
  EXPECT_EQ(get("/api/large", known).body.size(), 8u << 20);
  const auto live = client();
  ASSERT_EQ(live->upgrade(known).status, 101);
  live->say(R"({"watch": ["services"]})");
  ASSERT_TRUE(testing::poll_until([&] { return watched("services"); }, WebClient::kPatience));
  hub_.publish("services", {}, bytes(100'000), Merge::kReplace);
  const auto news = news_of(live->take());
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, 100'000u);
  WebClient plain(server_->port());
  EXPECT_EQ(plain.get("/").status, 0) << "plain HTTP gets no answer";
  WebClient silent(server_->port());
  EXPECT_TRUE(silent.ended()) << "no TLS begun in time";
}

TEST_F(ServerTest, EndsAtOnceWhateverIsGoingOn) {
  start();
  const auto live = watching({"picture"}, 4096);
  for (int i = 0; i < 50; ++i) hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
  const auto half = client();
  half->send("GET / HT");
  const auto asking = client();
  asking->send("GET /api/a HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const auto begin = Clock::now();
  server_.reset();
  EXPECT_LT(Clock::now() - begin, 1s * testing::kSlowness);
  EXPECT_TRUE(half->ended());
  EXPECT_TRUE(live->ended());
  EXPECT_EQ(hub_.counts().clients, 0u);
}

TEST_F(ServerTest, WhatKeepsItFromListeningIsSaidInOneLine) {
  const auto refusal = [this](const ServerOptions& options) -> std::string {
    try {
      const Server server(options, hub_, {});
      return "";
    } catch (const Error& error) {
      return error.what();
    }
  };
  const auto says = [&](const ServerOptions& options, const std::string& part) {
    const std::string text = refusal(options);
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  start();
  ServerOptions options = options_;
  options.port = server_->port();
  says(options, "the port is in use");
  options.port = 0;
  options.listen = "0.0.0.0";
  says(options, "add --token-file");
  options.listen = "203.0.113.7";
  options.token_file = folder_ / "token";
  says(options, "cannot listen there");
  options.listen = "127.0.0.1";
  std::ofstream(folder_ / "token") << "0123456789abcdef";
  ::chmod((folder_ / "token").c_str(), 0644);
  says(options, "others may read it");
  options.token_file.clear();
  options.tls_certificate = folder_ / "none.pem";
  says(options, "--tls-key");
  options.tls_key = folder_ / "key.pem";
  says(options, "none.pem");
  write_certificate(folder_ / "none.pem", folder_ / "key.pem");
  EXPECT_EQ(refusal(options), "");
  write_certificate(folder_ / "other.pem", folder_ / "key.pem");
  says(options, "key.pem: is no key of that certificate");
  std::ofstream(folder_ / "key.pem") << "nonsense";
  says(options, "key.pem");
}

TEST(Dashboard, PrintsItsAddressServesAndEndsAtASignal) {
  const Folder folder;
  const auto command = [&](const std::string& port, const std::string& store) {
    return std::vector<std::string>{CITYLEARN_DASHBOARD,     "--port",    port,          "--domain",
                                    std::to_string(kDomain), "--session", "server-test", "--store",
                                    folder / store};
  };
  Service dashboard(command("0", "new/first.sqlite"), folder / "log");
  ASSERT_TRUE(dashboard.says("dashboard: http://127.0.0.1:", 20s)) << dashboard.output();
  const std::string output = dashboard.output(), start = "http://127.0.0.1:";
  const auto port = static_cast<std::uint16_t>(std::stoi(output.substr(output.find(start) + start.size())));
  WebClient client(port);
  EXPECT_EQ(Json::parse(client.get("/api/about").body)["run"], "server-test");
  EXPECT_EQ(Json::parse(client.get("/api/runs").body)["runs"], Json::array());
  EXPECT_NE(client.get("/metrics").body.find("\ncitylearn_dashboard_recording 1\n"), std::string::npos);
  Service second(command(std::to_string(port), "second.sqlite"), folder / "second");
  EXPECT_EQ(second.wait(20s), 1);
  EXPECT_NE(second.output().find("the port is in use"), std::string::npos) << second.output();
  dashboard.send(SIGINT);
  EXPECT_EQ(dashboard.wait(5s), 0) << dashboard.output();
}

TEST(Dashboard, ShowsATrainingWhileItRunsAndKeepsEachOfItsEpisodes) {
  const Folder folder;
  std::filesystem::create_directories(folder / "data");
  {
    Random random(1);
    std::ofstream features(folder / "data/summer.csv");
    for (int frame = 0; frame < 64; ++frame)
      for (int k = 0; k < 8; ++k) features << random.normal() << (k == 7 ? '\n' : ',');
  }
  const auto service = [&](std::vector<std::string> command, const std::string& log) {
    for (const std::string& word :
         {std::string("--domain"), std::to_string(kDomain + 1), std::string("--session"), std::string("watched")})
      command.push_back(word);
    return std::make_unique<Service>(command, folder / log);
  };
  const auto dashboard = service({CITYLEARN_DASHBOARD, "--port", "0", "--store", folder / "store"}, "dashboard.log");
  const std::string start = "http://127.0.0.1:";
  ASSERT_TRUE(dashboard->says(start, 20s)) << dashboard->output();
  const std::string output = dashboard->output();
  const auto port = static_cast<std::uint16_t>(std::stoi(output.substr(output.find(start) + start.size())));
  WebClient live(port);
  const auto asked = [&](const std::string& path) { return Json::parse(WebClient(port).get(path).body); };
  ASSERT_EQ(live.upgrade().status, 101);
  live.say(R"({"watch": ["services", "runs", "events", "scene:env-summer@watched"]})");

  const auto env = service({CITYLEARN_ENV_SERVICE, "--dataset", "plain", "--data", folder / "data", "--traversal",
                            "summer", "--agents", "4"},
                           "env.log");
  const auto policy = service({CITYLEARN_POLICY_SERVICE, "--agent", "place_filter", "--frames", "64", "--steps",
                               "150000", "--tasks", "30", "--evaluate", "summer", "--output", folder / "out"},
                              "policy.log");
  // The run's ID comes with the list of runs; then its training is watched too.
  std::map<std::string, int> frames;
  std::string id;
  bool trained = false, moved = false;
  const auto patience = Clock::now() + 60s;
  while ((!trained || !moved || frames["events"] == 0) && Clock::now() < patience) {
    const auto frame = live.take(1s);
    const auto news = news_of(frame);
    if (!news) continue;
    const std::string topic = news->header["topic"];
    ++frames[topic];
    const std::string payload = frame->payload.substr(frame->payload.size() - news->payload);
    if (topic == "runs" && id.empty()) {
      const Json runs = Json::parse(payload);
      for (const Json& run : runs["runs"])
        if (!run["policy"].is_null()) id = run["id"];
      if (!id.empty())
        live.say(Json{{"watch", {"services", "events", "scene:env-summer@watched", "training:" + id}}}.dump());
    }
    moved |= topic.substr(0, 5) == "scene" && news->header["agents"] == 4 && news->payload == 4u * 6 * 4;
    if (topic == "training:" + id) {
      trained = true;
      EXPECT_EQ(news->payload, news->header["rows"].get<std::size_t>() * news->header["columns"].size() * 8);
    }
  }
  EXPECT_TRUE(trained && moved) << policy->output();
  EXPECT_GT(frames["services"], 0);
  EXPECT_GT(frames["events"], 0);
  EXPECT_EQ(policy->wait(60s), 0) << policy->output();
  const std::string table = testing::contents(folder / "out/episodes.csv");
  const auto episodes = std::count(table.begin(), table.end(), '\n') - 1;
  EXPECT_GT(episodes, 30);
  EXPECT_TRUE(testing::poll_until(
      [&] { return asked("/api/about")["store"]["episodes"].get<std::int64_t>() >= episodes; }, 20s));
  EXPECT_EQ(asked("/api/about")["store"]["episodes"], episodes);

  const auto state = [&](const std::string& name) {
    const Json all = asked("/api/services");
    for (const Json& one : all["services"])
      if (one["id"] == name) return one["state"].get<std::string>();
    return std::string();
  };
  EXPECT_EQ(state("env-summer"), "waiting");
  env->send(SIGKILL);
  const auto killed = Clock::now();
  EXPECT_TRUE(testing::poll_until([&] { return state("env-summer") == "lost"; }, 20s));
  EXPECT_LT(Clock::now() - killed, 4s * testing::kSlowness);
  dashboard->send(SIGTERM);
  EXPECT_EQ(dashboard->wait(5s), 0) << dashboard->output();
}

}  // namespace
}  // namespace citylearn
