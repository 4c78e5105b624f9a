// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "tools/paper/curve.h"
#include "tools/paper/published.h"
#include "tools/paper/section.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

const std::vector<std::string> kControls = {"blind", "shortest_path", "sequence_filter"};

class Deployment : public Section {
 public:
  std::string name() const override { return "figure-8-9"; }
  std::string title() const override { return "Fig. 8 and 9: deployment and generalisation"; }

  void plan(Context& context) const override {
    for (const Context::Agent& agent : context.agents)
      for (const std::uint64_t seed : agent.seeds) context.work.add(unit_of(context.study(agent, seed), context.world));
    for (const ControlStudy& control : controls(context)) context.work.add(unit_of(control, context.world));
  }

  void tell(const Context& context, Report& report) const override {
    report.text(
        "Each 100 episodes of training the agent as it is then walks tasks on the traversal it learns from (Fig. "
        "8) and on those it never saw (Fig. 9): a random start, a random goal, at most as many steps as places. "
        "The paper tells how many were completed; completion alone cannot tell a navigator from an agent that "
        "sweeps the route without looking, so the success weighted by path length (SPL) stands beside it.");
    for (const std::string& traversal : context.world.names())
      for (const std::string figure : {"completed", "spl"}) chart(context, report, traversal, figure);
    trials(context, report);
    others(context, report);
  }

 private:
  static std::vector<ControlStudy> controls(const Context& context) {
    std::vector<ControlStudy> all;
    for (const std::string& name : kControls) {
      ControlStudy control;
      control.control = name;
      // Those that look do it on what most agents see.
      control.representation = context.agents.back().representation;
      control.frames = context.frames;
      control.tasks = context.tasks();
      control.traversals = context.world.names();
      all.push_back(control);
    }
    return all;
  }

  static void chart(const Context& context, Report& report, const std::string& traversal, const std::string& figure) {
    const bool learned = traversal == context.world.train();
    const std::string label = figure == "spl" ? "SPL" : "share of tasks completed";
    Chart chart{
        traversal + (learned ? " (learned from): " : " (never seen): ") + label, {"episodes"}, {label, 0, 1}, {}};
    chart.width = 560;
    chart.height = 260;
    std::vector<double> ends;
    for (const Context::Agent& agent : context.agents) {
      std::vector<std::map<double, double>> seeds;  // by episodes; checkpoints lie a little beyond each hundred
      std::set<double> checkpoints;
      for (const Json& outcome : context.outcomes(agent)) {
        seeds.emplace_back();
        for (const Json& row : outcome["deployments"]) {
          if (row["traversal"] != traversal) continue;
          const double episodes = 100 * std::floor(row["episodes"].get<double>() / 100);
          seeds.back()[episodes] = row[figure].get<double>();
          checkpoints.insert(episodes);
        }
      }
      std::vector<std::vector<double>> held;
      for (const std::map<double, double>& seed : seeds) {
        held.emplace_back();
        for (const double episodes : checkpoints)
          held.back().push_back(seed.contains(episodes) ? seed.at(episodes) : NAN);
        hold_last(held.back());
      }
      Line line{agent.label, {checkpoints.begin(), checkpoints.end()}, {}};
      for (std::size_t i = 0; i < line.x.size(); ++i) {
        std::vector<double> values;
        for (const std::vector<double>& seed : held) values.push_back(seed[i]);
        const Estimate estimate = of_mean(values, kShares);
        line.y.push_back(estimate.mean);
        line.low.push_back(estimate.low);
        line.high.push_back(estimate.high);
      }
      if (!line.x.empty()) ends.push_back(line.x.back());
      chart.lines.push_back(line);
    }
    chart.x = axis_around("episodes", ends, /*from_zero=*/true);
    for (const ControlStudy& control : controls(context)) {
      const Json& rows = context.work.outcome(unit_of(control, context.world).spec);
      for (const Json& row : rows)
        if (row["traversal"] == traversal) {
          const double value = row[figure].get<double>();
          chart.lines.push_back({control.control, {0, chart.x.high}, {value, value}, {}, {}, -1, true});
        }
    }
    report.figure((learned ? "figure-8-" : "figure-9-") + traversal + "-" + figure, chart,
                  chart.title + ", " + kMeanOfSeeds +
                      "; dashed: policies that learn nothing. Command: " + context.command + " --only figure-8-9");
  }

  static void trials(const Context& context, Report& report) {
    ReportTable table{
        "figure-8-9",
        "After training: means over the same tasks for everybody (agents: over seeds, 95 % interval of the "
        "mean; one seed or control: of the share, Wilson). Excess: steps / shortest path of completed tasks. "
        "Shuffled: completed when the frames are shown in a random order; an agent that looks must fail then.",
        {"policy", "traversal", "seeds x tasks", "completed", "failed", "SPL", "excess", "steps", "reward", "shuffled"},
        {}};
    for (const std::string& traversal : context.world.names()) {
      for (const Context::Agent& agent : context.agents) {
        const std::vector<Json> rows = rows_of(context.outcomes(agent));
        const Trials trials = trials_on(rows, traversal);
        if (trials.seeds == 0) continue;
        table.rows.push_back({agent.label, traversal, seeds_by_tasks(trials), percent(trials.completed),
                              fixed(100 * (1 - trials.completed.mean), 1) + " %", text_of(trials.spl, 3),
                              text_of(trials.excess, 2), text_of(trials.steps, 1), text_of(trials.reward, 3),
                              percent(trials_on(rows, traversal, /*shuffled=*/true).completed)});
      }
      for (const ControlStudy& control : controls(context))
        for (const Json& row : context.work.outcome(unit_of(control, context.world).spec)) {
          if (row["traversal"] != traversal) continue;
          const int tasks = row["tasks"].get<int>();
          const Estimate completed = of_share(row["completed"].get<double>() * tasks, tasks);
          table.rows.push_back({control.control, traversal, "1 x " + std::to_string(tasks), percent(completed),
                                fixed(100 * (1 - completed.mean), 1) + " %", fixed(row["spl"].get<double>(), 3),
                                fixed(row["excess"].is_number() ? row["excess"].get<double>() : NAN, 2),
                                fixed(row["steps"].get<double>(), 1), fixed(row["reward"].get<double>(), 3), "-"});
        }
    }
    report.table(table);
    worse_than_controls(context, report);
  }

  static void worse_than_controls(const Context& context, Report& report) {
    for (const ControlStudy& control : controls(context)) {
      if (control.control == "shortest_path") continue;  // nobody walks less
      std::string whose;
      for (const Json& row : context.work.outcome(unit_of(control, context.world).spec))
        for (const Context::Agent& agent : context.agents) {
          const std::string traversal = row["traversal"].get<std::string>();
          const Estimate spl = trials_on(rows_of(context.outcomes(agent)), traversal).spl;
          const double yardstick = row["spl"].get<double>();
          if (spl.n > 0 && spl.mean < yardstick)
            whose += (whose.empty() ? "" : "; ") + agent.label + " on " + traversal + " " + text_of(spl, 3) +
                     " against " + fixed(yardstick, 3);
        }
      if (!whose.empty())
        report.remark("Lower SPL than " + control.control +
                      (control.control == "blind" ? ", which never looks: " : ", which learns nothing: ") + whose +
                      ".");
    }
  }

  /// The agents that the paper's authors released, beside ours.
  static void others(const Context& context, Report& report) {
    ReportTable table{
        "figure-8-9-released",
        "The agents that the paper's authors released, measured by us (NetVLAD features of the first 128 frames "
        "of Nordland, 2,000 to 4,000 tasks), and ours: other recordings unless this report is on those, the "
        "same task.",
        {"policy", "traversal", "completed", "steps", "reward"},
        {}};
    for (const Released& released : kReleased) {
      table.rows.push_back(
          {released.label, std::string("Nordland ") + released.condition + (released.learned ? " (learned from)" : ""),
           fixed(100 * released.completed, 1) + " %", fixed(released.steps, 1), fixed(released.reward, 3)});
      const auto ours = std::find_if(context.agents.begin(), context.agents.end(),
                                     [&](const Context::Agent& agent) { return agent.agent == released.agent; });
      for (const std::string& traversal : context.world.names()) {
        if ((traversal == context.world.train()) != released.learned) continue;
        const Trials trials = trials_on(rows_of(context.outcomes(*ours)), traversal);
        const Estimate& completed = trials.completed;
        if (trials.seeds == 0) continue;
        table.rows.push_back({ours->label, traversal + (released.learned ? " (learned from)" : ""), percent(completed),
                              text_of(trials.steps, 1), text_of(trials.reward, 3)});
        // Of those never seen, the same condition alone can be worse or better.
        const bool alike = released.learned || context.world.recording(traversal).condition == released.condition;
        if (alike && completed.mean < released.completed - 0.0005)  // more than what both are rounded by
          report.remark(ours->label + " completes " + percent(completed) + " of the tasks on " + traversal +
                        " (n = " + std::to_string(trials.seeds) + " seeds), less than the " + released.label +
                        " on Nordland " + released.condition + ", " + fixed(100 * released.completed, 1) + " %.");
      }
    }
    report.table(table);
  }
};

}  // namespace

std::unique_ptr<Section> make_deployment() { return std::make_unique<Deployment>(); }

}  // namespace citylearn::paper
