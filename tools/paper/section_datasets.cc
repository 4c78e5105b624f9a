// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "encoder_service/encoding/encoder.h"
#include "tools/paper/memory.h"
#include "tools/paper/published.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

/// Metres from the first known position to the last, and the mean and the smallest step between neighbours that are not
/// the same place; NaN where unknown.
struct Length {
  double metres = NAN, step = NAN, smallest = NAN;
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
  double smallest = INFINITY;
  for (int i = first + 1; i <= last; ++i) {
    const double step = std::abs(static_cast<double>(traversal.positions[static_cast<std::size_t>(i)]) -
                                 static_cast<double>(traversal.positions[static_cast<std::size_t>(i - 1)]));
    if (step > 0) smallest = std::min(smallest, step);
  }
  return {metres, metres / (last - first), smallest};
}

/// "34.1 MB", "12 kB".
std::string memory_of(double bytes) {
  if (bytes >= 1e9) return fixed(bytes / 1e9, 1) + " GB";
  return bytes >= 1e6 ? fixed(bytes / 1e6, 1) + " MB" : fixed(bytes / 1e3, 0) + " kB";
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

  void plan(Context& context) const override { context.work.add(memory(context)); }

  void tell(const Context& context, Report& report) const override {
    const World& world = context.world;
    report.text(world.drawn()
                    ? "The recordings of this report are drawn by the program: a street with buildings, trees and "
                      "traffic, driven again under other light, weather and seasons. None of it is a real recording."
                    : "The recordings of this report are those given by --data; what the reader found in them:");
    ReportTable first{"table-1",
                      "Table I: traversals as they are used here, aligned to '" + world.train() + "'.",
                      {"traversal", "condition", "frames", "length, m", "mean step, m", "smallest step, m", "sensors"},
                      {}};
    for (const std::string& name : world.names()) {
      const Traversal& traversal = world.recording(name);
      const Length length = length_of(traversal);
      first.rows.push_back({name, traversal.condition, std::to_string(traversal.frames), fixed(length.metres, 0),
                            fixed(length.step, 1), fixed(length.smallest, 2), sensors_of(traversal)});
    }
    report.table(first);
    features(context, report);
  }

 private:
  static Unit memory(const Context& context) {
    // As the agents see it that are given features.
    return memory_unit(context.agents.front().representation, env_service_program(), context.world);
  }

  static void features(const Context& context, Report& report) {
    const World& world = context.world;
    ReportTable table{
        "table-2",
        "Table II: this environment beside CityLearn (Chancan & Milford 2020) and StreetLearn (Mirowski et al. "
        "2018). Memory of theirs as the CityLearn paper gives it; ours measured on these recordings. Empty: not "
        "known to us.",
        {"", "CityLearn-DDS", "CityLearn", "StreetLearn"},
        {}};
    const std::size_t traversals = world.names().size();
    table.rows.push_back(
        {"real recordings", world.drawn() ? "yes (here: drawn ones)" : "yes", "yes", "yes (street panoramas)"});
    table.rows.push_back({"several conditions of one route",
                          traversals > 1 ? "yes (here " + std::to_string(traversals) + ")" : "yes (here 1)", "yes",
                          "no"});
    std::string encoders;
    for (const auto* entry : EncoderRegistry::instance().entries())
      encoders += (encoders.empty() ? "" : ", ") + entry->name;
    table.rows.push_back(
        {"place recognition as the agent's eye", "yes (" + encoders + ")", "yes (NetVLAD, ResNet)", "no"});
    table.rows.push_back({"actions", "stay, next, previous", "stay, next, previous", "forward, turn left or right"});
    table.rows.push_back(
        {"junctions", "yes, in one process (part 'map' of this report)", "no (its future work)", "yes (street graph)"});
    table.rows.push_back({"environments and learner on many machines", "yes (DDS)", "", "yes (actors of IMPALA)"});
    table.rows.push_back({"controls that never look, or never learn", "yes", "", ""});
    const Json& outcome = context.work.outcome(memory(context).spec);
    const Length length = length_of(world.recording(world.train()));
    table.rows.push_back({"smallest step, m (mean)",
                          std::isfinite(length.smallest)
                              ? fixed(length.smallest, 2) + " (" + fixed(length.step, 1) + ")"
                              : "no positions in the recording",
                          "", "(about 10)"});
    if (!outcome.is_null()) {
      const Json& bytes = outcome["bytes"];
      const Json& process = bytes["process"];
      const std::string agents = std::to_string(outcome["agents"].get<int>());
      table.rows.push_back({"memory of an environment, a process of its own",
                            process.is_null() ? "" : memory_of(process.get<double>()), memory_of(kPaperGigabytes * 1e9),
                            memory_of(kStreetLearnGigabytes * 1e9)});
      table.rows.push_back(
          {"memory of one more in the same process", memory_of(bytes["environment"].get<double>()), "", ""});
      report.text(
          "Memory: resident, of " + agents + " agents on '" + world.train() + "' (" +
          std::to_string(world.recording(world.train()).frames) +
          " frames). One more environment in a process that has "
          "the recording: mean of " +
          std::to_string(outcome["environments"].get<int>()) + ", each with its observation. A process of its own: " +
          (process.is_null() ? "not measured, env_service is not built beside this program"
                             : "env_service, one measured, with its libraries and the recording, before a policy "
                               "drives it") +
          ". Command: " + context.command + " --only tables");
      if (process.is_number() && process.get<double>() > kPaperGigabytes * 1e9)
        report.remark("An env_service takes more memory than the paper's environment.");
    }
    report.table(table);
  }
};

}  // namespace

std::unique_ptr<Section> make_datasets() { return std::make_unique<Datasets>(); }

}  // namespace citylearn::paper
