// SPDX-License-Identifier: Apache-2.0
// The web server and HTTP clients that behave and that do not, and what one may cost the others.
#include <regex>

#include "tests/support/text.h"
#include "tests/support/web/server_fixture.h"

namespace citylearn::testing {
namespace {

TEST_F(RunningServerTest, ServesThePageWithStrictHeaders) {
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
    for (const std::string part :
         {"default-src 'self'; ", "img-src 'self' data: blob:; ", "connect-src 'self'; ", "style-src 'self'; ",
          "frame-ancestors 'none'; ", "base-uri 'none'; ", "form-action 'none'"})
      EXPECT_TRUE(contains(policy, part)) << part;
    EXPECT_EQ(response.headers.at("x-content-type-options"), "nosniff");
    EXPECT_EQ(response.headers.at("referrer-policy"), "no-referrer");
    EXPECT_EQ(response.headers.at("cross-origin-opener-policy"), "same-origin");
    EXPECT_EQ(response.headers.at("cross-origin-resource-policy"), "same-origin");
    EXPECT_EQ(response.headers.count("server") ? response.headers.at("server") : "citylearn", "citylearn");
  }
}

TEST_F(RunningServerTest, OneConnectionServesManyRequests) {
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
  EXPECT_TRUE(contains(page.body, "not built"));
  EXPECT_TRUE(contains(page.body, "npm"));
  EXPECT_EQ(get("/api/runs").status, 200);
}

TEST_F(RunningServerTest, TheApiGetsWhatWasAsked) {
  const auto one = client();
  const Json query = Json::parse(one->get("/api/runs/demo%2Fpolicy%2F1/training?columns=reward,spl&x=wall+time").body);
  EXPECT_EQ(query, Json({{"method", "GET"},
                         {"path", {"runs", "demo/policy/1", "training"}},
                         {"of", {{"columns", "reward,spl"}, {"x", "wall time"}}}}));
  EXPECT_EQ(Json::parse(one->request("DELETE", "/api/runs/a").body)["method"], "DELETE");
  EXPECT_EQ(one->request("PATCH", "/api/runs/a").status, 405);
  EXPECT_EQ(one->request("HEAD", "/api/runs").body, "");
  EXPECT_EQ(one->get("/api/runs/%zz").status, 400);
  EXPECT_EQ(one->get("/api/runs?a=1&a=2").status, 400);
  const auto put = one->request("PUT", "/api/runs");
  EXPECT_EQ(put.status, 405);
  EXPECT_EQ(put.headers.at("allow"), "GET, HEAD, DELETE");
  EXPECT_EQ(one->request("POST", "/").status, 405);
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
  ASSERT_TRUE(poll_until([&] { return this->slow() == 1; }, WebClient::kTimeout));
  waiting->send("GET /api/next HTTP/1.1\r\nHost: localhost\r\n\r\n");
  std::optional<WebClient::Response> third;
  // The second one waits from some moment on; from then on there is no room for a third.
  ASSERT_TRUE(poll_until([&] { return (third = get("/api/slow"))->status == 503; }, WebClient::kTimeout) ||
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

TEST_F(ServerTest, WithoutTheTokenNothingIsTold) {
  options_.token_file = folder_ / "token";
  start();
  const std::string token = contents(options_.token_file).substr(0, 64);
  for (const std::string target : {"/api/runs", "/metrics", "/api/live", "/login"}) {
    EXPECT_EQ(get(target).status, 401) << target;
    EXPECT_EQ(get(target, {{"authorization", "Bearer " + std::string(64, '0')}}).status, 401) << target;
    EXPECT_EQ(get(target, {{"cookie", "citylearn_" + std::to_string(server_->port()) + "=0"}}).status, 401) << target;
  }
  EXPECT_EQ(client()->upgrade().status, 401);
  EXPECT_EQ(get("/login?once=0").status, 401);
  const auto metrics = get("/metrics", {{"authorization", "Bearer " + token}});
  EXPECT_TRUE(contains(metrics.body, "citylearn_dashboard_guesses_total 5\n"));
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

TEST_F(RunningServerTest, StrangersAreRefused) {
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

TEST_F(RunningServerTest, AHeaderWithoutEndCostsNothing) {
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

TEST_F(RunningServerTest, WhatIsTooLargeOrMalformedIsNamed) {
  EXPECT_EQ(get("/", {{"x", std::string(40'000, 'x')}}).status, 431);
  EXPECT_EQ(get("/" + std::string(40'000, 'x')).status, 431);
  EXPECT_EQ(get("/", {{"x", std::string(30'000, 'x')}}).status, 200);
  EXPECT_EQ(client()->request("GET", "/api/runs", {}, std::string(66'000, 'x')).status, 413);
  EXPECT_EQ(get("/api/runs", {{"content-length", "99999999999"}}).status, 413);
  EXPECT_EQ(client()->request("DELETE", "/api/runs/a", {}, std::string(66'000, 'x')).status, 413);
  const auto chunked = client();
  chunked->send("GET /api/runs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n");
  for (int i = 0; i < 8; ++i) chunked->send("4000\r\n" + std::string(0x4000, 'c') + "\r\n");
  EXPECT_EQ(chunked->read().status, 413);
  for (const std::string text :
       {"\r\n\r\n", "nonsense\r\n\r\n", "GET / HTTP/9.9\r\n\r\n", "GET  HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
        "GET / HTTP/1.1\r\nHost : localhost\r\n\r\n", "GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nhost: localhost\r\n\r\n"}) {
    const auto one = client();
    one->send(text);
    EXPECT_EQ(one->read().status, 400) << text;
    EXPECT_TRUE(one->ended()) << "what follows may be meant for another host";
  }
}

TEST_F(ServerTest, ARequestThatDripsIsCutOffAndAnAnswerThatIsNotTaken) {
  options_.request_time = 300ms;
  start();
  const auto one = client(), idle = client();
  const auto begin = Clock::now();
  one->send("GET / HTTP/1.1\r\nX: ");
  EXPECT_TRUE(poll_until([&] { return !one->send("x") || one->ended(1ms); }, WebClient::kTimeout));
  EXPECT_GE(Clock::now() - begin, 250ms);
  EXPECT_LT(Clock::now() - begin, 5s * kSlowness);
  EXPECT_TRUE(idle->ended());
  const auto body = client();
  body->send("GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nbody");
  EXPECT_TRUE(body->ended()) << "a body that does not come";
  const auto large = client("127.0.0.1", 4096);
  large->send("GET /api/large HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_TRUE(poll_until([&] { return metric("citylearn_dashboard_connections") == 1; }, WebClient::kTimeout))
      << "an answer that is not taken";
}

TEST_F(RunningServerTest, AThousandIdleConnectionsLockNobodyOut) {
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
  EXPECT_TRUE(poll_until([&] { return get("/healthz").status == 200; }, WebClient::kTimeout));
}

TEST_F(RunningServerTest, MetricsAreInPrometheusTextFormat) {
  get("/none");
  const auto metrics = get("/metrics");
  EXPECT_EQ(metrics.headers.at("content-type"), "text/plain; version=0.0.4; charset=utf-8");
  const std::regex comment(R"(# (HELP|TYPE) [a-z_]+ .+)"), sample(R"([a-z_]+(\{status="\d+"\})? [0-9.e+-]+)");
  int samples = 0;
  for (const std::string& line : lines_of(metrics.body)) {
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
  const std::string path = server_->link().substr(server_->url().size());
  EXPECT_EQ(client()->request("HEAD", path).status, 405) << "who only looks at a link does not use it up";
  const auto login = get(path);
  EXPECT_EQ(login.status, 303);
  EXPECT_EQ(login.headers.at("location"), "/");
  EXPECT_EQ(get(path).status, 401) << "it logs in once";
  const std::string cookie = login.headers.at("set-cookie");
  EXPECT_TRUE(contains(cookie, "; Secure"));
  const WebClient::Headers known = {{"cookie", cookie.substr(0, cookie.find(';'))}};
  EXPECT_EQ(get("/api/large", known).body.size(), 8u << 20);
  const auto live = client();
  ASSERT_EQ(live->upgrade(known).status, 101);
  live->say(R"({"watch": ["services"]})");
  ASSERT_TRUE(poll_until([&] { return watched("services"); }, WebClient::kTimeout));
  hub_.publish("services", {}, bytes(100'000), Merge::kReplace);
  const auto news = news_of(live->take());
  ASSERT_TRUE(news);
  EXPECT_EQ(news->payload, 100'000u);
  WebClient plain(server_->port());
  EXPECT_EQ(plain.get("/").status, 0) << "plain HTTP gets no answer";
  WebClient silent(server_->port());
  EXPECT_TRUE(silent.ended()) << "no TLS begun in time";
}

TEST_F(RunningServerTest, EndsAtOnceWhateverIsGoingOn) {
  const auto live = watching({"picture"}, 4096);
  for (int i = 0; i < 50; ++i) hub_.publish("picture", {}, bytes(100'000), Merge::kReplace);
  const auto half = client();
  half->send("GET / HT");
  const auto asking = client();
  asking->send("GET /api/a HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const auto begin = Clock::now();
  server_.reset();
  EXPECT_LT(Clock::now() - begin, 1s * kSlowness);
  EXPECT_TRUE(half->ended());
  EXPECT_TRUE(live->ended());
  EXPECT_EQ(hub_.counts().clients, 0u);
}

TEST_F(ServerTest, WhatKeepsItFromListeningIsSaidInOneLine) {
  const auto refusal = [this](const ServerOptions& options) {
    return error_of([&] { const Server server(options, hub_, {}); });
  };
  const auto says = [&](const ServerOptions& options, const std::string& part) {
    const std::string text = refusal(options);
    EXPECT_TRUE(contains(text, part));
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
  options.tls_certificate = folder_ / "none.pem";
  says(options, "--tls-key");
  options.tls_key = folder_ / "key.pem";
  says(options, "none.pem");
  write_certificate(folder_ / "none.pem", folder_ / "key.pem");
  EXPECT_EQ(refusal(options), "");
  write_certificate(folder_ / "other.pem", folder_ / "key.pem");
  says(options, "key.pem: is not a readable key of that certificate");
  std::ofstream(folder_ / "key.pem") << "nonsense";
  says(options, "key.pem");
}

TEST_F(RunningServerTest, PagesOfOtherSitesGetNothing) {
  for (const std::string site : {"cross-site", "same-site"}) {
    for (const std::string target : {"/api/runs", "/metrics"}) {
      const auto refused = get(target, {{"sec-fetch-site", site}});
      EXPECT_EQ(refused.status, 403) << target;
      EXPECT_TRUE(contains(refused.body, site));
    }
    EXPECT_EQ(client()->upgrade({{"sec-fetch-site", site}}).status, 403);
    EXPECT_EQ(get("/", {{"sec-fetch-site", site}}).status, 200) << "a link to the page";
    EXPECT_EQ(get("/login", {{"sec-fetch-site", site}}).status, 303) << "a link that logs in";
  }
  for (const std::string site : {"same-origin", "none"})
    EXPECT_EQ(get("/api/runs", {{"sec-fetch-site", site}}).status, 200);
}

TEST_F(ServerTest, NoWorkIsDoneForAClientThatHasGone) {
  options_.workers = 1;
  options_.ping = 80ms;  // so it looks often
  start();
  const auto waiting = client();
  waiting->send("GET /api/slow HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_TRUE(poll_until([&] { return slow() == 1; }, WebClient::kTimeout));
  for (int i = 0; i < 100; ++i) client()->send("GET /api/slow HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const auto pipelined = client();  // says more than it is asked for, but is there
  pipelined->send("GET /api/a HTTP/1.1\r\nHost: localhost\r\n\r\nGET /api/b HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_TRUE(poll_until([&] { return metric("citylearn_dashboard_connections") == 3; }, WebClient::kTimeout))
      << "those that wait and the one that looks";
  release();
  EXPECT_EQ(waiting->read().status, 200);
  EXPECT_EQ(pipelined->read().status, 200);
  EXPECT_EQ(pipelined->read().status, 200);
  EXPECT_EQ(slow(), 1) << "calls that began";
}

TEST_F(ServerTest, ClientsThatHangLockNobodyOut) {
  options_.connections_each = 4;
  start();
  for (const std::string request : {"GET /api/runs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nbody",
                                    "GET /api/large HTTP/1.1\r\nHost: localhost\r\n\r\n"}) {
    std::vector<std::unique_ptr<WebClient>> hanging;
    for (int i = 0; i < 4; ++i) {
      hanging.push_back(client("127.0.0.1", 4096));
      hanging.back()->send(request);
      EXPECT_EQ(client("127.0.0.2")->get("/healthz").status, 200) << "the header has been read";
    }
    EXPECT_TRUE(poll_until([&] { return get("/healthz").status == 200; }, WebClient::kTimeout / 4));
    for (int i = 0; i < 8; ++i) EXPECT_EQ(get("/healthz").status, 200);
  }
}

}  // namespace
}  // namespace citylearn::testing
