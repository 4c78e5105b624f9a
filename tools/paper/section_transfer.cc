// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/chart/chart.h"
#include "tools/paper/beyond.h"
#include "tools/paper/curve.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

const std::vector<std::string> kControls = {"blind", "sequence_filter"};

/// Smoothing of trainings that have few updates.
constexpr double kLightly = 0.5;

/// What becomes of a trained agent on the second route.
struct Way {
  std::string label;
  bool carried = true;                ///< begins with its parameters
  std::vector<std::string> frozen{};  ///< tensors that stay as they were
};

const Way kScratch = {"learned anew", false};

/// All that train on the second route.
std::vector<Way> ways(const std::string& agent) {
  if (agent == "place_filter")
    return {{"all of it learns on"},
            {"head learns, filter frozen", true, {"filter"}},
            {"filter learns, head frozen", true, {"head"}},
            kScratch};
  return {{"all of it learns on"},
          {"input layer learns, rest frozen", true, {"lstm", "heads", "whereabouts"}},
          {"input layer frozen, rest learns", true, {"sensors"}},
          kScratch};
}

class Transfer : public Section {
 public:
  std::string name() const override { return "transfer"; }
  std::string title() const override { return "Beyond the paper: a policy on a second route"; }

  void plan(Context& context) const override {
    for (const Carriage& carriage : carriages(context)) {
      for (const std::uint64_t seed : carriage.seeds) {
        context.work.add(unit_of(source(context, carriage, seed), context.world));
        context.work.add(unit_of(as_it_is(context, carriage, seed), context.world));
        for (const Way& way : ways(carriage.agent))
          context.work.add(unit_of(study(context, carriage, way, seed), context.world));
      }
    }
    for (const std::string& control : kControls) context.work.add(unit_of(study(context, control), context.world));
  }

  void tell(const Context& context, Report& report) const override {
    const int frames = length(context);
    report.text(
        "An agent is trained on places 0 to " + std::to_string(frames - 1) + " of '" + context.world.train() +
        "' and carried to places " + std::to_string(frames) + " to " + std::to_string(2 * frames - 1) +
        ", another stretch of the " + (context.world.drawn() ? "drawn" : "real") +
        " recordings that it has never seen: as it is; trained there with all its parameters or with modules "
        "frozen (their tensors stay bit for bit as they were); and beside that one that begins there at "
        "random. Everybody learns by relabelling, on the second route from at most as many steps. "
        "place_filter is told the places of the route it is on, so that on the second one only that knowledge "
        "is exchanged; features has to learn what each place looks like. Its rest is memory (LSTM) and heads." +
        (context.quick ? " Quick: half of the recommended steps on the first route, a quarter on the second." : ""));
    for (const Carriage& carriage : carriages(context)) chart(context, report, carriage);
    tables(context, report);
    for (const Carriage& carriage : carriages(context)) judge(context, report, carriage);
  }

 private:
  /// Places of each of the two routes.
  static int length(const Context& context) { return std::min(context.frames, context.world.frames() / 2); }

  static Study source(const Context& context, const Carriage& carriage, std::uint64_t seed) {
    return source_of(context, context.world, carriage, seed, length(context));
  }
  static Carried as_it_is(const Context& context, const Carriage& carriage, std::uint64_t seed) {
    const Study from = source(context, carriage, seed);
    return {kept(from, context.world, context.work),
            from.representation,
            length(context),
            length(context),
            context.tasks(),
            context.world.names()};
  }
  static Study study(const Context& context, const Carriage& carriage, const Way& way, std::uint64_t seed) {
    const double share = context.quick ? 0.25 : 1;
    const Study from = source(context, carriage, seed);
    Study study = from;
    study.keep = false;
    study.first = length(context);
    study.steps = steps_of(context, carriage.agent, share);
    study.seconds = carriage.seconds * share * context.effort;
    study.traversals = context.world.names();
    if (way.carried) study.initial = kept(from, context.world, context.work);
    study.frozen = way.frozen;
    return study;
  }
  static ControlStudy study(const Context& context, const std::string& control) {
    return {control, seen_in(context.world), length(context), length(context), context.tasks(), context.world.names()};
  }

  static std::vector<Json> trained(const Context& context, const Carriage& carriage, const Way& way) {
    return outcomes_of(context.work, carriage.seeds,
                       [&](std::uint64_t seed) { return unit_of(study(context, carriage, way, seed), context.world); });
  }
  static std::vector<Json> carried(const Context& context, const Carriage& carriage) {
    std::vector<Json> all;
    for (const std::uint64_t seed : carriage.seeds)
      all.push_back(context.work.outcome(unit_of(as_it_is(context, carriage, seed), context.world).spec));
    return all;
  }
  static std::vector<Json> rows(const Context& context, const std::string& control) {
    return {context.work.outcome(unit_of(study(context, control), context.world).spec)};
  }
  static Estimate reached(const std::vector<Json>& outcomes) {
    std::vector<double> episodes;
    for (const Json& outcome : outcomes)
      episodes.push_back(outcome["spl95"].is_null() ? NAN : outcome["spl95"]["episodes"].get<double>());
    return of_mean(episodes, kCounts);
  }

  static void chart(const Context& context, Report& report, const Carriage& carriage) {
    const std::string& train = context.world.train();
    Chart chart{carriage.label + " on the second route", {"episodes on the second route"}, {"SPL", 0, 1}, {}};
    std::vector<double> ends;
    for (const Way& way : ways(carriage.agent)) {
      const std::vector<Json> outcomes = trained(context, carriage, way);
      chart.lines.push_back(outcomes.empty() ? Line{way.label, {}, {}}
                                             : mean_curve(way.label, outcomes, "spl", kLightly));
      if (!outcomes.empty()) ends.push_back(chart.lines.back().x.back());
    }
    chart.x = axis_around("episodes on the second route", ends, /*from_zero=*/true);
    const auto yardstick = [&](const std::string& label, const std::vector<Json>& outcomes) {
      const double spl = trials_on(outcomes, train).spl.mean;
      chart.lines.push_back({label, {0, chart.x.high}, {spl, spl}, {}, {}, -1, true});
    };
    yardstick("as it is, no training", carried(context, carriage));
    for (const std::string& control : kControls) yardstick(control, rows(context, control));
    chart.width = 560;
    chart.height = 300;
    report.figure("transfer-" + carriage.agent, chart,
                  chart.title + " ('" + train + "'): SPL of the episodes of training there, smoothed by " +
                      fixed(kLightly, 1) + ", " + kMeanOfSeeds + "; dashed: what trains no more. " +
                      "Command: " + context.command + " --only transfer");
  }

  static void tables(const Context& context, Report& report) {
    ReportTable table{"transfer",
                      "On the second route after training there, on each traversal: means over the same tasks for "
                      "everybody (over seeds, 95 % interval of the mean; one seed or control: of the share, Wilson).",
                      {"agent", "way", "traversal", "seeds x tasks", "completed", "SPL", "excess"},
                      {}};
    ReportTable training{
        "transfer-training",
        "Training on the second route, '" + context.world.train() +
            "': episodes until the last 100 of them have SPL 0.95 (95 % interval over the seeds that got there).",
        {"agent", "way", "seeds", "episodes to SPL 0.95", "there", "episodes in all", "steps"},
        {}};
    const auto add = [&](const std::string& agent, const std::string& way, const std::vector<Json>& outcomes) {
      for (const std::string& traversal : context.world.names()) {
        const Trials trials = trials_on(outcomes, traversal);
        if (trials.seeds == 0) continue;
        table.rows.push_back({agent, way, traversal, seeds_by_tasks(trials), percent(trials.completed),
                              text_of(trials.spl, 3), text_of(trials.excess, 2)});
      }
    };
    for (const Carriage& carriage : carriages(context)) {
      add(carriage.label, "as it is, no training", carried(context, carriage));
      for (const Way& way : ways(carriage.agent)) {
        const std::vector<Json> outcomes = trained(context, carriage, way);
        if (outcomes.empty()) continue;
        add(carriage.label, way.label, rows_of(outcomes));
        std::vector<double> episodes, steps;
        for (const Json& outcome : outcomes) {
          episodes.push_back(outcome["episodes"].get<double>());
          steps.push_back(outcome["steps"].get<double>());
        }
        const Estimate there = reached(outcomes);
        training.rows.push_back({carriage.label, way.label, std::to_string(outcomes.size()), text_of(there, 0),
                                 std::to_string(there.n) + " of " + std::to_string(outcomes.size()),
                                 text_of(of_mean(episodes, kCounts), 0), text_of(of_mean(steps, kCounts), 0)});
      }
    }
    for (const std::string& control : kControls) add(control, "learns nothing", rows(context, control));
    report.table(table);
    report.table(training);
  }

  static void judge(const Context& context, Report& report, const Carriage& carriage) {
    const std::string& train = context.world.train();
    const Estimate blind = trials_on(rows(context, "blind"), train).spl,
                   filter = trials_on(rows(context, "sequence_filter"), train).spl,
                   as_is = trials_on(carried(context, carriage), train).spl;
    const std::string spl = " (SPL " + fixed(as_is.mean, 3) + ")";
    if (as_is.mean <= blind.mean)
      report.remark(carriage.label + ": as it is it is lost on the second route" + spl + ": one that never looks has " +
                    fixed(blind.mean, 3) + ".");
    else if (worse(as_is, filter, 0.01))
      report.remark(carriage.label + ": as it is worse on the second route" + spl + " than the sequence filter, " +
                    fixed(filter.mean, 3) + ".");
    const std::vector<Json> anew = trained(context, carriage, kScratch);
    const Estimate anew_reached = reached(anew);
    for (const Way& way : ways(carriage.agent)) {
      const std::vector<Json> outcomes = trained(context, carriage, way);
      const std::string who = carriage.label + ", " + way.label + ": ";
      if (outcomes.size() < carriage.seeds.size())
        report.remark(who + std::to_string(carriage.seeds.size() - outcomes.size()) + " of " +
                      std::to_string(carriage.seeds.size()) + " trainings failed.");
      if (outcomes.empty()) continue;
      const Estimate there = reached(outcomes);
      if (there.n < static_cast<int>(outcomes.size()))
        report.remark(who + std::to_string(outcomes.size() - static_cast<std::size_t>(there.n)) + " of " +
                      std::to_string(outcomes.size()) +
                      " seeds did not get to SPL 0.95 on the second route within these steps.");
      if (!way.carried || anew_reached.n == 0) continue;
      if (there.n == 0 || there.mean >= anew_reached.mean)
        report.remark(who + "beginning with what was learned on the first route did not shorten the way to SPL 0.95 (" +
                      (there.n > 0 ? fixed(there.mean, 0) + " episodes" : "not reached") +
                      "; learned anew: " + fixed(anew_reached.mean, 0) + ").");
      const Estimate end = trials_on(rows_of(outcomes), train).spl, anew_end = trials_on(rows_of(anew), train).spl;
      if (worse(end, anew_end, 0.01))
        report.remark(who + "ends worse (SPL " + fixed(end.mean, 3) + ") than learned anew (" +
                      fixed(anew_end.mean, 3) + ").");
    }
  }
};

}  // namespace

std::unique_ptr<Section> make_transfer() { return std::make_unique<Transfer>(); }

}  // namespace citylearn::paper
