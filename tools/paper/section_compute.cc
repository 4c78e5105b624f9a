// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/paper/curve.h"
#include "tools/paper/published.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

const std::vector<int> kDimensions = {64, 512, 2048, 4096};

/// A training of `features` on so many of them, seconds on two quiet processors.
double guess(int features) { return 60 + 0.04 * features; }

/// What the seeds of one agent took.
struct Cost {
  std::vector<double> threshold, episodes, all,
      step;  ///< seconds to SPL 0.95 (NaN: never), episodes to it, s, s a step
  std::vector<Json> outcomes;
};

class Compute : public Section {
 public:
  std::string name() const override { return "figure-2"; }
  std::string title() const override { return "Fig. 2: what training costs"; }

  void plan(Context& context) const override {
    for (const Context::Agent& agent : context.agents)
      for (const std::uint64_t seed : agent.seeds) context.work.add(unit_of(context.study(agent, seed), context.world));
    for (const Context::Agent& agent : wide(context))
      for (const std::uint64_t seed : agent.seeds)
        context.work.add(unit_of(study(context, agent, seed), context.world));
  }

  void tell(const Context& context, Report& report) const override {
    report.text(
        "How long an agent trains until its last 100 episodes have SPL 0.95, the threshold of this figure, and the "
        "reward that it has in the end. Seconds are wall time on the machine that made this report, nothing on a wire. "
        "The paper trained for 11 minutes on 64 features and for 29 h 48 min on raw images, until its curves were "
        "flat: another threshold, another machine. Trainings on more than 64 features are tried on no other "
        "traversal.");
    Chart dots{
        "Time to SPL 0.95 and final reward", {"training time to SPL 0.95, s"}, {"reward an episode, in the end"}, {}};
    Chart curves{"Training time and reward", {"training time, s"}, {"reward an episode", -1, 1}, {}};
    dots.width = curves.width = 560;
    ReportTable table{
        "figure-2",
        "Time to SPL 0.95 and in all (95 % interval over seeds; seeds that did not get there are counted).",
        {"agent", "representation", "seeds", "s to SPL 0.95", "episodes to it", "there", "s in all", "steps/s",
         "paper: training", "reward", "paper: reward", "steps", "paper: steps"},
        {}};
    std::vector<double> reached, rewards, taken;
    Cost features, raw;
    for (const Context::Agent& agent : everybody(context)) {
      const Cost cost = cost_of(context, agent);
      if (cost.outcomes.empty()) continue;
      if (agent.agent == "features" && features.outcomes.empty()) features = cost;
      if (agent.agent == "raw_images") raw = cost;
      Line line{label(context, agent), cost.threshold, {}};
      line.dots = true;
      std::vector<double> rate;
      for (const Json& outcome : cost.outcomes) line.y.push_back(final_value(outcome, "reward"));
      for (const double step : cost.step) rate.push_back(1 / step);
      reached.insert(reached.end(), line.x.begin(), line.x.end());
      for (std::size_t i = 0; i < line.y.size(); ++i)
        if (std::isfinite(line.x[i])) rewards.push_back(line.y[i]);
      curves.lines.push_back(curve(line.label, cost.outcomes.front()));
      taken.insert(taken.end(), curves.lines.back().x.begin(), curves.lines.back().x.end());
      const Estimate there = of_mean(cost.threshold, kCounts);
      const auto known = published(agent.agent, context.features(agent));
      table.rows.push_back({agent.label, agent.representation, std::to_string(cost.all.size()), text_of(there, 1),
                            text_of(of_mean(cost.episodes, kCounts), 0),
                            std::to_string(there.n) + " of " + std::to_string(cost.all.size()),
                            text_of(of_mean(cost.all, kCounts), 1), text_of(of_mean(rate, kCounts), 0),
                            training(context, agent), text_of(of_mean(line.y, kRewards), 3),
                            known ? fixed(known->reward, 2) : "-", text_of(final_values(cost.outcomes, "length"), 1),
                            known ? known->steps : "-"});
      if (there.n < static_cast<int>(cost.all.size()))
        report.remark(line.label + ": " + std::to_string(cost.all.size() - static_cast<std::size_t>(there.n)) + " of " +
                      std::to_string(cost.all.size()) + " seeds did not reach SPL 0.95.");
      dots.lines.push_back(std::move(line));
    }
    dots.x = decades_around(dots.x.label, reached);
    dots.y = axis_around(dots.y.label, rewards);
    curves.x = decades_around(curves.x.label, taken);
    const std::string made = " Command: " + context.command + " --only figure-2";
    report.figure(
        "figure-2", dots,
        "Each dot a seed: time to SPL 0.95, and mean reward of the last 500 episodes. Seeds that never got there "
        "have no dot." +
            made);
    report.figure("figure-2-curves", curves,
                  "Reward while training, over seconds of training (smoothed, first seed of each agent)." + made);
    report.table(table);
    if (!features.outcomes.empty() && !raw.outcomes.empty()) ratios(features, raw, report);
  }

 private:
  /// The paper's agent on more features than the others compare it on, as many as the data allow.
  static std::vector<Context::Agent> wide(const Context& context) {
    const auto narrow = std::find_if(context.agents.begin(), context.agents.end(),
                                     [](const Context::Agent& agent) { return agent.agent == "features"; });
    const std::string encoder = narrow->representation.substr(0, narrow->representation.rfind('-') + 1);
    std::vector<Context::Agent> agents;
    for (const std::string& representation : context.world.representations(kDimensions)) {
      Context::Agent agent = *narrow;
      agent.representation = representation;
      if (!representation.starts_with(encoder) || context.features(agent) <= context.features(*narrow)) continue;
      // Seconds grow with the features: fewer seeds.
      agent.seeds.resize(std::min<std::size_t>(agent.seeds.size(), context.features(agent) <= 512 ? 3 : 1));
      agent.seconds = guess(context.features(agent));
      agents.push_back(agent);
    }
    if (context.quick && agents.size() > 1) agents.erase(agents.begin(), agents.end() - 1);
    return agents;
  }

  static Study study(const Context& context, const Context::Agent& agent, std::uint64_t seed) {
    Study study = context.study(agent, seed);
    study.deploy_every = 0;
    study.traversals = {context.world.train()};
    return study;
  }

  static std::vector<Context::Agent> everybody(const Context& context) {
    std::vector<Context::Agent> all = context.agents;
    for (const Context::Agent& agent : wide(context)) all.push_back(agent);
    return all;
  }

  static std::string label(const Context& context, const Context::Agent& agent) {
    return agent.agent == "features" ? "features, " + std::to_string(context.features(agent)) : agent.label;
  }

  static std::string training(const Context& context, const Context::Agent& agent) {
    if (agent.agent == "raw_images") return "29 h 48 min";
    return agent.agent == "features" && context.features(agent) == 64 ? "11 min" : "-";
  }

  static Cost cost_of(const Context& context, const Context::Agent& agent) {
    const bool shared = std::any_of(context.agents.begin(), context.agents.end(), [&](const Context::Agent& one) {
      return one.agent == agent.agent && one.representation == agent.representation;
    });
    Cost cost;
    for (const std::uint64_t seed : agent.seeds) {
      const Study one = shared ? context.study(agent, seed) : study(context, agent, seed);
      const Json& outcome = context.work.outcome(unit_of(one, context.world).spec);
      if (outcome.is_null()) continue;
      const Json& reached = outcome["spl95"];
      cost.threshold.push_back(reached.is_null() ? NAN : reached["seconds"].get<double>());
      cost.episodes.push_back(reached.is_null() ? NAN : reached["episodes"].get<double>());
      cost.all.push_back(outcome["seconds"].get<double>());
      cost.step.push_back(outcome["seconds"].get<double>() / outcome["steps"].get<double>());
      cost.outcomes.push_back(outcome);
    }
    return cost;
  }

  static Line curve(const std::string& label, const Json& outcome) {
    return {label, numbers(outcome["curve"]["seconds"]), smoothed(numbers(outcome["curve"]["reward"]), 0.9)};
  }

  static void ratios(const Cost& features, const Cost& raw, Report& report) {
    const double paper = kPaperRawMinutes / kPaperFeatureMinutes;
    const double step = of_mean(raw.step).mean / of_mean(features.step).mean;
    const double threshold = of_mean(raw.threshold).mean / of_mean(features.threshold).mean;
    report.text("Raw images against features: a training step costs " + fixed(step, 1) + " times as much, " +
                (std::isfinite(threshold) ? "the way to SPL 0.95 " + fixed(threshold, 1) + " times"
                                          : "the way to SPL 0.95 cannot be compared, for one of them never got there") +
                " (seeds: " + std::to_string(raw.all.size()) + " and " + std::to_string(features.all.size()) +
                "; paper, whole training: " + fixed(paper, 0) + " times).");
    if (step > paper || threshold > paper)
      report.remark("Raw images cost more here, against features, than in the paper.");
    const double minutes = of_mean(features.all).mean / 60;
    if (minutes > kPaperFeatureMinutes)
      report.remark("Training on features took " + fixed(minutes, 1) + " minutes, longer than the paper's 11.");
  }
};

}  // namespace

std::unique_ptr<Section> make_compute() { return std::make_unique<Compute>(); }

}  // namespace citylearn::paper
