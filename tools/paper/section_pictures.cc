// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/paper/curve.h"
#include "tools/paper/section.h"
#include "tools/paper/walk.h"

namespace citylearn::paper {
namespace {

constexpr int kPictures = 9;  // a strip

/// The agents that see, on recordings that have pictures.
std::vector<Study> studies(const Context& context) {
  std::vector<Study> all;
  for (const Context::Agent& agent : context.agents) {
    if (agent.agent == "baseline") continue;
    Study study = context.study(agent, agent.seeds.front());
    all.push_back(study);
  }
  if (context.world.pictures()) return all;
  // On the drawn city: the paper's two agents, each on what it is meant for.
  const std::vector<std::string> known = context.drawn.representations({64});
  const auto features = std::find_if(all.begin(), all.end(), [](const Study& one) { return one.agent == "features"; });
  std::vector<Study> two = {*features, *features};
  two[0].representation = known.front();
  two[1].agent = "raw_images";
  two[1].representation = known.back();
  for (Study& study : two) {
    study.frames = std::min(128, context.drawn.frames());
    study.traversals = context.drawn.names();
    study.deploy_every = 0;
    study.steps = context.steps(study.agent, study.learner);
    study.seconds = (study.agent == "features" ? 100 : 200) * context.effort;
  }
  return two;
}

/// The trial of an agent on a traversal; null when there is none.
Json trial(const Context& context, World& world, const Study& study, const std::string& traversal) {
  const Json& outcome = context.work.outcome(unit_of(study, world).spec);
  if (!outcome.is_null())
    for (const Json& row : outcome["trials"])
      if (row["traversal"] == traversal && !row["shuffled"].get<bool>()) return row;
  return nullptr;
}

class Walks : public Section {
 public:
  std::string name() const override { return "figure-10"; }
  std::string title() const override { return "Fig. 10: one goal, by day and by night"; }

  void plan(Context& context) const override {
    for (const Study& study : studies(context)) context.work.add(unit_of(study, world_of(context)));
  }

  void tell(const Context& context, Report& report) const override {
    World& world = world_of(context);
    const std::vector<Study> all = studies(context);
    const std::string hard = hardest(context, world, all);
    report.text(
        "Where agents go on one task, the same for all: of the first 20 tasks of the trials after training the one "
        "with the longest way. " +
        (shows(context, world)
             ? "Each strip begins at the start and ends where the episode ends, at the goal or after " +
                   std::to_string(all.front().frames) + " steps; below each picture the place and the step. "
             : std::string("Without pictures, as asked for (--no-strips). ")) +
        "'" + world.train() + "' is learned from, '" + hard + "' was never seen" +
        (hard == "night" ? "." : " and is the one that the agent on features does worst on (there is no 'night').") +
        (world.drawn() ? " The recordings are drawn." : " The recordings are real.") +
        (&world != &context.world ? " The data given have no pictures: the agents of this section were trained in a "
                                    "drawn city."
                                  : ""));
    std::vector<std::string> conditions = {world.train()};
    if (hard != world.train()) conditions.push_back(hard);
    for (const std::string& traversal : conditions) {
      Chart chart{
          traversal + (traversal == world.train() ? " (learned from)" : " (never seen)"), {"step"}, {"place"}, {}};
      chart.width = 560;
      chart.height = 300;
      std::vector<Strip> strips;
      std::vector<double> steps = {0}, places;
      Json walk;
      for (const Study& study : all) {
        const Json row = trial(context, world, study, traversal);
        if (row.is_null()) continue;
        walk = row["walk"];
        strips.push_back(strip_of(study, walk, world.recording(traversal)));
        Line line{study.agent, {}, numbers(walk["frames"])};
        for (std::size_t i = 0; i < line.y.size(); ++i) line.x.push_back(static_cast<double>(i));
        steps.push_back(line.x.back());
        places.insert(places.end(), line.y.begin(), line.y.end());
        chart.lines.push_back(line);
      }
      if (strips.empty()) continue;
      chart.x = axis_around("step", steps);
      const double goal = walk["goal"].get<double>(), start = walk["frames"].front().get<double>();
      places.push_back(goal);
      chart.y = axis_around("place", places);
      chart.lines.push_back({"goal", {0, chart.x.high}, {goal, goal}, {}, {}, -1, true});
      Line shortest{"shortest path", {0, std::abs(goal - start)}, {start, goal}, {}, {}, -1, true};
      chart.lines.push_back(shortest);
      const std::string made = " Command: " + context.command + " --only figure-10";
      const std::string task =
          "From place " + fixed(start, 0) + " to place " + fixed(goal, 0) + " on '" + traversal + "'";
      if (shows(context, world))
        report.picture("figure-10-" + traversal, png_of(strips), task + "." + made);
      else
        report.no_picture("figure-10-" + traversal);
      report.figure("figure-10-" + traversal + "-places", chart, task + ": place over steps." + made);
    }
    table(context, world, all, conditions, report);
  }

 private:
  static World& world_of(const Context& context) { return context.world.pictures() ? context.world : context.drawn; }

  static bool shows(const Context& context, const World& world) { return context.strips || world.drawn(); }

  /// "night", else where the agent on features does worst, else the traversal learned from.
  static std::string hardest(const Context& context, World& world, const std::vector<Study>& all) {
    const std::vector<std::string> names = world.names();
    if (std::find(names.begin(), names.end(), "night") != names.end()) return "night";
    std::string found = names.size() > 1 ? names[1] : names.front();
    double worst = INFINITY;
    for (const Study& study : all)
      for (std::size_t i = 1; i < names.size() && study.agent == "features"; ++i)
        if (const Json row = trial(context, world, study, names[i]);
            !row.is_null() && row["spl"].get<double>() < worst) {
          worst = row["spl"].get<double>();
          found = names[i];
        }
    return found;
  }

  static Strip strip_of(const Study& study, const Json& walk, const Traversal& traversal) {
    const auto steps = std::ssize(walk["frames"]) - 1;
    Strip strip{study.agent + " on '" + traversal.name + "': " + std::to_string(steps) + " steps, " +
                    (walk["completed"].get<bool>() ? "goal reached" : "goal not reached"),
                {},
                {},
                &traversal};
    for (const int step : spread(static_cast<int>(steps) + 1, kPictures)) {
      const int frame = walk["frames"][static_cast<std::size_t>(step)].get<int>();
      strip.frames.push_back(frame);
      strip.labels.push_back(std::to_string(frame) + " at " + std::to_string(step) +
                             (frame == walk["goal"].get<int>() ? ", goal" : ""));
    }
    if (!walk["completed"].get<bool>()) {
      strip.frames.push_back(walk["goal"].get<int>());
      strip.labels.push_back("goal " + std::to_string(walk["goal"].get<int>()));
    }
    return strip;
  }

  static void table(const Context& context, World& world, const std::vector<Study>& all,
                    const std::vector<std::string>& conditions, Report& report) {
    ReportTable table{
        "figure-10",
        "One task and one seed each: an illustration, not a measurement (Fig. 8 and 9 have those).",
        {"agent", "representation", "seed", "traversal", "start", "goal", "end", "steps", "shortest", "reached"},
        {}};
    for (const Study& study : all)
      for (const std::string& traversal : conditions) {
        const Json row = trial(context, world, study, traversal);
        if (row.is_null()) continue;
        const Json& walk = row["walk"];
        const int start = walk["frames"].front().get<int>(), goal = walk["goal"].get<int>();
        table.rows.push_back({study.agent, study.representation, std::to_string(study.seed), traversal,
                              std::to_string(start), std::to_string(goal),
                              std::to_string(walk["frames"].back().get<int>()),
                              std::to_string(walk["frames"].size() - 1), std::to_string(std::abs(goal - start)),
                              walk["completed"].get<bool>() ? "yes" : "no"});
        if (!walk["completed"].get<bool>())
          report.remark(study.agent + " did not reach the goal on '" + traversal + "'.");
      }
    report.table(table);
  }
};

}  // namespace

std::unique_ptr<Section> make_pictures() { return std::make_unique<Walks>(); }

}  // namespace citylearn::paper
