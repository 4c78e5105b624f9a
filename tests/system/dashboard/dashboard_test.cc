// SPDX-License-Identifier: Apache-2.0
// The dashboard as a program, with the services that it shows.
#include "tests/paths.h"
#include "tests/support/processes/domain.h"
#include "tests/support/text.h"
#include "tests/support/web/server_fixture.h"

namespace citylearn::testing {
namespace {

TEST(Dashboard, PrintsItsAddressServesAndEndsAtASignal) {
  const Folder folder;
  const std::string domain = std::to_string(own_domain());
  const auto command = [&](const std::string& port, const std::string& store) {
    return std::vector<std::string>{CITYLEARN_DASHBOARD, "--port",      port,      "--domain",    domain,
                                    "--session",         "server-test", "--store", folder / store};
  };
  Service dashboard(command("0", "new/first.sqlite"), folder / "log");
  ASSERT_TRUE(dashboard.says("dashboard: http://127.0.0.1:", 20s)) << dashboard.output();
  const std::string output = dashboard.output(), start = "http://127.0.0.1:";
  const auto port = static_cast<std::uint16_t>(std::stoi(output.substr(output.find(start) + start.size())));
  WebClient client(port);
  EXPECT_EQ(Json::parse(client.get("/api/about").body)["session"], "server-test");
  EXPECT_EQ(Json::parse(client.get("/api/runs").body)["runs"], Json::array());
  EXPECT_TRUE(contains(client.get("/metrics").body, "\ncitylearn_dashboard_recording 1\n"));
  Service second(command(std::to_string(port), "second.sqlite"), folder / "second");
  EXPECT_EQ(second.wait(20s), 1);
  EXPECT_TRUE(contains(second.output(), "the port is in use"));
  EXPECT_EQ(dashboard.end(SIGINT, 5s), 0) << dashboard.output();
}

}  // namespace
}  // namespace citylearn::testing
