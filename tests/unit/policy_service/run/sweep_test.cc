// SPDX-License-Identifier: Apache-2.0
// Sweeps without a wire: which seeds are meant, figures over several runs, tables of runs that ended.
#include "policy_service/run/sweep.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/util/error.h"
#include "policy_service/results/comparison.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Seeds = std::vector<std::uint64_t>;
using Json = nlohmann::json;

TEST(Seeds, AreRangesAndLists) {
  EXPECT_EQ(parse_seeds("1..5"), (Seeds{1, 2, 3, 4, 5}));
  EXPECT_EQ(parse_seeds("7"), (Seeds{7}));
  EXPECT_EQ(parse_seeds("1,3,7"), (Seeds{1, 3, 7}));
  EXPECT_EQ(parse_seeds("9,1..3,0..0"), (Seeds{9, 1, 2, 3, 0}));
  EXPECT_EQ(parse_seeds("18446744073709551614..18446744073709551615").size(), 2u);
  EXPECT_EQ(parse_seeds("1..1000").size(), 1000u);
}

TEST(Seeds, WrongOnesAreNamed) {
  const std::map<std::string, std::string> cases = {{"5..1", "goes down"},
                                                    {"1..x", "'x'"},
                                                    {"x", "'x'"},
                                                    {"", "''"},
                                                    {"1,,2", "''"},
                                                    {"1,", "''"},
                                                    {"1..", "''"},
                                                    {"1...3", "'.3'"},
                                                    {"-1", "'-1'"},
                                                    {"1,2,1", "1 twice"},
                                                    {"1..3,2", "2 twice"},
                                                    {"1 2", "'1 2'"},
                                                    {"0..1000", "1000"},
                                                    {"0..18446744073709551615", "1000"},
                                                    {"18446744073709551616", "number"}};
  for (const auto& [text, wanted] : cases)
    EXPECT_TRUE(contains(error_of([&text = text] { parse_seeds(text); }), wanted));
}

TEST(Spread, IsWhatItsNamesSay) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Spread s = spread_of({4, 1, nan, 2, 9});
  EXPECT_EQ(s.count, 4);
  EXPECT_DOUBLE_EQ(s.mean, 4);
  EXPECT_DOUBLE_EQ(s.median, 3);
  EXPECT_DOUBLE_EQ(s.minimum, 1);
  EXPECT_DOUBLE_EQ(s.maximum, 9);
  EXPECT_DOUBLE_EQ(s.deviation, std::sqrt((9 + 4 + 0 + 25) / 3.0));
  EXPECT_DOUBLE_EQ(spread_of({3, 1, 2}).median, 2);
  EXPECT_EQ(spread_of({5}).deviation, 0);
  EXPECT_EQ(spread_of({nan}).count, 0);
}

/// A run that ended, as far as tables look at it.
void finished_run(const std::string& folder, const std::string& agent, const std::string& learner, double spl,
                  const Json& episodes_to_spl95) {
  std::filesystem::create_directories(folder);
  const auto score = [](double value) {
    return Json{{"completed", value}, {"spl", value},        {"excess", 1},
                {"mean_steps", 50},   {"shortest_mean", 43}, {"reward", value}};
  };
  const Json summary = {{"agent", agent},
                        {"middleware", "cyclonedds"},
                        {"seed", 1},
                        {"train",
                         {{"traversal", "summer"},
                          {"episodes", 900},
                          {"steps", 40000},
                          {"wall_s", 5.25},
                          {"steps_per_s", 7619},
                          {"reward", 0.9},
                          {"spl", spl},
                          {"episodes_to_spl95", episodes_to_spl95},
                          {"wall_s_to_spl95", episodes_to_spl95.is_null() ? Json() : Json(1.5)}}},
                        {"evaluate", {{"fall", score(spl)}}},
                        {"controls", {{"blind", {{"fall", score(0.852)}}}, {"shuffled", {{"fall", score(0.1)}}}}}};
  std::ofstream(folder + "/summary.json") << summary;
  std::ofstream(folder + "/manifest.json") << Json{{"learner", learner}};
}

TEST(Tables, PutRunsSideBySideAndControlsOnce) {
  Folder folder;
  finished_run(folder / "first", "place_filter", "ppo", 0.993, 141);
  finished_run(folder / "second", "features", "other", 0.944, nullptr);
  const std::string text = tables_of({folder / "first/", folder / "second/summary.json"});
  const auto line_with = [&text](const std::string& wanted) {
    for (const std::string& line : lines_of(text))
      if (line.find(wanted) != std::string::npos) return line;
    return std::string("no line with ") + wanted + " in\n" + text;
  };
  EXPECT_TRUE(contains(line_with("| first"), "99.3")) << text;
  EXPECT_TRUE(contains(line_with("| second"), "0.944")) << text;
  EXPECT_TRUE(contains(line_with("| second"), "other")) << text;
  EXPECT_TRUE(contains(line_with("| 40000"), "| 141 ")) << text;
  EXPECT_TRUE(contains(text, "features, shuffled"));
  EXPECT_EQ(occurrences(text, "blind"), 1) << text;
}

/// Of .97, .98, .96 against .93, .95, .94, seed by seed, learning gained .04, .03, .02. In rain it gained .01 less. On
/// average that is .035, .025, .015; where it trained does not count.
TEST(Tables, SayWhatLearningGainedInEachRun) {
  RunGroup group;
  group.agent = "place_filter";
  group.traversal = "late-fall, summer";
  group.seeds = {1, 2, 3};
  const auto add = [&](const char* policy, const char* traversal, const std::vector<double>& spl) {
    RunGroup::Row& row = group.rows.emplace_back(RunGroup::Row{policy, traversal, {}});
    for (const char* figure : {"completed", "spl", "mean_steps", "reward"}) row.figures[figure] = spl;
  };
  for (const char* traversal : {"rain", "fall", "summer"})
    add("place_filter", traversal,
        traversal == std::string("rain") ? std::vector{0.96, 0.97, 0.95} : std::vector{0.97, 0.98, 0.96});
  add("sequence_filter", "summer", {0.1, 0.1, 0.1});
  for (const char* traversal : {"rain", "fall"}) add("sequence_filter", traversal, {0.93, 0.95, 0.94});
  EXPECT_TRUE(contains(tables({group}),
                       "| gained by learning | -       | fall      | 3    | 3.0 (2.0..4.0)    | "
                       "0.030 (0.020..0.040) |"))
      << tables({group});
  EXPECT_EQ(gain_sentence(group), "Learning gained 0.025 SPL (0.015 to 0.035) over the untrained sequence_filter.\n");
  group.rows.resize(3);
  EXPECT_FALSE(contains(tables({group}), "gained")) << "nothing to compare with";
  EXPECT_EQ(gain_sentence(group), "");
  EXPECT_EQ(gain_sentence(std::vector{-0.0004}), "Learning gained 0.000 SPL over the untrained sequence_filter.");
}

TEST(Tables, NameWhatIsNoRun) {
  Folder folder;
  std::ofstream(folder / "nothing.txt") << "x";
  std::filesystem::create_directories(folder / "cut");
  std::ofstream(folder / "cut/summary.json") << "{\"agent\": \"pla";
  std::filesystem::create_directories(folder / "foreign");
  std::ofstream(folder / "foreign/summary.json") << "{\"colour\": 3}";
  std::filesystem::create_directories(folder / "sweep");
  std::ofstream(folder / "sweep/sweep.json") << "[1, 2]";
  for (const std::string name : {"nothing.txt", "cut", "foreign", "sweep", "nowhere"})
    EXPECT_TRUE(contains(error_of([&] { tables_of({folder / name}); }), folder / name));
  EXPECT_THROW(tables_of({}), Error);
}

TEST(Tables, RefuseFiguresThatCannotBe) {
  const Folder folder;
  const std::string path = folder / "a/summary.json";
  const auto refused = [&](double spl, const Json& episodes) {
    finished_run(folder / "a", "features", "ppo", spl, episodes);
    return error_of([&] { tables_of({folder / "a"}); });
  };
  const std::string remedy = " (was it edited? A run that ends writes it anew)";
  EXPECT_EQ(refused(1.5, 1), path + ": train: 'spl' is 1.5, not a number from 0 to 1" + remedy);
  EXPECT_EQ(refused(0.5, -1), path + ": train: 'episodes_to_spl95' is -1, not a number of 0 or more" + remedy);
  EXPECT_EQ(refused(0.5, "many"),
            path + ": train: 'episodes_to_spl95' is \"many\", not a number of 0 or more" + remedy);
  finished_run(folder / "a", "features", "ppo", 0.5, 1);
  Json sweep = Json::parse(sweep_json(read_summary(path), {}));
  make_file(folder / "a/sweep.json", sweep.dump());
  EXPECT_EQ(error_of([&] { tables_of({folder / "a"}); }), "");
  sweep["controls"]["blind"]["fall"]["completed"]["values"] = {true};
  make_file(folder / "a/sweep.json", sweep.dump());
  EXPECT_EQ(error_of([&] { tables_of({folder / "a"}); }),
            folder / "a/sweep.json: blind on fall: 'completed' is true, not a number from 0 to 1" + remedy);
}

}  // namespace
}  // namespace citylearn::testing
