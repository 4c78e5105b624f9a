// SPDX-License-Identifier: Apache-2.0
// The module citylearn._native: what the package's Python files need of the C++ libraries.
#include "python/module.h"

#include <pthread.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <future>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "core/exchange/timing.h"
#include "core/task/goal_chain.h"
#include "core/task/lost.h"
#include "core/util/log_format.h"
#include "encoder_service/encoding/encoder.h"
#include "policy_service/rollout/control.h"
#include "policy_service/run/run_context.h"
#include "python/columns.h"
#include "python/errors.h"
#include "python/evaluation.h"

namespace py = pybind11;

namespace citylearn::python {

void check_signals() {
  const py::gil_scoped_acquire gil;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
}

void keep_participants_of_forked() {
  const auto in_child = [] {
    on_exit(
        [](int status, void*) {
          std::fflush(nullptr);
          _exit(status);
        },
        nullptr);
  };
  static const int registered = pthread_atfork(nullptr, nullptr, in_child);
  (void)registered;
}

namespace {

using Actions = py::array_t<std::uint8_t, py::array::c_style>;

/// An EnvGroup for one Python thread; another thread steps it between send() and receive().
class Envs {
 public:
  Envs(std::shared_ptr<const Recording> recording, int agents, int services)
      : recording_(std::move(recording)), group_(make_local_group(*recording_, agents, services)) {}
  explicit Envs(const RemoteOptions& options) : group_(make_remote_group(options, check_signals)) {}
  ~Envs() { cancelled_ = true; }

  const EnvGroup::Shape& shape() const { return group_->shape(); }

  py::tuple reset(const Route& route, const EnvGroup::Seeds& seeds) {
    msg::TaskSettings settings;
    settings.task_mode() = msg::TRAIN;
    settings.first_frame() = static_cast<std::uint32_t>(route.first_frame);
    settings.frames() = static_cast<std::uint32_t>(route.frames);
    settings.max_steps() = static_cast<std::uint32_t>(route.max_steps);
    settings.shuffle() = route.shuffle;
    settings.max_detour() = static_cast<std::uint32_t>(route.max_detour);
    Columns columns = make_columns();
    const Batch batch = columns.batch();
    {
      const py::gil_scoped_release no_gil;
      group_->reset(settings, seeds);
      group_->receive(batch, check_signals);
    }
    return columns.tuple();
  }

  /// Returns the fewest steps from a place of the route, or a state, through goals one after the other.
  int fewest_steps(int start, const std::vector<int>& goals) {
    const Streets& streets = shape().streets;
    if (!map_) map_ = streets.states ? streets.states : std::make_shared<const StateMap>(shape().traversal_frames);
    if (!distances_) distances_.emplace(*map_);
    return citylearn::fewest_steps(*map_, *distances_, 0, start, goals);
  }

  /// Returns the place of each state, and the heading that it looks to; empty on a line.
  py::tuple states() const {
    const StateMap* const streets = shape().streets.states.get();
    const py::ssize_t count = streets ? streets->states() : 0;
    py::array_t<std::int64_t> places(ArrayShape{count});
    py::array_t<float> headings(ArrayShape{count});
    for (py::ssize_t state = 0; state < count; ++state) {
      places.mutable_at(state) = streets->place(static_cast<int>(state));
      headings.mutable_at(state) = streets->heading(static_cast<int>(state));
    }
    return py::make_tuple(places, headings);
  }

  py::tuple step(const Actions& actions) {
    Columns columns = make_columns();
    const Batch batch = columns.batch();
    const std::span<const std::uint8_t> choices(actions.data(), static_cast<std::size_t>(actions.size()));
    {
      const py::gil_scoped_release no_gil;
      group_->send(choices);
      group_->receive(batch, check_signals);
    }
    return columns.tuple();
  }

  void send(const Actions& actions) {
    pending_.emplace(make_columns());
    std::vector<std::uint8_t> choices(actions.data(), actions.data() + actions.size());
    done_ = std::async(std::launch::async, [this, choices = std::move(choices), batch = pending_->batch()] {
      group_->send(choices);
      group_->receive(batch, [this] {
        if (cancelled_) throw Error("closed while agents stepped");
      });
    });
  }

  py::tuple receive() {
    {
      const py::gil_scoped_release no_gil;
      while (done_.wait_for(kStopCheckInterval) != std::future_status::ready) check_signals();
      done_.get();
    }
    const Columns columns = std::move(*pending_);
    pending_.reset();
    return columns.tuple();
  }

 private:
  Columns make_columns() const { return {shape().agents, shape().features}; }

  const std::shared_ptr<const Recording> recording_;
  const std::unique_ptr<EnvGroup> group_;
  std::shared_ptr<const StateMap> map_;
  std::optional<DistanceFields> distances_;
  std::atomic<bool> cancelled_ = false;
  std::optional<Columns> pending_;
  std::future<void> done_;  // last: its end is awaited first
};

/// Calls `act(columns, first)`, where first[b] says that agent b begins a task, for one action per agent. One that is
/// not allowed becomes the first one that is, on a line `stay`.
std::unique_ptr<Policy> python_policy(py::function act, int dimension, int first_frame) {
  return function_policy([act = std::move(act), dimension, first_frame](const msg::Observation& seen,
                                                                        std::vector<std::uint8_t>& choice) {
    const py::gil_scoped_acquire gil;
    const auto agents = static_cast<int>(seen.goal().size());
    Columns columns(agents, dimension);
    write_rows(seen, static_cast<std::uint32_t>(first_frame), static_cast<std::size_t>(dimension), 0, columns.batch(),
               [&](std::size_t agent) { return seen.features().data() + agent * static_cast<std::size_t>(dimension); });
    const auto actions = act(columns.tuple()).cast<Actions>();
    choice.assign(actions.data(), actions.data() + actions.size());
    for (std::size_t agent = 0; agent < choice.size() && agent < seen.allowed().size(); ++agent)
      if (choice[agent] < kActions && !(seen.allowed()[agent] >> choice[agent] & 1))
        choice[agent] = static_cast<std::uint8_t>(std::countr_zero(seen.allowed()[agent]));
  });
}

template <class T>
using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;

constexpr std::uint32_t kNoFrame = 1 << 23;  // beyond all frames, and twice that is exact in a network's state
static_assert(kNoFrame > msg::MAX_FRAMES);

/// Returns one action per agent for observations as VectorEnv has them. `start[b]`: agent b begins an episode.
Actions act(Policy& policy, const Array<float>& features, const Array<std::int64_t>& goal,
            const Array<std::int64_t>& previous_action, const Array<bool>& mask, const Array<bool>& start,
            int first_frame) {
  const py::ssize_t agents = goal.size(), dimension = features.ndim() == 2 ? features.shape(1) : 0;
  const bool fits = features.ndim() == 2 && features.shape(0) == agents && mask.size() == agents * kActions;
  const auto require = [](bool good, const char* fault) {
    if (!good) throw Error(fault, "observations", "give them as VectorEnv has them");
  };
  require(fits && previous_action.size() == agents && start.size() == agents, "differ in their numbers of agents");
  require(std::all_of(features.data(), features.data() + features.size(), [](float x) { return std::isfinite(x); }),
          "features are not finite");
  msg::Observation seen;
  seen.feature_dimension() = static_cast<std::uint32_t>(dimension);
  seen.features().assign(features.data(), features.data() + features.size());
  for (py::ssize_t agent = 0; agent < agents; ++agent) {
    const std::int64_t place = goal.data()[agent], before = previous_action.data()[agent];
    require(place >= 0 && place < msg::MAX_FRAMES, "a goal is not a place");
    require(before >= 0 && before <= kActions, "a previous_action is not 0 to 3");
    seen.goal().push_back(static_cast<std::uint32_t>(place + first_frame));
    seen.previous_action().push_back(static_cast<std::uint8_t>(before == kActions ? std::int64_t{kNoAction} : before));
    unsigned allowed = 0;
    for (int action = 0; action < kActions; ++action)
      if (mask.data()[agent * kActions + action]) allowed |= 1u << action;
    seen.allowed().push_back(static_cast<std::uint8_t>(allowed));
    seen.flags().push_back(start.data()[agent] ? msg::FLAG_FIRST : 0);
  }
  // Which frames these are is not known: their features tell them apart, by numbers that no frame has.
  for (py::ssize_t agent = 0; agent < agents; ++agent) {
    const char* const bytes = reinterpret_cast<const char*>(features.data() + agent * dimension);
    const std::size_t of = std::hash<std::string_view>()({bytes, static_cast<std::size_t>(dimension) * sizeof(float)});
    seen.frame().push_back(kNoFrame + static_cast<std::uint32_t>(of % kNoFrame));
  }
  seen.position() = seen.goal();  // of no use to these agents
  std::vector<std::uint8_t> choice;
  policy.act(seen, choice);
  Actions actions(ArrayShape{agents});
  std::copy(choice.begin(), choice.end(), actions.mutable_data());
  return actions;
}

/// Returns what agents believe: places (B, 8), their probabilities, entropy (B,) and probability of being lost.
py::object belief_of(const Policy& policy, int first_frame) {
  msg::Belief belief;
  policy.believe(belief);
  if (belief.lost().empty()) return py::none();
  const auto agents = static_cast<py::ssize_t>(belief.lost().size()), likely = py::ssize_t{msg::LIKELY_PLACES};
  py::array_t<std::int64_t> places(ArrayShape{agents, likely});
  std::transform(belief.likely().begin(), belief.likely().end(), places.mutable_data(),
                 [&](std::uint32_t frame) { return std::int64_t{frame} - first_frame; });
  const auto array = [](const std::vector<float>& numbers, const ArrayShape& shape) {
    py::array_t<float> copied(shape);
    std::copy(numbers.begin(), numbers.end(), copied.mutable_data());
    return copied;
  };
  return py::make_tuple(places, array(belief.probability(), {agents, likely}), array(belief.entropy(), {agents}),
                        array(belief.lost(), {agents}));
}

/// Says which agents are lost.
struct LostAgents {
  std::vector<LostWatch> watches;

  /// Returns which say so, bool (B,), by the columns of belief_of(). Those of `starts` begin an episode. Leaps count
  /// where this step `goes_on` from the one of the last call.
  py::array_t<bool> say(const py::array_t<std::uint32_t>& places, const py::array_t<float>& probabilities,
                        const py::array_t<float>& lost, const py::array_t<bool>& starts, bool goes_on) {
    watches.resize(static_cast<std::size_t>(lost.size()));
    py::array_t<bool> said(ArrayShape{lost.size()});
    for (py::ssize_t agent = 0; agent < lost.size(); ++agent) {
      LostWatch& watch = watches[static_cast<std::size_t>(agent)];
      if (!goes_on) watch.forget();
      if (starts.at(agent)) watch.reset();
      said.mutable_at(agent) =
          watch.says_lost({places.data(agent), msg::LIKELY_PLACES}, {probabilities.data(agent), msg::LIKELY_PLACES},
                          lost.at(agent), kMaxLost);
    }
    return said;
  }
};

/// Returns a frame's picture, height x width x 3, blue first; None of a recording of features.
py::object picture_of(const Recording& recording, int frame) {
  if (!recording.images) return py::none();
  Bytes bytes;
  recording.images->read(frame, bytes);
  const cv::Mat picture = decode_picture(bytes, recording.images->name(frame));
  return py::array_t<std::uint8_t>(ArrayShape{picture.rows, picture.cols, 3}, picture.data);
}

/// Returns a message with keyword arguments in place of options: "step_metres: ..." for "--step-metres: ...".
std::string in_python(const std::string& message) {
  std::string text;
  for (std::size_t i = 0; i < message.size(); ++i) {
    const bool option = message.compare(i, 2, "--") == 0 && i + 2 < message.size() && std::islower(message[i + 2]);
    if (!option) {
      text += message[i];
      continue;
    }
    for (i += 2; i < message.size() && (std::islower(message[i]) || std::isdigit(message[i]) || message[i] == '-'); ++i)
      text += message[i] == '-' ? '_' : message[i];
    --i;
  }
  return text;
}

void translate(std::exception_ptr thrown) {  // NOLINT(performance-unnecessary-value-param): pybind11 asks for it
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const UnknownOption& error) {
    PyErr_SetString(PyExc_TypeError, in_python(error.what()).c_str());
  } catch (const ServiceMissing& error) {
    PyErr_SetString(PyExc_TimeoutError, in_python(error.what()).c_str());
  } catch (const EnvServicesMissing& error) {
    PyErr_SetString(PyExc_TimeoutError, in_python(error.what()).c_str());
  } catch (const ServiceLost& error) {
    PyErr_SetString(PyExc_ConnectionError, in_python(error.what()).c_str());
  } catch (const Error& error) {
    PyErr_SetString(PyExc_ValueError, in_python(error.what()).c_str());
  }
}

void define_environments(py::module_& module) {
  py::class_<TrainingData>(module, "TrainingData")
      .def(py::init<>())
      .def_property_readonly("traversals", &TrainingData::names)
      .def_readonly("source", &TrainingData::source);
  py::class_<Streets>(module, "Streets").def(py::init<>()).def_readonly("hash", &Streets::hash);
  py::class_<Recording, std::shared_ptr<Recording>>(module, "Recording")
      .def(py::init([](const Keywords& options, const TrainingData& learned) {
             const py::gil_scoped_release no_gil;
             return std::make_shared<Recording>(load_recording(options, learned));
           }),
           py::arg("options"), py::arg("learned") = TrainingData())
      .def_property_readonly("name", [](const Recording& one) { return one.traversal.name; })
      .def_property_readonly("frames", [](const Recording& one) { return one.traversal.frames; })
      .def_property_readonly("on_streets", [](const Recording& one) { return one.traversal.streets != nullptr; })
      .def_property_readonly("streets", &streets_of)
      .def_property_readonly("features", [](const Recording& one) { return one.traversal.dimension; })
      .def("feature",
           [](const Recording& one, int frame) {
             return py::array_t<float>(ArrayShape{one.traversal.dimension}, one.traversal.feature(frame).data());
           })
      .def("picture", &picture_of)
      .def("reference", &reference_of);
  py::class_<Route>(module, "Route")
      .def(py::init([](int first_frame, int frames, int max_steps, bool shuffle, int max_detour) {
        return Route{first_frame, frames, max_steps, shuffle, max_detour};
      }))
      .def_readonly("first_frame", &Route::first_frame)
      .def_readonly("frames", &Route::frames)
      .def_readonly("max_steps", &Route::max_steps)
      .def_readonly("shuffle", &Route::shuffle);
  py::class_<Envs, UnlessForked<Envs>>(module, "Envs")
      .def(py::init<std::shared_ptr<Recording>, int, int>())
      .def(py::init([](const Keywords& options, const std::string& traversal, int services, double wait) {
        const RemoteOptions remote{read_node_options(options), traversal, services, wait};
        const py::gil_scoped_release no_gil;
        keep_participants_of_forked();
        return new Envs(remote);
      }))
      .def_property_readonly("agents", [](const Envs& envs) { return envs.shape().agents; })
      .def_property_readonly("service_agents", [](const Envs& envs) { return envs.shape().service_agents; })
      .def_property_readonly("features", [](const Envs& envs) { return envs.shape().features; })
      .def_property_readonly("traversal", [](const Envs& envs) { return envs.shape().traversal; })
      .def_property_readonly("frames", [](const Envs& envs) { return envs.shape().traversal_frames; })
      .def_property_readonly("on_streets", [](const Envs& envs) { return envs.shape().streets.states != nullptr; })
      .def_property_readonly("streets", [](const Envs& envs) { return envs.shape().streets; })
      .def_property_readonly("states", &Envs::states)
      .def("fewest_steps", &Envs::fewest_steps)
      .def("reset", &Envs::reset)
      .def("step", &Envs::step)
      .def("send", &Envs::send)
      .def("receive", &Envs::receive);
  module.def("sample_arrays", [] { return Columns(3, 2).tuple(); });
  module.def("recording_options", &recording_options);
  module.def("node_options", &node_option_names);
}

void define_evaluation(py::module_& module) {
  py::class_<Matrix<float>>(module, "Reference").def(py::init<>());
  py::class_<TrainedAgent>(module, "Agent")
      .def(py::init(&load_agent))
      .def_readonly("name", &TrainedAgent::name)
      .def_readonly("first_frame", &TrainedAgent::first_frame)
      .def_readonly("update", &TrainedAgent::update)
      .def_readonly("data", &TrainedAgent::data)
      .def_readonly("places", &TrainedAgent::places)
      .def("learned_on", &learned_on)
      .def_property_readonly("frames", [](const TrainedAgent& agent) { return agent.task.frames; })
      .def_property_readonly("features", [](const TrainedAgent& agent) { return agent.task.features; })
      .def_property_readonly("reference", [](const TrainedAgent& agent) { return agent.task.reference; });
  py::class_<ExportedPolicy>(module, "ExportedPolicy")
      .def(py::init<const std::string&>())
      .def_readonly("name", &ExportedPolicy::name)
      .def_readonly("data", &ExportedPolicy::data)
      .def_readonly("first_frame", &ExportedPolicy::first_frame)
      .def_readonly("frames", &ExportedPolicy::frames)
      .def_readonly("features", &ExportedPolicy::features);
  py::class_<Score>(module, "Score")
      .def_readonly("tasks", &Score::tasks)
      .def_readonly("completed", &Score::completed)
      .def_readonly("spl", &Score::spl)
      .def_readonly("excess", &Score::excess)
      .def_readonly("mean_steps", &Score::mean_steps)
      .def_readonly("shortest_mean", &Score::shortest_mean)
      .def_readonly("reward", &Score::reward);
  py::class_<Policy>(module, "Policy").def("act", &act).def("belief", &belief_of);
  py::class_<LostAgents>(module, "LostAgents").def(py::init<>()).def("say", &LostAgents::say);
  module.def("agent_policy", &agent_policy);
  module.def("exported_policy", &exported_policy);
  module.def("control_policy", &control_policy);
  module.def("function_policy", &python_policy);
  module.def("controls", [] {
    std::vector<std::string> names;
    for (const auto* entry : ControlRegistry::instance().entries()) names.push_back(entry->name);
    return names;
  });
  module.def("evaluate",
             [](Policy& policy, const Recording& recording, const Route& route, int tasks, std::uint64_t seed) {
               const py::gil_scoped_release no_gil;
               return evaluate(policy, recording, route, {tasks, seed}, check_signals);
             });
  module.def("table", [](const std::vector<std::tuple<std::string, std::string, Score>>& rows) {
    std::vector<ScoreRow> all;
    for (const auto& [policy, traversal, score] : rows) all.push_back({policy, traversal, score});
    return table(all);
  });
}

}  // namespace

PYBIND11_MODULE(_native, module) {
  spdlog::set_default_logger(spdlog::stderr_color_mt("citylearn"));
  use_text_log(isatty(STDERR_FILENO) == 1);
  spdlog::set_level(spdlog::level::warn);  // log_level= changes it
  py::register_exception_translator(&translate);
  define_environments(module);
  define_evaluation(module);
}

}  // namespace citylearn::python
