#include <cmath>

#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

/// Metres from the first known position to the last, and the mean step between neighbours; NaN where unknown.
struct Length {
  double metres = NAN, step = NAN;
};

Length length_of(const Traversal& traversal) {
  int first = -1, last = -1;
  for (int i = 0; i < traversal.frames; ++i)
    if (std::isfinite(traversal.positions[static_cast<std::size_t>(i)])) {
      if (first < 0) first = i;
      last = i;
    }
  if (last <= first) return {};
  const double metres = static_cast<double>(traversal.positions[static_cast<std::size_t>(last)]) -
                        static_cast<double>(traversal.positions[static_cast<std::size_t>(first)]);
  return {metres, metres / (last - first)};
}

std::string sensors_of(const Traversal& traversal) {
  std::string text = traversal.images ? "pictures" : std::to_string(traversal.dimension) + " features";
  if (!traversal.latitude.empty()) text += ", GPS";
  if (!traversal.times.empty()) text += ", time";
  return text;
}

class Datasets : public Section {
 public:
  std::string name() const override { return "tables"; }
  std::string title() const override { return "Tables I and II: the data and the environments"; }

  void plan(Context&) const override {}

  void tell(const Context& context, Report& report) const override {
    const World& world = context.world;
    report.text(world.drawn()
                    ? "The recordings of this report are drawn by the program: a street with buildings, trees and "
                      "traffic, driven again under other light, weather and seasons. None of it is a real recording."
                    : "The recordings of this report are those given by --data; what the reader found in them:");
    ReportTable first{"table-1",
                      "Table I: traversals as they are used here, aligned to '" + world.train() + "'.",
                      {"traversal", "condition", "frames", "length, m", "mean step, m", "sensors"},
                      {}};
    for (const std::string& name : world.names()) {
      const Traversal& traversal = world.recording(name);
      const Length length = length_of(traversal);
      first.rows.push_back({name, traversal.condition, std::to_string(traversal.frames), fixed(length.metres, 0),
                            fixed(length.step, 1), sensors_of(traversal)});
    }
    report.table(first);
  }
};

}  // namespace

std::unique_ptr<Section> make_datasets() { return std::make_unique<Datasets>(); }

}  // namespace citylearn::paper
