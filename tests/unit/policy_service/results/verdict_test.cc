// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/verdict.h"

#include <gtest/gtest.h>

#include <map>
#include <regex>

#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// SPL by policy and traversal.
using Figures = std::vector<std::pair<std::string, std::map<std::string, double>>>;

std::vector<ScoreRow> rows_of(const Figures& figures) {
  std::vector<ScoreRow> rows;
  for (const auto& [policy, by_traversal] : figures)
    for (const auto& [traversal, spl] : by_traversal) {
      rows.push_back({policy, traversal, {}});
      rows.back().score.spl = spl;
    }
  return rows;
}

TEST(SplMatrix, FitsATerminalAndPutsTheAgentFirst) {
  const std::string text = spl_matrix("place_filter", rows_of({{"blind", {{"a-traversal-of-20-le", 0.85}}},
                                                               {"shuffled", {{"a-traversal-of-20-le", 0.76}}},
                                                               {"oracle_filter", {{"a-traversal-of-20-le", 1}}},
                                                               {"sequence_filter", {{"a-traversal-of-20-le", 0.97}}},
                                                               {"shortest_path", {{"a-traversal-of-20-le", 1}}},
                                                               {"place_filter", {{"a-traversal-of-20-le", 0.981}}}}));
  const auto lines = lines_of(text);
  ASSERT_EQ(lines.size(), 3u);
  for (const std::string& line : lines) EXPECT_LE(line.size(), 80u) << line;
  EXPECT_EQ(lines[0], "SPL                    place                   oracle  sequence  shortest");
  EXPECT_EQ(lines[1], "traversal             filter  blind  shuffled  filter    filter      path");
  EXPECT_EQ(lines[2], "a-traversal-of-20-le   0.981  0.850     0.760   1.000     0.970     1.000");
}

TEST(SplMatrix, LeavesOutWhatWasNotEvaluated) {
  const auto lines =
      lines_of(spl_matrix("features", rows_of({{"features", {{"fall", 1}}}, {"blind", {{"rain", 0.5}}}})));
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[2], "fall          1.000      -");
  EXPECT_EQ(lines[3], "rain              -  0.500");
}

TEST(Verdict, NamesWhereTheAgentFindsItsWay) {
  const std::string text = verdict("place_filter", rows_of({{"place_filter", {{"fall", 1}, {"rain", 0.97}}},
                                                            {"blind", {{"fall", 0.85}, {"rain", 0.85}}},
                                                            {"sequence_filter", {{"fall", 1}, {"rain", 0.975}}}}));
  EXPECT_EQ(text,
            "place_filter finds its way in fall, rain (SPL 0.970 to 1.000).\n"
            "Learning gained -0.003 SPL over the untrained sequence_filter.\n"
            "It pays where actions slip (docs/how-to/try-an-imperfect-world.md).\n");
}

// Of .95 and .92 against .93 and .8 learning gained .02 and .12, on average .07; what it trained on does not count.
TEST(Verdict, SaysWhatLearningGained) {
  EXPECT_EQ(verdict("place_filter",
                    rows_of({{"place_filter", {{"fall", 0.95}, {"rain", 0.92}, {"summer", 1}}},
                             {"sequence_filter", {{"fall", 0.93}, {"rain", 0.8}, {"summer", 0.5}}}}),
                    {{"summer"}, {}}),
            "place_filter finds its way in fall, rain (SPL 0.920 to 0.950).\n"
            "place_filter finds its way in summer, where it trained (SPL 1.000).\n"
            "Learning gained 0.070 SPL over the untrained sequence_filter.\n");
  const auto little = rows_of({{"place_filter", {{"fall", 0.95}}}, {"sequence_filter", {{"fall", 0.95}}}});
  EXPECT_FALSE(contains(verdict("place_filter", little, {.world = "slip0.1"}), "pays")) << "they do slip";
}

TEST(TakeWorld, LeavesNamesWhereWorldsDiffer) {
  const auto names_of = [](const std::string& one, const std::string& other) {
    std::vector<ScoreRow> rows = rows_of({{"blind", {{one, 0.5}, {other, 0.5}}}});
    VerdictOptions options{{one}, {{one, Pairing{3}}}, false};
    take_world(rows, options);
    EXPECT_EQ(options.trained_on.at(0), rows[0].traversal);
    EXPECT_TRUE(options.pairings.contains(rows[0].traversal));
    return std::vector<std::string>{rows[0].traversal, rows[1].traversal, options.world};
  };
  using Names = std::vector<std::string>;
  EXPECT_EQ(names_of("fall-slip0.1-kidnap1", "rain-slip0.1-kidnap1"), (Names{"fall", "rain", "slip0.1-kidnap1"}));
  EXPECT_EQ(names_of("fall", "rain-slip0.1"), (Names{"fall", "rain-slip0.1", ""}));
  EXPECT_EQ(names_of("fall-slip0.1", "rain-slip0.2"), (Names{"fall-slip0.1", "rain-slip0.2", ""}));
  EXPECT_EQ(names_of("fall-drop0.1", "rain-slip0.1-drop0.1"), (Names{"fall-drop0.1", "rain-slip0.1-drop0.1", ""}));
  EXPECT_EQ(names_of("old-town", "slippery-slip"), (Names{"old-town", "slippery-slip", ""}));
}

TEST(Verdict, SaysWhatAFailureHasToDoWithTheFrames) {
  const auto of = [](double own, double blind, double filter, double oracle) {
    const std::string text = verdict("features", rows_of({{"features", {{"night", own}}},
                                                          {"blind", {{"night", blind}}},
                                                          {"sequence_filter", {{"night", filter}}},
                                                          {"oracle_filter", {{"night", oracle}}}}));
    for (const std::string& line : lines_of(text)) EXPECT_LE(line.size(), 80u) << line;
    return std::regex_replace(text, std::regex("\n +|\n"), " ");  // whole sentences
  };
  std::string text = of(0.6, 0.85, 0.7, 0.99);
  EXPECT_TRUE(
      contains(text, "features is no better than blind, which never looks, in night (SPL 0.600, blind 0.850)."));
  EXPECT_TRUE(contains(text, "differ too much from the training's: sequence_filter reaches 0.700, and 0.990")) << text;
  text = of(0.6, 0.4, 0.55, 0.7);
  EXPECT_TRUE(contains(text, "finds its way only in part in night (SPL 0.600).")) << text;
  EXPECT_TRUE(contains(text, "look alike there: oracle_filter, which was given the very frames, reaches 0.700"))
      << text;
  text = of(0.9, 0.4, 0.97, 1);
  EXPECT_TRUE(
      contains(text, "worse than sequence_filter, which has learned nothing, in night (SPL 0.900, filter 0.970)"))
      << text;
  EXPECT_TRUE(contains(text, "The frames suffice")) << text;
}

// Whoever trains longer on the wrong data gains nothing.
TEST(Verdict, BlamesNoAgentOfUnknownData) {
  const std::vector<ScoreRow> rows =
      rows_of({{"features", {{"night", 0.9}}}, {"blind", {{"night", 0.4}}}, {"sequence_filter", {{"night", 0.97}}}});
  EXPECT_TRUE(contains(verdict("features", rows), "Train longer"));
  const std::string text = std::regex_replace(verdict("features", rows, {{}, {}, true}), std::regex("\n +|\n"), " ");
  EXPECT_FALSE(contains(text, "Train longer")) << text;
  EXPECT_TRUE(contains(text, "does not say what the agent learned from")) << text;
}

TEST(Verdict, SaysOnceWhatHoldsForSeveralTraversals) {
  const std::string text =
      verdict("features", rows_of({{"features", {{"fall", 1}, {"night", 0.5}, {"rain", 0.6}}},
                                   {"sequence_filter", {{"fall", 1}, {"night", 0.95}, {"rain", 1}}}}));
  EXPECT_EQ(text,
            "features finds its way in fall (SPL 1.000).\n"
            "features is worse than sequence_filter, which has learned nothing, in night,\n"
            "rain (SPL 0.500 to 0.600, filter 0.950 to 1.000).\n"
            "  The frames suffice: sequence_filter reaches 0.950 to 1.000. Train longer\n"
            "  (--steps) or try another agent.\n"
            "Learning gained -0.283 SPL over the untrained sequence_filter.\n");
}

TEST(Verdict, TellsAnAgentThatDoesNotLook) {
  const std::string text =
      verdict("features", rows_of({{"features", {{"fall", 0.92}}}, {"shuffled", {{"fall", 0.91}}}}));
  EXPECT_TRUE(contains(text, "does as well on shuffled frames")) << text;
  // In the dark it does not help to look.
  const auto rows =
      rows_of({{"features", {{"fall", 0.92}, {"night", 0.7}}}, {"shuffled", {{"fall", 0.6}, {"night", 0.7}}}});
  EXPECT_FALSE(contains(verdict("features", rows), "shuffled"));
}

TEST(Verdict, SetsApartWhatItTrainedOn) {
  EXPECT_EQ(verdict("features", rows_of({{"features", {{"fall", 0.95}, {"summer", 1}}}, {"blind", {{"fall", 0.8}}}}),
                    {{"summer"}, {}}),
            "features finds its way in fall (SPL 0.950).\n"
            "features finds its way in summer, where it trained (SPL 1.000).\n");
}

// On 128 places tasks are 43 steps long in the mean. With 10 steps nobody reaches most of the goals.
TEST(Verdict, BlamesAStepLimitThatIsTooLow) {
  std::vector<ScoreRow> rows = rows_of({{"features", {{"fall", 0.18}}},
                                        {"oracle_filter", {{"fall", 0.185}}},
                                        {"sequence_filter", {{"fall", 0.17}}},
                                        {"shortest_path", {{"fall", 0.185}}}});
  rows.back().score.completed = 0.18;
  EXPECT_EQ(verdict("features", rows),
            "features finds its way only in part in fall (SPL 0.180).\n"
            "  The step limit is too low: shortest_path, which sees its position, reaches 18\n"
            "  % of its goals. Raise --max-steps, or leave it out.\n"
            "Learning gained 0.010 SPL over the untrained sequence_filter.\n");
}

TEST(Verdict, BlamesThePairsBeforeTheFramesOrTheAgent) {
  EXPECT_EQ(verdict("features",
                    rows_of({{"features", {{"fast", 0.73}, {"fall", 0.7}, {"park", 0.6}}},
                             {"sequence_filter", {{"fast", 0.72}, {"fall", 0.72}, {"park", 0.61}}},
                             {"oracle_filter", {{"fast", 1}, {"fall", 1}, {"park", 1}}}}),
                    {{}, {{"fast", {.apart = 17}}, {"fall", {}}, {"park", {.unlike = true}}}}),
            "features finds its way only in part in fast (SPL 0.730).\n"
            "  The pairs are wrong there: by what they show, frames of one index are about 17\n"
            "  places apart. Have them matched by what they show (--align-by sight), or tell\n"
            "  which show the same place (DIR/matches.csv).\n"
            "features finds its way only in part in park (SPL 0.600).\n"
            "  No part of it looks like the training's, in whatever order: it may show\n"
            "  another street, or nothing that tells places apart. Look at it (citylearn data\n"
            "  check). If it is the right one, try another encoder (citylearn vpr compares\n"
            "  them).\n"
            "features finds its way only in part in fall (SPL 0.700).\n"
            "  The frames differ too much from the training's: sequence_filter reaches 0.720,\n"
            "  and 1.000 if given the very frames. Try another encoder (citylearn vpr\n"
            "  compares them) or more recordings to train on (--train A,B).\n"
            "Learning gained -0.007 SPL over the untrained sequence_filter.\n");
}

TEST(Verdict, IsEmptyWithoutAnythingToCompare) {
  EXPECT_EQ(verdict("features", rows_of({{"features", {{"fall", 1}}}})), "");
  EXPECT_EQ(verdict("features", {}), "");
}

}  // namespace
}  // namespace citylearn::testing
