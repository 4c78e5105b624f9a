// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "tools/paper/report.h"
#include "tools/paper/study.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// What all sections share.
struct Context {
  World& world;
  World&
      drawn;  ///< a city that has what `world` may lack: pictures, positions on a map; `world` itself when it is drawn
  Work& work;
  bool quick = false;
  double effort = 1;  ///< share of training steps and tasks, 0..1; below 1 figures tell nothing
  std::vector<std::uint64_t> seeds;
  int frames = 128;     ///< N of the paper's route
  std::string command;  ///< that makes the report again, without --only

  /// The agents compared, each on the representation it is meant for.
  struct Agent {
    std::string agent, label, representation;
    std::vector<std::uint64_t> seeds;
    double seconds = 0;  ///< of one training, guessed
  };
  std::vector<Agent> agents;
  bool strips = true;  ///< show real recordings' pictures

  /// How many tasks a trial has whose figure goes into a table, and one of those while an agent trains.
  int tasks() const;
  int tasks_between() const;
  /// Training steps of an agent under `effort`; 0: its recommendation. The baseline needs fewer than that.
  std::uint64_t steps(const std::string& agent, const std::string& learner = "ppo") const;
  /// One of their trainings on the paper's route.
  Study study(const Agent& agent, std::uint64_t seed) const;
  /// Features a frame that an agent is given; 0: pixels.
  int features(const Agent& agent) const;
  /// Outcomes of all seeds that did not fail.
  std::vector<Json> outcomes(const Agent& agent) const;
};

/// A part of the report: names the work it needs, then tells what came of it. One file each, which ends in its
/// definition; sections() lists them.
class Section {
 public:
  virtual ~Section() = default;
  virtual std::string name() const = 0;   ///< for --only: "figure-7"
  virtual std::string title() const = 0;  ///< "Fig. 7: training curves"
  virtual void plan(Context& context) const = 0;
  /// Throws Error when a figure cannot be made; then it says so in the report.
  virtual void tell(const Context& context, Report& report) const = 0;
};

std::unique_ptr<Section> make_compute();      ///< Fig. 2
std::unique_ptr<Section> make_recognition();  ///< Fig. 6
std::unique_ptr<Section> make_curves();       ///< Fig. 7
std::unique_ptr<Section> make_deployment();   ///< Fig. 8 and 9
std::unique_ptr<Section> make_pictures();     ///< Fig. 10
std::unique_ptr<Section> make_datasets();     ///< Tables I and II
std::unique_ptr<Section> make_longer();       ///< 128 places, 512, all
std::unique_ptr<Section> make_transfer();     ///< a policy on a second route
std::unique_ptr<Section> make_viewpoint();    ///< a camera to the side
std::unique_ptr<Section> make_map();          ///< a route that crosses itself

}  // namespace citylearn::paper
