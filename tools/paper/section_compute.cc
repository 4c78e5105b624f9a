#include <algorithm>
#include <cmath>

#include "tools/chart/chart.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

class Compute : public Section {
 public:
  std::string name() const override { return "figure-2"; }
  std::string title() const override { return "Fig. 2: what training costs"; }

  void plan(Context& context) const override {
    for (const Context::Agent& agent : context.agents)
      for (const std::uint64_t seed : agent.seeds) context.work.add(unit_of(context.study(agent, seed), context.world));
  }

  void tell(const Context& context, Report& report) const override {
    report.text(
        "How long an agent trains until its last 100 episodes have SPL 0.95, and the reward that it has in the "
        "end. Seconds are wall time on the machine that made this report, two threads, nothing on a wire; the "
        "paper trained for 11 minutes (64 features) and 29 h 48 min (raw images), which need not have been the "
        "same threshold.");
    Chart chart{"Training time and reward", {"training time, s", 0.1, 1000, true}, {"reward an episode", 0, 1}, {}};
    chart.width = 560;
    ReportTable table{
        "figure-2",
        "Time to SPL 0.95 and in all (95 % interval over seeds; seeds that did not get there are counted).",
        {"agent", "representation", "seeds", "s to SPL 0.95", "episodes to it", "there", "s in all", "steps/s"},
        {}};
    std::vector<double> features, raw;  // seconds a step
    for (const Context::Agent& agent : context.agents) {
      std::vector<double> seconds, episodes, all, rate;
      for (const Json& outcome : context.outcomes(agent)) {
        const Json& reached = outcome["spl95"];
        seconds.push_back(reached.is_null() ? NAN : reached["seconds"].get<double>());
        episodes.push_back(reached.is_null() ? NAN : reached["episodes"].get<double>());
        all.push_back(outcome["seconds"].get<double>());
        rate.push_back(outcome["steps"].get<double>() / outcome["seconds"].get<double>());
        if (agent.agent == "features") features.push_back(1 / rate.back());
        if (agent.agent == "raw_images") raw.push_back(1 / rate.back());
      }
      if (all.empty()) continue;
      const Estimate there = of_mean(seconds);
      table.rows.push_back({agent.label, agent.representation, std::to_string(all.size()), text_of(there, 1),
                            text_of(of_mean(episodes), 0),
                            std::to_string(there.n) + " of " + std::to_string(all.size()), text_of(of_mean(all), 1),
                            text_of(of_mean(rate), 0)});
      chart.lines.push_back(line(context, agent));
    }
    report.figure("figure-2", svg_of(chart),
                  "Reward while training, over seconds of training (smoothed, first seed of each agent). Command: " +
                      context.command + " --only figure-2");
    report.table(table);
    if (!features.empty() && !raw.empty())
      report.text("A training step on raw images costs " + fixed(of_mean(raw).mean / of_mean(features).mean, 1) +
                  " times one on features (paper, whole training: 163 times).");
  }

 private:
  static Line line(const Context& context, const Context::Agent& agent) {
    Line result{agent.label, {}, {}};
    const std::vector<Json> outcomes = context.outcomes(agent);
    std::vector<double> rewards;
    for (const Json& reward : outcomes.front()["curve"]["reward"])
      rewards.push_back(reward.is_number() ? reward.get<double>() : NAN);
    result.y = smoothed(rewards, 0.9);
    for (const Json& seconds : outcomes.front()["curve"]["seconds"]) result.x.push_back(seconds.get<double>());
    return result;
  }
};

}  // namespace

std::unique_ptr<Section> make_compute() { return std::make_unique<Compute>(); }

}  // namespace citylearn::paper
