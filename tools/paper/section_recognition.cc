// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "tools/paper/recognition.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

const std::vector<int> kDimensions = {64, 512, 2048, 4096};

/// The paper's classifier, and the plain nearest frame beside it.
const std::vector<std::string> kMethods = {"mlp", "nearest"};

class Recognition : public Section {
 public:
  std::string name() const override { return "figure-6"; }
  std::string title() const override { return "Fig. 6: place recognition"; }

  void plan(Context& context) const override {
    for (const RecognitionCase& one : cases(context)) context.work.add(unit_of(one, context.world));
  }

  void tell(const Context& context, Report& report) const override {
    report.text(
        "Area under precision over recall of single frames: which frame of '" + context.world.train() +
        "' shows the place of a frame of another traversal, right within " + std::to_string(kPlaceTolerance) +
        " frames, " + std::to_string(context.world.frames()) +
        " frames. 'mlp' is the paper's classifier, one multi-layer perceptron trained on the reference; 'nearest' "
        "the nearest frame by cosine. In the paper the AUC falls with the dimension, halves from summer to "
        "winter and falls under a quarter from day to night.");
    ReportTable table{"figure-6",
                      "95 % intervals by resampling blocks of neighbouring frames.",
                      {"representation", "method", "query", "condition", "queries", "AUC", "recall@1"},
                      {}};
    for (const std::string& method : kMethods) {
      Bars bars;
      bars.title = "Area under the precision-recall curve, " + method;
      bars.unit = "AUC";
      for (const std::string& representation : represented(context)) bars.names.push_back(representation);
      for (const std::string& query : queries(context)) {
        bars.groups.push_back(query);
        std::vector<Bars::Bar>& group = bars.values.emplace_back();
        for (const std::string& representation : bars.names) {
          const Json& found =
              context.work.outcome(unit_of(RecognitionCase{representation, method, query}, context.world).spec);
          if (found.is_null()) {
            group.push_back({NAN, NAN, NAN});
            continue;
          }
          const Estimate auc{found["auc"], found["auc_low"], found["auc_high"], found["queries"]};
          group.push_back({auc.mean, auc.low, auc.high});
          table.rows.push_back({representation, method, query, context.world.recording(query).condition,
                                std::to_string(auc.n), text_of(auc, 3), fixed(found["recall"].get<double>(), 3)});
        }
      }
      report.figure("figure-6-" + method, bars, bars.title + ". Command: " + context.command + " --only figure-6");
    }
    report.table(table);
    compare(context, report);
  }

 private:
  static double auc(const Context& context, const RecognitionCase& one) {
    const Json& found = context.work.outcome(unit_of(one, context.world).spec);
    return found.is_null() ? NAN : found["auc"].get<double>();
  }

  /// The paper tells no figures that stand alone, but how they fall.
  static void compare(const Context& context, Report& report) {
    ReportTable table{"figure-6-falls",
                      "How the AUC of the paper's classifier falls: of each condition, as a share of the best other "
                      "condition's, per representation (one other condition: none). The paper: summer to winter half, "
                      "day to night under a quarter.",
                      {"representation", "query", "AUC", "share of the best", "paper"},
                      {}};
    const std::vector<std::string> all = represented(context);
    for (const std::string& representation : all) {
      double best = 0;
      for (const std::string& query : queries(context))
        best = std::max(best, auc(context, {representation, kMethods.front(), query}));
      for (const std::string& query : queries(context)) {
        const double value = auc(context, {representation, kMethods.front(), query}),
                     share = queries(context).size() > 1 ? value / best : NAN;
        const std::string& condition = context.world.recording(query).condition;
        const double paper = condition == "winter" ? 0.5 : condition == "night" ? 0.25 : NAN;
        table.rows.push_back({representation, query, fixed(value, 3), fixed(share, 2),
                              condition == "night" ? "under 0.25" : fixed(paper, 2)});
        if (condition == "winter" && share < paper)  // "under a quarter" says no more
          report.remark("Worse than the paper: by " + representation + ", '" + query + "' keeps " + fixed(share, 2) +
                        " of the AUC of the condition that is recognised best, in the paper " + fixed(paper, 2) + ".");
      }
    }
    report.table(table);
    for (std::size_t i = 1; i < all.size(); ++i) {
      const auto encoder = [](const std::string& name) { return name.substr(0, name.rfind('-')); };
      if (encoder(all[i]) != encoder(all[i - 1])) continue;
      double before = 0, after = 0;
      for (const std::string& query : queries(context)) {
        before += auc(context, {all[i - 1], kMethods.front(), query});
        after += auc(context, {all[i], kMethods.front(), query});
      }
      if (after > before)
        report.remark("Unlike in the paper the AUC does not fall with the dimension: mean over conditions " +
                      fixed(before / static_cast<double>(queries(context).size()), 3) + " by " + all[i - 1] + ", " +
                      fixed(after / static_cast<double>(queries(context).size()), 3) + " by " + all[i] + ".");
    }
  }

  static std::vector<std::string> queries(const Context& context) {
    std::vector<std::string> names = context.world.names();
    if (names.size() > 1) names.erase(names.begin());
    return names;
  }
  static std::vector<std::string> represented(const Context& context) {
    std::vector<std::string> names = context.world.representations(kDimensions);
    std::erase(names, "raw84");  // pixels are for agents that learn to see
    return names;
  }
  static std::vector<RecognitionCase> cases(const Context& context) {
    std::vector<RecognitionCase> all;
    for (const std::string& representation : represented(context))
      for (const std::string& method : kMethods)
        for (const std::string& query : queries(context)) all.push_back({representation, method, query});
    return all;
  }
};

}  // namespace

std::unique_ptr<Section> make_recognition() { return std::make_unique<Recognition>(); }

}  // namespace citylearn::paper
