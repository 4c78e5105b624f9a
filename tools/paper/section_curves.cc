// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/paper/curve.h"
#include "tools/paper/published.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

constexpr double kSmoothing = 0.9;

class Curves : public Section {
 public:
  std::string name() const override { return "figure-7"; }
  std::string title() const override { return "Fig. 7: training curves"; }

  void plan(Context& context) const override {
    for (const Context::Agent& agent : context.agents)
      for (const std::uint64_t seed : agent.seeds) context.work.add(unit_of(context.study(agent, seed), context.world));
  }

  void tell(const Context& context, Report& report) const override {
    report.text(
        "Episodes of training, each update's finished ones averaged, smoothed by " + fixed(kSmoothing, 1) + ", " +
        kMeanOfSeeds +
        ". The paper: 16 agents, five seeds; reward 0.99 (baseline), "
        "0.92 (NetVLAD-64), 0.80 (ResNet-64); just under and just over 50 steps an episode, about 75 on 512 features "
        "and more.");
    chart(context, report, "reward", "reward an episode");
    chart(context, report, "length", "steps an episode");
    ReportTable table{
        "figure-7",
        "At the end of training, mean over the last 500 episodes (95 % interval over seeds). An agent that "
        "never looks has reward 0.92 and SPL 0.85 on this task.",
        {"agent", "representation", "seeds", "episodes", "reward", "paper: reward", "SPL", "steps", "paper: steps",
         "episodes to SPL 0.95"},
        {}};
    for (const Context::Agent& agent : context.agents) {
      const std::vector<Json> outcomes = context.outcomes(agent);
      if (outcomes.empty()) continue;
      const auto of = [&](const auto& value) {
        std::vector<double> values;
        for (const Json& outcome : outcomes) values.push_back(value(outcome));
        return of_mean(values, kCounts);
      };
      const Estimate reached =
          of([](const Json& o) { return o["spl95"].is_null() ? NAN : o["spl95"]["episodes"].get<double>(); });
      const Estimate reward = final_values(outcomes, "reward"), steps = final_values(outcomes, "length");
      const auto known = published(agent.agent, context.features(agent));
      table.rows.push_back(
          {agent.label, agent.representation, std::to_string(outcomes.size()),
           text_of(of([](const Json& o) { return o["episodes"].get<double>(); }), 0), text_of(reward, 3),
           known ? fixed(known->reward, 2) : "-", text_of(final_values(outcomes, "spl"), 3), text_of(steps, 1),
           known ? known->steps : "-",
           text_of(reached, 0) + (reached.n < static_cast<int>(outcomes.size())
                                      ? " in " + std::to_string(reached.n) + " of " + std::to_string(outcomes.size())
                                      : "")});
      if (known && reward.mean < known->reward)
        report.remark("Worse than the paper: " + agent.label + " ends with reward " + text_of(reward, 3) + " (n = " +
                      std::to_string(reward.n) + " seeds), the paper's with " + fixed(known->reward, 2) + ".");
      if (known && steps.mean > known->as_many)
        report.remark("Worse than the paper: " + agent.label + " takes " + text_of(steps, 1) +
                      " steps an episode (n = " + std::to_string(steps.n) + " seeds), the paper's " + known->steps +
                      ".");
    }
    report.table(table);
  }

 private:
  static void chart(const Context& context, Report& report, const std::string& figure, const std::string& label) {
    Chart chart{"Training: " + label, {"episodes"}, {label}, {}};
    std::vector<double> ends, values = {figure == "reward" ? 1.0 : 0.0};
    for (const Context::Agent& agent : context.agents) {
      const std::vector<Json> outcomes = context.outcomes(agent);
      if (outcomes.empty()) continue;
      chart.lines.push_back(mean_curve(agent.label, outcomes, figure, kSmoothing));
      const Line& line = chart.lines.back();
      ends.push_back(line.x.back());
      values.insert(values.end(), line.y.begin(), line.y.end());
    }
    chart.x = axis_around("episodes", ends, /*from_zero=*/true);
    chart.y = axis_around(label, values);
    chart.width = 560;
    report.figure("figure-7-" + figure, chart,
                  label + " while training. Command: " + context.command + " --only figure-7");
  }
};

}  // namespace

std::unique_ptr<Section> make_curves() { return std::make_unique<Curves>(); }

}  // namespace citylearn::paper
