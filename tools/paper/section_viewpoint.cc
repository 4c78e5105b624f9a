// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/chart/chart.h"
#include "tools/paper/beyond.h"
#include "tools/paper/recognition.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {
namespace {

const std::vector<std::string> kControls = {"blind", "sequence_filter"};

class Viewpoint : public Section {
 public:
  std::string name() const override { return "viewpoint"; }
  std::string title() const override { return "Beyond the paper: a camera to the side"; }

  void plan(Context& context) const override {
    World& aside = subject(context).aside();
    for (const RecognitionCase& one : cases(context)) context.work.add(unit_of(one, aside));
    for (const Carriage& carriage : carriages(context))
      for (const std::uint64_t seed : carriage.seeds) {
        context.work.add(unit_of(source(context, carriage, seed), aside));
        context.work.add(unit_of(carried(context, carriage, seed), aside));
      }
    for (const std::string& control : kControls) context.work.add(unit_of(study(context, control), aside));
  }

  void tell(const Context& context, Report& report) const override {
    const World& world = subject(context);
    const std::string drive =
        world.drawn()
            ? std::string(context.world.pictures() ? "These recordings are drawn"
                                                   : "The data given have no pictures, so these are drawn recordings") +
                  ": the drive 'shifted', under another sun and its camera turned a little, with the camera so many "
                  "metres further left than that of '" +
                  world.train() + "'."
            : "These pictures are real, the shift is simulated: of each picture of '" + world.train() +
                  "' a window of 4/5 of its width, moved to the right by a share of the width. That is what a turned "
                  "camera would see, or one to the side of things far away; nothing near hides anything else. At 0 % "
                  "the pictures are the same ones: what is not found again there looks like frames elsewhere.";
    report.text("How far the camera may be to the side of where it was when the route was learned. " + drive +
                " Agents learn by relabelling on '" + world.train() +
                "' alone, as the camera was, and walk the other recordings without more training.");
    recognition(context, report);
    navigation(context, report);
    for (const Carriage& carriage : carriages(context)) remarks(context, report, carriage);
  }

 private:
  static World& subject(const Context& context) { return context.world.pictures() ? context.world : context.drawn; }
  static std::vector<std::string> shifted(const Context& context) {
    std::vector<std::string> names;
    const World& world = subject(context);
    for (const double shift : world.aside_shifts()) names.push_back(world.aside_name(shift));
    return names;
  }
  static std::string representation(const Context& context) { return seen_in(subject(context).aside()); }
  static std::vector<std::string> methods(const Context& context) {
    if (context.quick) return {"nearest"};
    return {"mlp", "nearest"};
  }
  static std::vector<RecognitionCase> cases(const Context& context) {
    std::vector<RecognitionCase> all;
    for (const std::string& method : methods(context))
      for (const std::string& query : shifted(context)) all.push_back({representation(context), method, query});
    return all;
  }

  static int length(const Context& context) { return std::min(context.frames, subject(context).aside().frames()); }
  static Study source(const Context& context, const Carriage& carriage, std::uint64_t seed) {
    return source_of(context, subject(context).aside(), carriage, seed, length(context));
  }
  static Carried carried(const Context& context, const Carriage& carriage, std::uint64_t seed) {
    World& aside = subject(context).aside();
    const Study from = source(context, carriage, seed);
    return {kept(from, aside, context.work), from.representation, 0, length(context), context.tasks(), aside.names()};
  }
  static ControlStudy study(const Context& context, const std::string& control) {
    return {control, representation(context), 0, length(context), context.tasks(), subject(context).aside().names()};
  }
  static std::vector<Json> outcomes(const Context& context, const Carriage& carriage) {
    std::vector<Json> all;
    for (const std::uint64_t seed : carriage.seeds)
      all.push_back(context.work.outcome(unit_of(carried(context, carriage, seed), subject(context).aside()).spec));
    return all;
  }
  static std::vector<Json> outcomes(const Context& context, const std::string& control) {
    return {context.work.outcome(unit_of(study(context, control), subject(context).aside()).spec)};
  }

  static Axis shifts(const Context& context) {
    const std::vector<double> all = subject(context).aside_shifts();
    return axis_around(subject(context).drawn() ? "camera to the left, m" : "window to the right, share of the width",
                       all, /*from_zero=*/true);
  }
  static std::string command(const Context& context) { return "Command: " + context.command + " --only viewpoint"; }

  static void recognition(const Context& context, Report& report) {
    World& aside = subject(context).aside();
    Chart chart{"Place recognition by shift of the camera", shifts(context), {"AUC, recall@1", 0, 1}, {}};
    ReportTable table{"viewpoint-recognition",
                      "Frames of '" + aside.train() + "' found again from the side, right within " +
                          std::to_string(kPlaceTolerance) +
                          " frames. 95 % intervals: AUC by resampling blocks of neighbouring "
                          "frames, recall@1 Wilson's.",
                      {"representation", "method", "shift", "queries", "AUC", "recall@1"},
                      {}};
    const std::vector<double> at = subject(context).aside_shifts();
    for (const std::string& method : methods(context)) {
      Line auc{method + ", AUC", {}, {}}, recall{method + ", recall@1", {}, {}};
      for (const double shift : at) {
        const std::string query = subject(context).aside_name(shift);
        const Json& found =
            context.work.outcome(unit_of(RecognitionCase{representation(context), method, query}, aside).spec);
        if (found.is_null()) {
          report.remark("Recognition of " + query + " by " + method + " failed.");
          continue;
        }
        const int queries = found["queries"].get<int>();
        const Estimate area{found["auc"], found["auc_low"], found["auc_high"], queries},
            first = of_share(found["recall"].get<double>() * queries, queries);
        const auto add = [shift](Line& line, const Estimate& estimate) {
          line.x.push_back(shift);
          line.y.push_back(estimate.mean);
          line.low.push_back(estimate.low);
          line.high.push_back(estimate.high);
        };
        add(auc, area);
        add(recall, first);
        table.rows.push_back(
            {representation(context), method, query, std::to_string(queries), text_of(area, 3), text_of(first, 3)});
      }
      chart.lines.push_back(auc);
      chart.lines.push_back(recall);
    }
    chart.width = 560;
    chart.height = 260;
    report.figure("viewpoint-recognition", chart, chart.title + ", with 95 % intervals. " + command(context));
    report.table(table);
  }

  static void navigation(const Context& context, Report& report) {
    World& aside = subject(context).aside();
    Chart chart{"Navigation by shift of the camera", shifts(context), {"SPL", 0, 1}, {}};
    ReportTable table{"viewpoint",
                      "Places 0 to " + std::to_string(length(context) - 1) + ", as " + representation(context) +
                          ": means over the same tasks for everybody (agents: over seeds, 95 % interval of the mean; "
                          "one seed or control: of the share, Wilson). '" +
                          aside.train() + "' is what they learned from.",
                      {"policy", "recording", "seeds x tasks", "completed", "SPL", "excess"},
                      {}};
    const auto add = [&](const std::string& label, const std::vector<Json>& found, bool control) {
      Line line{label, {}, {}};
      for (const std::string& name : aside.names()) {
        const Trials trials = trials_on(found, name);
        if (trials.seeds == 0) continue;
        table.rows.push_back({label, name, seeds_by_tasks(trials), percent(trials.completed), text_of(trials.spl, 3),
                              text_of(trials.excess, 2)});
      }
      for (const double shift : subject(context).aside_shifts()) {
        const Trials trials = trials_on(found, subject(context).aside_name(shift));
        line.x.push_back(shift);
        line.y.push_back(trials.spl.mean);
        if (control) continue;
        line.low.push_back(trials.spl.low);
        line.high.push_back(trials.spl.high);
      }
      line.dashed = control;
      chart.lines.push_back(line);
    };
    for (const Carriage& carriage : carriages(context)) add(carriage.label, outcomes(context, carriage), false);
    for (const std::string& control : kControls) add(control, outcomes(context, control), true);
    chart.width = 560;
    chart.height = 260;
    report.figure("viewpoint", chart,
                  chart.title + ", mean of the seeds with its 95 % interval; dashed: policies that learn nothing. " +
                      command(context));
    report.table(table);
  }

  static void remarks(const Context& context, Report& report, const Carriage& carriage) {
    const std::vector<Json> found = outcomes(context, carriage);
    const auto failed = std::count_if(found.begin(), found.end(), [](const Json& rows) { return rows.is_null(); });
    if (failed > 0)
      report.remark(carriage.label + ": " + std::to_string(failed) + " of " + std::to_string(found.size()) +
                    " trainings failed.");
    judge(report, carriage.label, "at", shifted(context), found, outcomes(context, "blind"),
          outcomes(context, "sequence_filter"));
  }
};

}  // namespace

std::unique_ptr<Section> make_viewpoint() { return std::make_unique<Viewpoint>(); }

}  // namespace citylearn::paper
