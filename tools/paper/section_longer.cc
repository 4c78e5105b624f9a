// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/chart/chart.h"
#include "tools/paper/beyond.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

const std::vector<std::string> kControls = {"blind", "shortest_path", "sequence_filter"};

/// An agent on routes of several lengths.
struct Contestant {
  std::string agent, learner, label;
  std::vector<std::uint64_t> seeds;
  double seconds = 0;  ///< of one training on 128 places, guessed
};

class Longer : public Section {
 public:
  std::string name() const override { return "longer-routes"; }
  std::string title() const override { return "Beyond the paper: longer routes"; }

  void plan(Context& context) const override {
    for (const int frames : routes(context)) {
      for (const Contestant& contestant : contestants(context, frames))
        for (const std::uint64_t seed : contestant.seeds)
          context.work.add(unit_of(study(context, contestant, frames, seed), context.world));
      for (const std::string& control : kControls)
        context.work.add(unit_of(study(context, control, frames), context.world));
    }
  }

  void tell(const Context& context, Report& report) const override {
    report.text("The paper's routes have 128 places; here they have " + list(routes(context)) + " of " +
                (context.world.drawn() ? "the drawn recordings, " : "the real recordings, ") +
                "with as many steps as places for each task. place_filter learns by relabelling (the learner "
                "'relabel'), features by PPO, as it is recommended for 128 places, on at most " +
                std::to_string(most_for_features(context)) +
                (context.quick ? " places (the whole report: 512)" : " places, beyond which it would take hours") +
                ". Beside them what needs no learning: 'blind' sweeps without looking, 'shortest_path' knows "
                "its place, 'sequence_filter' is Bayes' rule by hand.");
    for (const std::string& traversal : context.world.names()) chart(context, report, traversal);
    tables(context, report);
    for (const int frames : routes(context)) remarks(context, report, frames);
  }

 private:
  static std::vector<int> routes(const Context& context) {
    std::vector<int> all = {context.frames};
    for (const int frames : {512, context.world.frames()})
      if (frames > all.back() && frames <= context.world.frames()) all.push_back(frames);
    return all;
  }
  static std::string list(const std::vector<int>& numbers) {
    std::string text;
    for (const int number : numbers) text += (text.empty() ? "" : ", ") + std::to_string(number);
    return text;
  }
  static int most_for_features(const Context& context) { return context.quick ? 128 : 512; }
  static std::vector<Contestant> contestants(const Context& context, int frames) {
    std::vector<Contestant> all = {{"place_filter", "relabel", "place_filter (ours)", context.seeds, 2}};
    if (frames <= most_for_features(context))
      all.push_back({"features", "ppo", "features (the paper's)", few_seeds(context), 60});
    return all;
  }
  /// Tasks of a trial: fewer where each takes long. Everybody has the same ones.
  static int tasks(const Context& context, int frames) {
    return frames <= 256 ? context.tasks() : std::max(10, context.tasks() * 256 / frames);
  }

  static Study study(const Context& context, const Contestant& contestant, int frames, std::uint64_t seed) {
    Study study;
    study.agent = contestant.agent;
    study.learner = contestant.learner;
    study.representation = seen_in(context.world);
    study.frames = frames;
    study.seed = seed;
    study.steps = context.steps(contestant.agent, contestant.learner);
    study.tasks = tasks(context, frames);
    study.tasks_between = context.tasks_between();
    study.traversals = context.world.names();
    // A filter over places costs as much as there are places.
    study.seconds =
        contestant.seconds * context.effort * (contestant.agent == "place_filter" ? std::max(1.0, frames / 200.0) : 1);
    if (contestant.learner == "ppo" && frames == context.frames) study.deploy_every = 100;  // as the other sections'
    return study;
  }
  static ControlStudy study(const Context& context, const std::string& control, int frames) {
    return {control, seen_in(context.world), 0, frames, tasks(context, frames), context.world.names()};
  }

  static std::vector<Json> outcomes(const Context& context, const Contestant& contestant, int frames) {
    return outcomes_of(context.work, contestant.seeds, [&](std::uint64_t seed) {
      return unit_of(study(context, contestant, frames, seed), context.world);
    });
  }
  static std::vector<Json> rows(const Context& context, const std::string& control, int frames) {
    return {context.work.outcome(unit_of(study(context, control, frames), context.world).spec)};
  }

  static void chart(const Context& context, Report& report, const std::string& traversal) {
    const bool learned = traversal == context.world.train();
    std::vector<Line> agents, controls;
    for (const std::string& control : kControls) controls.push_back({control, {}, {}, {}, {}, -1, true});
    for (const int frames : routes(context)) {
      const std::vector<Contestant> all = contestants(context, frames);
      for (std::size_t i = 0; i < all.size(); ++i) {
        if (i == agents.size()) agents.push_back({all[i].label, {}, {}});
        const Estimate spl = trials_on(rows_of(outcomes(context, all[i], frames)), traversal).spl;
        agents[i].x.push_back(frames);
        agents[i].y.push_back(spl.mean);
        agents[i].low.push_back(spl.low);
        agents[i].high.push_back(spl.high);
      }
      for (std::size_t i = 0; i < controls.size(); ++i) {
        controls[i].x.push_back(frames);
        controls[i].y.push_back(trials_on(rows(context, kControls[i], frames), traversal).spl.mean);
      }
    }
    const std::vector<int> all = routes(context);
    Chart chart{traversal + (learned ? " (learned from)" : " (never seen)") + ": SPL by length of the route",
                {"places on the route", all.front() * 0.9, all.back() * 1.1, true},
                {"SPL", 0, 1},
                agents};
    chart.lines.insert(chart.lines.end(), controls.begin(), controls.end());
    chart.height = 260;
    report.figure("longer-routes-" + traversal, chart,
                  chart.title + ", mean of the seeds with its 95 % interval; dashed: policies that learn nothing. " +
                      "Command: " + context.command + " --only longer-routes");
  }

  static void tables(const Context& context, Report& report) {
    ReportTable table{
        "longer-routes",
        "After training: means over the same tasks for everybody (agents: over seeds, 95 % interval of the mean; one "
        "seed or control: of the share, Wilson). Shuffled: completed when the frames are shown in a random order.",
        {"places", "policy", "traversal", "seeds x tasks", "completed", "SPL", "excess", "shuffled"},
        {}};
    ReportTable training{
        "longer-routes-training",
        "Training on '" + context.world.train() +
            "' (95 % interval over seeds): episodes until the last 100 of them have SPL 0.95 (fewer cannot tell), and "
            "how much was learned from in all.",
        {"places", "agent", "learner", "seeds", "episodes to SPL 0.95", "there", "episodes", "steps", "s"},
        {}};
    for (const int frames : routes(context)) {
      for (const Contestant& contestant : contestants(context, frames)) {
        const std::vector<Json> found = outcomes(context, contestant, frames);
        if (found.empty()) continue;
        for (const std::string& traversal : context.world.names()) {
          const Trials trials = trials_on(rows_of(found), traversal);
          table.rows.push_back({std::to_string(frames), contestant.label, traversal, seeds_by_tasks(trials),
                                percent(trials.completed), text_of(trials.spl, 3), text_of(trials.excess, 2),
                                percent(trials_on(rows_of(found), traversal, /*shuffled=*/true).completed)});
        }
        std::vector<double> reached, episodes, steps, seconds;
        for (const Json& outcome : found) {
          reached.push_back(outcome["spl95"].is_null() ? NAN : outcome["spl95"]["episodes"].get<double>());
          episodes.push_back(outcome["episodes"].get<double>());
          steps.push_back(outcome["steps"].get<double>());
          seconds.push_back(outcome["seconds"].get<double>());
        }
        const Estimate there = of_mean(reached, kCounts);
        training.rows.push_back({std::to_string(frames), contestant.label, contestant.learner,
                                 std::to_string(found.size()), text_of(there, 0),
                                 std::to_string(there.n) + " of " + std::to_string(found.size()),
                                 text_of(of_mean(episodes, kCounts), 0), text_of(of_mean(steps, kCounts), 0),
                                 text_of(of_mean(seconds, kCounts), 1)});
      }
      for (const std::string& control : kControls)
        for (const std::string& traversal : context.world.names()) {
          const Trials trials = trials_on(rows(context, control, frames), traversal);
          if (trials.seeds == 0) continue;
          table.rows.push_back({std::to_string(frames), control, traversal, seeds_by_tasks(trials),
                                percent(trials.completed), text_of(trials.spl, 3), text_of(trials.excess, 2), "-"});
        }
    }
    report.table(table);
    report.table(training);
  }

  /// Says where an agent is worse than what learns nothing.
  static void remarks(const Context& context, Report& report, int frames) {
    for (const Contestant& contestant : contestants(context, frames)) {
      const std::vector<Json> found = outcomes(context, contestant, frames);
      const std::string who = contestant.label + ", " + std::to_string(frames) + " places";
      if (found.size() < contestant.seeds.size())
        report.remark(who + ": " + std::to_string(contestant.seeds.size() - found.size()) + " of " +
                      std::to_string(contestant.seeds.size()) + " trainings failed.");
      judge(report, who, "on", context.world.names(), rows_of(found), rows(context, "blind", frames),
            rows(context, "sequence_filter", frames));
    }
  }
};

}  // namespace

std::unique_ptr<Section> make_longer() { return std::make_unique<Longer>(); }

}  // namespace citylearn::paper
