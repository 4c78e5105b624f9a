// SPDX-License-Identifier: Apache-2.0
// What one client or another site's page may cost the others.
#include "tests/support/text.h"
#include "tests/support/web/server_fixture.h"

namespace citylearn::testing {
namespace {

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
