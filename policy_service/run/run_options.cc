// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/run_options.h"

#include <CLI/CLI.hpp>
#include <limits>

#include "core/command_line/range_option.h"
#include "core/util/name.h"
#include "core/wire/messages.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

constexpr int kMaxFrames = static_cast<int>(msg::MAX_FRAMES);

}  // namespace

CLI::Validator at_least(int least) {
  const std::string wanted = "must be " + std::to_string(least) + " or more";
  return {[=](const std::string& text) {
            double value = 0;
            return CLI::detail::lexical_cast(text, value) && value >= least ? "" : "'" + text + "' " + wanted;
          },
          least == 0 ? "NONNEGATIVE" : "POSITIVE"};
}

void add_source_option(CLI::App& app, std::map<std::string, std::string>& source, const std::string& help) {
  app.add_option_function<std::vector<std::string>>(
         "--source",
         [&source](const std::vector<std::string>& words) {
           source.clear();
           for (const std::string& word : words) {
             const std::size_t at = word.find('=');
             if (at == word.npos || at == 0)
               throw CLI::ValidationError("--source", "'" + word + "' is not NAME=VALUE, as data=/home/me/drives");
             source[word.substr(0, at)] = word.substr(at + 1);
           }
         },
         help)
      ->type_name("NAME=VALUE")
      ->allow_extra_args(false);
}

void add_task_options(CLI::App& app, PolicyServiceOptions& options) {
  options.cap_frames = true;  // until --frames is given
  // env_services announce recordings under such names.
  app.add_option(
         "--train", options.train,
         "Traversal to learn from; A,B,... are experiences of one route, which frames of A define: agents learn "
         "from all of them, and filters remember each")
      ->default_str("summer")
      ->delimiter(',')
      ->transform(name_from);
  add_source_option(app, options.source,
                    "An option that the env_services and the encoder_service of --train were started with; may be "
                    "repeated. Checkpoints carry it, so that the agent can be evaluated on the same data later");
  app.add_option("--evaluate", options.evaluate, "Traversals to evaluate on, A,B,...")
      ->default_str("all that are found")
      ->delimiter(',')
      ->transform(name_from);
  app.add_option_function<std::string>(
         "--frames",
         [&options](const std::string& text) {
           constexpr int kOpen = std::numeric_limits<int>::max();
           int first = 0, end = kOpen;
           read_range("--frames", text, first, end);
           options.cap_frames = end == kOpen;
           if (options.cap_frames) end = kMaxFrames;
           if (first < 0 || end - first < 2 || end > kMaxFrames)
             throw CLI::ValidationError("--frames",
                                        "'" + text + "' must be two frames or more of 0:" + std::to_string(kMaxFrames));
           options.first_frame = first;
           options.frames = end - first;
         },
         "Frames of the traversal that are the route's places, END not included; either may be left out; the "
         "default is lower on shorter traversals, and all on streets")
      ->type_name("FIRST:END")
      ->default_str("0:128");
  app.add_option("--max-steps", options.max_steps, "Step limit of an episode; 0 = N, on streets the number of states")
      ->capture_default_str()
      ->check(at_least(0));
  options.max_detour = kDefaultDetour;
  app.add_option("--max-detour", options.max_detour,
                 "Step limit of an episode as a multiple of its fewest steps; 0 = none")
      ->default_str("3 on streets, else 0")
      ->check(at_least(0));
  app.add_option("--goal-radius", options.goal_radius,
                 "Metres around its goal at which an agent on streets has reached it")
      ->capture_default_str()
      ->check(at_least(0));
  app.add_flag("--curriculum", options.curriculum, "Train through the paper's lessons: 4, 8, 16 ... N frames");
  app.add_option("--environments", options.environments, "env_services on each training traversal to start with")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_flag("--lockstep", options.lockstep, "Wait for a lost training env_service instead of continuing without it");
  app.add_option("--observations", options.client.observing,
                 "whole: with features; by_reference: frames by name, their features are fetched once before; as_fits: "
                 "whole where the env_service has the features and they fit one datagram")
      ->default_str("as_fits")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, Observing>{
              {"as_fits", Observing::kAsFits}, {"whole", Observing::kWhole}, {"by_reference", Observing::kByReference}},
          CLI::ignore_case));
  app.add_option("--wait", options.wait, "Seconds to wait for env_services before failing; 0 = forever")
      ->capture_default_str()
      ->check(at_least(0));
}

void add_learner_options(CLI::App& app, PolicyServiceOptions& options) {
  app.add_option("--window", options.window,
                 "Learner: unacknowledged segments of one env_service after which an actor waits")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  app.add_option("--max-lag", options.max_lag,
                 "Learner: drop trajectories of parameters older than so many updates; 0 = none")
      ->capture_default_str();
}

void add_length_options(CLI::App& app, PolicyServiceOptions& options) {
  app.add_option("--steps", options.steps,
                 "Environment steps to learn from; 0: what the agent recommends, see --show-config")
      ->capture_default_str();
  app.add_option("--time-limit", options.time_limit,
                 "End training after so many seconds; schedules such as the learning rate finish by then; 0 = never")
      ->capture_default_str()
      ->check(at_least(0));
  app.add_option("--stop-when", options.stop_when,
                 "End training when the mean SPL of the last 100 training episodes is at least this; 0 = never")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--checkpoint-every", options.checkpoint_every, "Updates between checkpoints")
      ->capture_default_str()
      ->check(at_least(1));
  app.add_option("--evaluate-every", options.evaluate_every,
                 "Updates between evaluations on the other traversals, whose mean SPL then decides which checkpoint "
                 "is best.clk; "
                 "0 = at the end only")
      ->capture_default_str()
      ->check(at_least(0));
  app.add_option("--tasks", options.tasks, "Evaluation tasks on each traversal")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  app.add_option("--controls", options.controls,
                 "Controls evaluated on the same tasks: all, or some of shuffled, " +
                     joined(ControlRegistry::instance().entries(), &ControlRegistry::Entry::name))
      ->delimiter(',');
}

}  // namespace citylearn
