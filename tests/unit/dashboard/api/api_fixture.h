// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "dashboard/api/api.h"
#include "dashboard/store/route_store.h"
#include "tests/support/files.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"
#include "tests/unit/dashboard/api/rows.h"

namespace citylearn::testing {

using Json = nlohmann::json;
using QueryParameters = std::map<std::string, std::string>;

/// A LiveView with one service, one event, a map, a picture.
class FakeLive : public LiveView {
 public:
  Json services() override { return {{"now", 5.0}, {"services", {{{"id", "env-summer"}}}}}; }
  Json events(std::size_t) override {
    return {
        {{"time", 2.0}, {"session", "demo"}, {"service", "env-summer"}, {"kind", "lost"}, {"text", "no heartbeat"}}};
  }
  std::optional<bool> alive(const std::string&, const std::string& id) override {
    return id == "policy" ? policy : std::nullopt;
  }
  std::optional<bool> policy;  ///< whether heartbeats of the policy_service arrive
  Json traversals(const std::string& run) override {
    if (run != "demo") return Json::array();
    return Json::parse(R"([{"environment":"env-fall","dataset":"synthetic","traversal":"fall","condition":"fall",
                            "hash":"00000000000000ab","frames":160,"agents":16,"images":true},
                           {"environment":"env-summer","dataset":"another"}])");
  }
  Map map(std::uint64_t hash) override {
    if (hash == 0xAB) return {Readiness::kHere, std::make_shared<RouteMap>(RouteMap{2, {0, 1}, {}, {}})};
    return {hash == 0xCD ? Readiness::kComing : Readiness::kNone};
  }
  Picture frame(std::uint64_t hash, std::uint32_t index) override {
    if (hash == 0xAB && index == 7) return {Readiness::kHere, "image/jpeg", "\xFF\xD8"};
    return {hash == 0xAB && index == 8 ? Readiness::kComing : Readiness::kNone, "", ""};
  }
};

class ApiTest : public ::testing::Test {
 protected:
  Folder folder_;
  Store store_{{folder_ / "dashboard.sqlite", 0}};
  FakeLive live_;
  Api::Options options_{"cyclonedds", "demo", 42, {}, 5};
  Api api_{options_, store_, &live_};
  const std::string id_ = run_id(run_info());

  Answer ask(const std::vector<std::string>& path, const QueryParameters& parameters = {},
             const std::string& method = "GET") {
    return api_.answer({method, path, parameters});
  }
  Json json(const std::vector<std::string>& path, const QueryParameters& parameters = {}) {
    const Answer answer = ask(path, parameters);
    EXPECT_EQ(answer.status, 200) << answer.body;
    EXPECT_EQ(answer.type, "application/json");
    return Json::parse(answer.body);
  }
  void expect_error(int status, const std::string& naming, const std::vector<std::string>& path,
                    const QueryParameters& parameters = {}, const std::string& method = "GET") {
    const Answer answer = ask(path, parameters, method);
    EXPECT_EQ(answer.status, status) << answer.body;
    EXPECT_TRUE(contains(Json::parse(answer.body).value("error", ""), naming));
  }
};

/// One whose store has a run.
class ApiRunTest : public ApiTest {
 protected:
  ApiRunTest() { store_.record(run_info()); }
};

inline std::vector<std::string> sorted(std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace citylearn::testing
