// SPDX-License-Identifier: Apache-2.0
// Alarms of runs: raised once each, whatever happens to the dashboard.
#include "dashboard/alarms/alarms.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <thread>

#include "dashboard/logged/logged_runs.h"
#include "tests/support/files.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using When = AlarmRule::When;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class AlarmsTest : public ::testing::Test {
 protected:
  AlarmsTest() { open(); }

  /// Begins again with what is in the file, as a dashboard that was killed.
  void open() {
    alarms_.reset();
    runs_.reset();
    store_.reset();
    store_ = std::make_unique<Store>(Store::Options{path_, 0});
    runs_ = std::make_unique<LoggedRuns>(*store_);
    Alarms::Options options{std::chrono::milliseconds(0), [this] { return now_; }};
    options.on_event = [this](const Event& event) { events_.push_back(event); };
    alarms_ = std::make_unique<Alarms>(*store_, options);
  }

  static AlarmRule rule(When when, const std::string& figure, double value = 0, std::uint64_t points = 1) {
    AlarmRule made;
    made.when = when;
    made.figure = figure;
    made.value = value;
    made.points = points;
    return made;
  }
  std::int64_t add(const AlarmRule& made) {
    EXPECT_EQ(alarms_->refusal(made).value_or(""), "");
    return alarms_->add(made).id;
  }
  /// Logs points of `loss`, one a record, at the steps that follow.
  void log(const std::vector<double>& values, const std::string& run = "p/a", bool ended = false) {
    LogBatch batch(next_[run] + 1);
    batch.source = "python";
    batch.log = run;
    for (const double value : values) {
      batch.add("loss", static_cast<double>(10 * ++next_[run]), 1000, value);
      batch.points_done();
    }
    batch.ended = ended;
    ASSERT_EQ(runs_->append(run, batch).received, next_[run]);
  }
  /// Returns the texts of the events that a look brings.
  std::vector<std::string> look() {
    alarms_->poll();
    std::vector<std::string> texts;
    for (const Event& event : std::exchange(events_, {})) {
      EXPECT_EQ(event.kind, "alarm");
      texts.push_back(event.service + ": " + event.text);
    }
    return texts;
  }
  std::vector<std::string> lasting() {
    std::vector<std::string> texts;
    for (const RunAlarm& alarm : alarms_->alarms())
      if (!alarm.over) texts.push_back(alarm.run + ": " + alarm.text);
    return texts;
  }

  using Texts = std::vector<std::string>;

  Folder folder_;
  const std::string path_ = folder_ / "dashboard.sqlite";
  double now_ = seconds_since_epoch();
  std::map<std::string, std::uint64_t> next_;  // records so far, by run
  std::vector<Event> events_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<LoggedRuns> runs_;
  std::unique_ptr<Alarms> alarms_;
};

TEST_F(AlarmsTest, AFigureAboveAValueForSomePoints) {
  log({1});
  add(rule(When::kAbove, "loss", 5, 3));
  log({9, 9, 1, 9, 9});
  EXPECT_EQ(look(), Texts{});
  log({7});
  EXPECT_EQ(look(), (Texts{"p/a: loss above 5 for 3 points: 7 at step 70"}));
  EXPECT_EQ(lasting(), (Texts{"p/a: loss above 5 for 3 points: 7 at step 70"}));
  log({8, 8, 1, 1});
  EXPECT_EQ(look(), Texts{}) << "it lasts: neither raised again nor over yet";
  log({1});
  EXPECT_EQ(look(), (Texts{"p/a: resolved: loss above 5 for 3 points"}));
  EXPECT_EQ(lasting(), Texts{});
  ASSERT_EQ(alarms_->alarms().size(), 1u);
  EXPECT_EQ(alarms_->alarms()[0].over, now_);
  log({9, 9, 9});
  EXPECT_EQ(look().size(), 1u) << "another one";
}

TEST_F(AlarmsTest, OfWhatWasThereBeforeOnlyWhatTheRuleCountsMatters) {
  log({9, 9, 9, 1, 1, 9, 9});
  now_ += 10;
  add(rule(When::kAbove, "loss", 5, 3));
  EXPECT_EQ(look(), Texts{});
  add(rule(When::kAbove, "loss", 5, 2));
  EXPECT_EQ(look().size(), 1u);
}

TEST_F(AlarmsTest, StepsMayBeCountedInstead) {
  log({1});
  AlarmRule made = rule(When::kBelow, "loss", 0.5);
  made.steps = 30;
  add(made);
  log({0, 0, 0});
  EXPECT_EQ(look(), Texts{});
  log({0.25});
  EXPECT_EQ(look(), (Texts{"p/a: loss below 0.5 for 30 steps: 0.25 at step 50"}));
}

TEST_F(AlarmsTest, NumbersThatAreNone) {
  log({1});
  add(rule(When::kNotFinite, "loss"));
  add(rule(When::kAbove, "loss", 5));
  log({kNan});
  EXPECT_EQ(look(), (Texts{"p/a: loss is not finite: nan at step 20"})) << "NaN is above nothing";
  log({2, HUGE_VAL, 3});
  EXPECT_EQ(look(), (Texts{"p/a: resolved: loss is not finite", "p/a: loss is not finite: inf at step 40",
                           "p/a: resolved: loss is not finite", "p/a: loss above 5: inf at step 40",
                           "p/a: resolved: loss above 5"}));
}

TEST_F(AlarmsTest, AFigureThatCrossesTheBoundAllTheTimeRaisesFew) {
  log({1});
  add(rule(When::kAbove, "loss", 5));
  std::vector<double> values;
  for (int i = 0; i < 1000; ++i) values.insert(values.end(), {9, 1});
  log(values);
  EXPECT_LE(look().size(), 2u);
}

TEST_F(AlarmsTest, ManyPointsAtOnceAreLookedAtOneAfterTheOther) {
  add(rule(When::kAbove, "loss", 5));
  now_ += 120;
  std::vector<double> values(250'000, 1);
  values.back() = 9;
  log(values, "p/a", true);
  Texts all;
  for (int looks = 0; looks < 3; ++looks)
    for (const std::string& text : look()) all.push_back(text);
  EXPECT_EQ(all, (Texts{"p/a: loss above 5: 9 at step 2500000"}));
}

TEST_F(AlarmsTest, FiguresOfTrainings) {
  store_->record(run_info(0, 500, 1));
  AlarmRule made = rule(When::kBelow, "spl", 0.5, 2);
  made.runs = "demo/*";
  add(made);
  const auto train = [&](std::uint64_t update, float spl, std::uint64_t incarnation = 500) {
    msg::TrainingStat one = training_stat(update, incarnation);
    one.spl(spl);
    store_->record(std::vector<msg::TrainingStat>{one});
  };
  train(1, 0.25f);
  EXPECT_EQ(look(), Texts{});
  train(2, 0.125f);
  ASSERT_EQ(look().size(), 1u);
  EXPECT_TRUE(contains(lasting().at(0), "spl below 0.5 for 2 points: 0.125 at step"));
  // It goes back to an older checkpoint, where all is well.
  store_->record(run_info(1, 501, 1));
  train(2, 0.9f, 501);
  look();
  train(3, 0.9f, 501);
  train(4, 0.9f, 501);
  look();
  EXPECT_EQ(lasting(), Texts{});
}

TEST_F(AlarmsTest, SilenceAndLossAreRaisedWhileTheRunHasNotEnded) {
  log({1});
  AlarmRule silent = rule(When::kSilent, "");
  silent.minutes = 1;
  add(silent);
  add(rule(When::kLost, ""));
  EXPECT_EQ(look(), Texts{});
  now_ += 10;
  EXPECT_EQ(look(), (Texts{"p/a: the run is lost"}));
  now_ += 60;
  EXPECT_EQ(look(), (Texts{"p/a: no new point for 1 min"}));
  EXPECT_EQ(look(), Texts{});
  now_ = seconds_since_epoch();
  log({2});
  EXPECT_EQ(look(), (Texts{"p/a: resolved: no new point for 1 min", "p/a: resolved: the run is lost"}));
  log({3}, "p/a", true);
  EXPECT_EQ(look(), Texts{});
  now_ += 1000;
  EXPECT_EQ(look(), Texts{}) << "a run that has ended may be silent";
}

TEST_F(AlarmsTest, TheEndOfARunEndsItsAlarms) {
  log({1});
  add(rule(When::kAbove, "loss", 5));
  log({9}, "p/a", true);
  EXPECT_EQ(look().size(), 1u) << "its last points count";
  EXPECT_EQ(lasting(), Texts{});
  EXPECT_EQ(alarms_->alarms().size(), 1u);
  EXPECT_EQ(look(), Texts{});
}

TEST_F(AlarmsTest, AKilledDashboardRaisesNothingTwiceAndMissesNothing) {
  log({1});
  add(rule(When::kAbove, "loss", 5, 2));
  add(rule(When::kLost, ""));
  log({9, 9});
  EXPECT_EQ(look().size(), 1u);
  open();
  EXPECT_EQ(look(), Texts{});
  EXPECT_EQ(lasting().size(), 1u);
  log({9, 9, 1, 1});
  open();
  EXPECT_EQ(look(), (Texts{"p/a: resolved: loss above 5 for 2 points"}));
  log({9});
  look();
  open();
  log({8});
  EXPECT_EQ(look().size(), 1u) << "the first of the two points was kept, or is read again";
  now_ += 3600;
  open();
  EXPECT_EQ(look(), Texts{}) << "the dashboard was away, not the run";
  now_ += 10;
  EXPECT_EQ(look(), (Texts{"p/a: the run is lost"}));
  open();
  EXPECT_EQ(look(), Texts{});
  now_ += 10;
  EXPECT_EQ(look(), Texts{});
}

TEST_F(AlarmsTest, RulesAreForARunAPatternOrATag) {
  const auto fits = [](const std::string& runs) {
    AlarmRule made;
    made.runs = runs;
    return watches(made, "demo/policy/1/[7]", "night\nbase line\n");
  };
  for (const char* runs : {"*", "demo/*", "demo/policy/1/[7]", "*/1/*", "night", "base line"})
    EXPECT_TRUE(fits(runs)) << runs;
  for (const char* runs : {"demo", "nigh", "line", "other/*"}) EXPECT_FALSE(fits(runs)) << runs;
}

TEST_F(AlarmsTest, WrongRulesAreToldWhatIsWrong) {
  log({1});
  const auto refused = [&](const AlarmRule& wrong, const std::string& naming) {
    EXPECT_TRUE(contains(alarms_->refusal(wrong).value_or(""), naming));
  };
  refused(rule(When::kAbove, ""), "'figure' is missing");
  refused(rule(When::kAbove, "lost"), "none of the runs '*' has a figure 'lost': they have, for example, loss");
  refused(rule(When::kAbove, "loss", kNan), "'value' must be a finite number");
  refused(rule(When::kAbove, "loss", 1, 0), "'points' must be from 1");
  refused(rule(When::kSilent, ""), "'minutes' must be from");
  refused(rule(When::kAbove, "a\nb"), "'figure' must be");
  AlarmRule nobody = rule(When::kAbove, "loss");
  nobody.runs = "";
  refused(nobody, "'runs' must be");
  nobody.runs = "later/*";
  nobody.figure = "whatever";
  EXPECT_FALSE(alarms_->refusal(nobody)) << "its runs may come";
  for (std::size_t i = 0; i < kMostAlarmRules; ++i) add(rule(When::kLost, ""));
  refused(rule(When::kLost, ""), "100 rules already: remove one first");
}

TEST_F(AlarmsTest, RemovedRulesRemovedRunsAndDismissedAlarmsAreSilent) {
  log({1});
  const std::int64_t id = add(rule(When::kAbove, "loss", 5));
  log({9});
  look();
  const std::int64_t alarm = alarms_->alarms().at(0).id;
  EXPECT_TRUE(alarms_->dismiss(alarm));
  EXPECT_FALSE(alarms_->dismiss(alarm));
  EXPECT_EQ(lasting(), Texts{});
  log({9});
  open();
  EXPECT_EQ(look(), Texts{}) << "dismissed until its cause has gone";
  log({1, 9});
  EXPECT_EQ(look().size(), 2u);
  EXPECT_EQ(lasting().size(), 1u);
  EXPECT_TRUE(alarms_->remove(id));
  EXPECT_FALSE(alarms_->remove(id));
  EXPECT_TRUE(alarms_->alarms().empty());
  add(rule(When::kAbove, "loss", 5));
  log({9}, "p/b", true);
  look();
  EXPECT_EQ(store_->remove("p/b"), Store::Removal::kDone);
  next_.clear();
  log({9}, "p/b");
  EXPECT_EQ(look().size(), 1u) << "another run of this name";
}

TEST_F(AlarmsTest, MetricsNameRunAndRule) {
  log({1}, "p/a \"quoted\"");
  add(rule(When::kAbove, "loss", 5));
  log({9}, "p/a \"quoted\"");
  look();
  EXPECT_TRUE(
      contains(alarms_->metrics(), R"(citylearn_run_alarm{run="p/a \"quoted\"",rule="loss above 5",rule_id="1"} 1)"));
}

TEST_F(AlarmsTest, AThreadLooksByItself) {
  log({1});
  Alarms::Options options;
  options.period = std::chrono::milliseconds(5);
  Alarms looking(*store_, options);
  looking.add(rule(When::kAbove, "loss", 5));
  log({9});
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (looking.alarms().empty() && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  EXPECT_EQ(looking.alarms().size(), 1u);
}

}  // namespace
}  // namespace citylearn::testing
