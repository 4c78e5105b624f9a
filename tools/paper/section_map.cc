// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/paper/beyond.h"
#include "tools/paper/curve.h"
#include "tools/paper/map_study.h"
#include "tools/paper/section.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

constexpr std::size_t kTraversals = 3;  // the one learned from and two that nobody has seen
constexpr double kSmoothing = 0.9;
constexpr const char* kReport = "map";

/// A row of the table: policies, and whether they have the junctions.
struct Walker {
  std::string policy, label;
  bool learns, junctions;
  std::vector<std::uint64_t> seeds;
  double seconds;
};

/// What is walked on: recordings that cross themselves, else a drawn map.
struct Ground {
  World& world;
  bool drawn;  ///< the map is
  Layout layout;
  std::string representation;
};

Ground ground_of(const Context& context) {
  const int places = context.quick ? 128 : 256;
  const World& world = context.world;
  const Layout recorded = recorded_layout(world.recording(world.train()), std::min(places, world.frames()));
  World& chosen = recorded.turns.empty() ? context.drawn : context.world;
  Layout layout = recorded.turns.empty() ? drawn_layout(std::min(places, chosen.frames())) : recorded;
  return {chosen, recorded.turns.empty(), std::move(layout), chosen.representations({64}).front()};
}

std::vector<Walker> walkers(const Context& context) {
  const std::vector<std::uint64_t>& all = context.seeds;
  const std::vector<std::uint64_t> few = few_seeds(context);
  std::vector<Walker> walkers;
  for (const bool junctions : {true, false}) {
    walkers.push_back({"place_filter", "place_filter (ours)", true, junctions, all, context.quick ? 8.0 : 20.0});
    walkers.push_back({"features", "features (the paper's)", true, junctions, few, context.quick ? 25.0 : 120.0});
    walkers.push_back({"sequence_filter", "sequence_filter", false, junctions, {1}, 1});
    walkers.push_back({"shortest_path", "shortest_path", false, junctions, {1}, 1});
  }
  walkers.push_back({"blind", "blind", false, false, {1}, 1});
  return walkers;
}

/// Those recommended; --quick: of the slow agent a third.
std::uint64_t training_steps(const Context& context, const std::string& agent) {
  const std::uint64_t asked = context.steps(agent);
  const double steps =
      asked > 0 ? static_cast<double>(asked) : Trainer::recommended_parameters(agent, "ppo").at("trainer").at("steps");
  return static_cast<std::uint64_t>(context.quick && agent == "features" ? std::max(1.0, steps / 3) : steps);
}

MapStudy study(const Context& context, const Ground& ground, const Walker& walker, std::uint64_t seed) {
  MapStudy study;
  study.policy = walker.policy;
  study.learns = walker.learns;
  study.junctions = walker.junctions;
  study.representation = ground.representation;
  study.layout = ground.layout;
  study.seed = seed;
  if (walker.learns) study.steps = training_steps(context, walker.policy);
  study.tasks = context.tasks();
  study.traversals = ground.world.names();
  study.traversals.resize(std::min(kTraversals, study.traversals.size()));
  study.seconds = walker.seconds * (walker.learns ? context.effort : 1);
  return study;
}

std::vector<Json> outcomes(const Context& context, const Ground& ground, const Walker& walker) {
  return outcomes_of(context.work, walker.seeds,
                     [&](std::uint64_t seed) { return unit_of(study(context, ground, walker, seed), ground.world); });
}

/// A figure of a trial: over the seeds, or of one seed over its tasks.
Estimate figure_of(const std::vector<Json>& outcomes, const std::string& traversal, const std::string& figure) {
  std::vector<double> means;
  Estimate one{NAN, NAN, NAN, 0};
  for (const Json& outcome : outcomes)
    for (const Json& row : outcome["trials"])
      if (row["traversal"] == traversal) {
        one = estimate_of(row[figure]);
        means.push_back(one.mean);
      }
  return means.size() > 1 ? of_mean(means, range_of(figure)) : one;
}

class Junctions : public Section {
 public:
  std::string name() const override { return kReport; }
  std::string title() const override { return "Beyond the paper: a map with junctions"; }

  void plan(Context& context) const override {
    const Ground ground = ground_of(context);
    for (const Walker& walker : walkers(context))
      for (const std::uint64_t seed : walker.seeds)
        context.work.add(unit_of(study(context, ground, walker, seed), ground.world));
  }

  void tell(const Context& context, Report& report) const override {
    const Ground ground = ground_of(context);
    introduce(ground, report);
    draw(context, ground, report);
    curves(context, ground, report);
    table(context, ground, report);
    judge(context, ground, report);
  }

 private:
  static void introduce(const Ground& ground, Report& report) {
    report.text(
        "The paper's future work: a route that crosses itself as a map on which agents choose among neighbours. Where "
        "two stretches come by the same spot, the nearest two of their places are joined: there the action 'stay' "
        "turns into the other road; everywhere else actions are as they were. The shortest way may then lead over "
        "junctions. The paper has no figures for this. place_filter and the policies that learn nothing know the map; "
        "features has to find out where it can turn, and the losses that help it to orient itself tell of the way "
        "along "
        "the route alone.");
    const std::string places = std::to_string(ground.layout.frames) + " places";
    if (ground.drawn)
      report.text(
          "There are no recordings here whose GPS shows that they cross themselves. These are " + places +
          " of the drawn city, whose straight street the program lays on a map by a rule, x = sin 3t, y = sin 2t, with "
          "10 m from place to place: " +
          junctions_told(ground.layout) +
          ". What an agent sees does not show the crossing roads: it cannot see that it stands at a junction, it has "
          "to know the place.");
    else
      report.text("The map is that of the recordings given, by their latitude and longitude. Of their frames " +
                  places + " from " + std::to_string(ground.layout.first) + " on, which cross themselves most often: " +
                  junctions_told(ground.layout) + " of places within 1.5 mean steps of each other. " +
                  (ground.world.drawn() ? "The recordings are drawn by the program." : "The recordings are real."));
  }

  /// The map, and where one agent walked with and without junctions.
  static void draw(const Context& context, const Ground& ground, Report& report) {
    Chart chart = map_of(ground.layout, "The map and one walk on it");
    std::vector<int> ends;
    std::vector<Walker> all = walkers(context);
    std::reverse(all.begin(), all.end());  // the way with junctions is drawn over the longer one
    for (const Walker& walker : all) {
      if (walker.policy != "place_filter") continue;
      const std::vector<Json> found = outcomes(context, ground, walker);
      if (found.empty()) continue;
      const Json& walk = found.front()["walk"];
      const auto places = walk["places"].get<std::vector<int>>();
      ends = {walk["start"].get<int>(), walk["goal"].get<int>()};
      chart.lines.push_back(on_the_map(
          ground.layout,
          (walker.junctions ? "with junctions: " : "without: ") + std::to_string(places.size() - 1) + " steps",
          places));
      chart.lines.back().dashed = !walker.junctions;
    }
    if (!ends.empty()) {
      chart.lines.push_back(on_the_map(ground.layout, "start", {ends[0]}));
      chart.lines.push_back(on_the_map(ground.layout, "goal", {ends[1]}));
      for (std::size_t i = chart.lines.size() - 2; i < chart.lines.size(); ++i) chart.lines[i].dots = true;
    }
    report.figure("map", chart,
                  "The route of '" + ground.world.train() + "' on the map. Of all tasks, the one for which junctions " +
                      "save most: the way of place_filter, first seed, when it has junctions and when it has none. " +
                      "Command: " + context.command + " --only " + kReport);
  }

  static void curves(const Context& context, const Ground& ground, Report& report) {
    Chart chart{"Training on the map", {"episodes"}, {"SPL", 0, 1}, {}};
    chart.width = 560;
    std::vector<double> ends;
    for (const Walker& walker : walkers(context)) {
      const std::vector<Json> found = outcomes(context, ground, walker);
      if (!walker.learns || found.empty()) continue;
      chart.lines.push_back(
          mean_curve(walker.label + (walker.junctions ? ", junctions" : ", without"), found, "spl", kSmoothing));
      ends.push_back(chart.lines.back().x.back());
    }
    if (ends.empty()) return;
    chart.x = axis_around("episodes", ends, /*from_zero=*/true);
    report.figure("map-training", chart,
                  "SPL while training on '" + ground.world.train() +
                      "', measured by the shortest way with junctions, " + "smoothed by " + fixed(kSmoothing, 1) +
                      ", " + kMeanOfSeeds + ". Command: " + context.command + " --only " + kReport);
  }

  static void table(const Context& context, const Ground& ground, Report& report) {
    ReportTable table{
        "map",
        "The same " + std::to_string(context.tasks()) + " tasks for everybody, at most " +
            std::to_string(ground.layout.frames) + " steps each, after learning on '" + ground.world.train() +
            "' with ppo. Intervals of 95 %: over seeds; of one seed and of policies that learn nothing, over tasks "
            "(completed: Wilson). SPL is measured by the shortest way with junctions for all; 'shortest' is the one "
            "that the policy could take; 'trained': environment steps of each training.",
        {"policy", "junctions", "traversal", "trained", "seeds x tasks", "completed", "SPL", "steps", "shortest"},
        {}};
    for (const std::string& traversal : traversals(ground))
      for (const Walker& walker : walkers(context)) {
        const std::vector<Json> found = outcomes(context, ground, walker);
        if (found.empty()) continue;
        const auto figure = [&](const char* name) { return figure_of(found, traversal, name); };
        table.rows.push_back({walker.label, walker.junctions ? "yes" : "no", traversal,
                              walker.learns ? std::to_string(training_steps(context, walker.policy)) : "-",
                              std::to_string(found.size()) + " x " + std::to_string(context.tasks()),
                              percent(figure("completed")), text_of(figure("spl"), 3), text_of(figure("steps"), 1),
                              fixed(figure("shortest").mean, 1)});
      }
    report.table(table);
  }

  /// Where an agent is no better than one with less, or than one that learned nothing.
  static void judge(const Context& context, const Ground& ground, Report& report) {
    const std::vector<Walker> all = walkers(context);
    const auto figure = [&](const char* name, const std::string& policy, bool junctions, const std::string& traversal) {
      for (const Walker& walker : all)
        if (walker.policy == policy && walker.junctions == junctions)
          return figure_of(outcomes(context, ground, walker), traversal, name).mean;
      return static_cast<double>(NAN);
    };
    for (const Walker& walker : all) {
      if (!walker.learns || !walker.junctions) continue;
      for (const std::string& traversal : traversals(ground)) {
        const auto compare = [&](const char* name, const std::string& policy, bool junctions, const std::string& what,
                                 const std::string& whom) {
          const double own = figure(name, walker.policy, true, traversal),
                       other = figure(name, policy, junctions, traversal);
          if (own < other && fixed(own, 3) != fixed(other, 3))  // neither is NaN
            report.remark("On '" + traversal + "' " + walker.label + " with junctions has " + what + " " +
                          fixed(own, 3) + ", less than " + whom + ": " + fixed(other, 3) + ".");
        };
        compare("completed", walker.policy, false, "a share of completed tasks of", "the same agent without them");
        compare("spl", walker.policy, false, "SPL", "the same agent without them");
        compare("spl", "sequence_filter", true, "SPL", "the sequence filter, which has learned nothing");
        compare("spl", "blind", false, "SPL", "the sweep that never looks");
      }
    }
  }

  static std::vector<std::string> traversals(const Ground& ground) {
    std::vector<std::string> names = ground.world.names();
    names.resize(std::min(kTraversals, names.size()));
    return names;
  }
};

}  // namespace

std::unique_ptr<Section> make_map() { return std::make_unique<Junctions>(); }

}  // namespace citylearn::paper
