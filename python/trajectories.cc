// SPDX-License-Identifier: Apache-2.0
// Batches of trajectories as numpy arrays, and the learner that they are for.
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "core/task/action.h"
#include "python/columns.h"
#include "python/errors.h"
#include "python/learner_thread.h"
#include "python/module.h"
#include "python/options.h"

namespace py = pybind11;

namespace citylearn::python {
namespace {

using Shared = std::shared_ptr<Rollout>;

/// Returns an array that lies in the rollout's own memory, which it keeps alive.
template <class Number>
py::array view(Number* numbers, const ArrayShape& shape, const Shared& rollout) {
  return py::array_t<Number>(shape, numbers, py::cast(rollout));
}

/// Returns what was observed, as VectorEnv has it; all arrays begin with the dimensions `shape`.
py::dict observations(NetworkInputs<float>& inputs, const ArrayShape& shape, const Shared& rollout) {
  const auto with = [&shape](py::ssize_t last) {
    ArrayShape longer = shape;
    longer.push_back(last);
    return longer;
  };
  const std::size_t columns = inputs.goal.size();
  const std::ptrdiff_t dimension = inputs.features.rows();
  py::array_t<float> features(with(dimension));
  py::array_t<std::int8_t> mask(with(kActions));
  for (std::size_t column = 0; column < columns; ++column) {
    const auto seen = inputs.features_of(static_cast<std::ptrdiff_t>(column));
    std::copy(seen.begin(), seen.end(), features.mutable_data() + static_cast<std::ptrdiff_t>(column) * dimension);
    for (int action = 0; action < kActions; ++action)
      mask.mutable_data()[column * kActions + static_cast<std::size_t>(action)] = inputs.allowed[column] >> action & 1;
    if (inputs.previous_action[column] == kNoAction) inputs.previous_action[column] = kActions;
  }
  py::dict named;
  named["features"] = features;
  named["goal"] = view(inputs.goal.data(), shape, rollout);
  named["position"] = view(inputs.position.data(), shape, rollout);
  named["previous_action"] = view(inputs.previous_action.data(), shape, rollout);
  named["action_mask"] = mask;
  named["first"] = view(inputs.first.data(), shape, rollout);
  return named;
}

/// Returns the fields of the Python class Batch.
py::dict batch_of(const Shared& rollout) {
  Rollout& r = *rollout;
  const ArrayShape both = {r.inputs.steps, r.inputs.agents}, agents = {r.inputs.agents};
  py::dict named = observations(r.inputs, both, rollout);
  named["next"] = observations(r.next, agents, rollout);
  named["state"] = view(r.states.data(), {r.states.cols(), r.states.rows()}, rollout);
  named["action"] = view(r.action.data(), both, rollout);
  named["log_probability"] = view(r.log_probability.data(), both, rollout);
  named["value"] = view(r.value.data(), both, rollout);
  named["reward"] = view(r.reward.data(), both, rollout);
  named["ended"] = view(r.ended.data(), both, rollout);
  named["final_value"] = view(r.final_value.data(), both, rollout);
  named["last_value"] = view(r.last_value.data(), agents, rollout);
  return named;
}

py::tuple advantages_of(const Shared& rollout, double gamma, double lambda) {
  rollout->estimate_advantages(gamma, lambda);
  const ArrayShape both = {rollout->inputs.steps, rollout->inputs.agents};
  return py::make_tuple(view(rollout->advantage.data(), both, rollout), view(rollout->target.data(), both, rollout));
}

/// Throws UnknownOption for a figure that no learner has.
UpdateFigures figures_of(const std::map<std::string, double>& given) {
  UpdateFigures figures;
  const std::map<std::string, double*> known = {
#define LEARNED(name, ...) {#name, &figures.name},
#include "core/task/training_figures.inc"
  };
  for (const auto& [name, value] : given) {
    const auto found = known.find(name);
    if (found == known.end()) {
      std::string names;
      for (const auto& [other, place] : known) names += (names.empty() ? "" : ", ") + other;
      throw UnknownOption("unknown figure '" + name + "'", "", "known: " + names);
    }
    *found->second = value;
  }
  return figures;
}

py::dict progress_of(const LearnerThread& learner) {
  const TrainingProgress progress = learner.progress();
  py::dict named;
  named["updates"] = progress.updates;
  named["steps"] = progress.steps;
  named["episodes"] = progress.episodes;
  named["lesson"] = progress.lesson;
  named["reward"] = progress.reward;
  named["spl"] = progress.spl;
  named["episode_length"] = progress.episode_length;
  return named;
}

}  // namespace

void define_trajectories(py::module_& module) {
  py::class_<Rollout, Shared>(module, "Rollout")
      .def("arrays", [](const Shared& rollout) { return batch_of(rollout); })
      .def("advantages", &advantages_of);
  py::class_<Tensor>(module, "Tensor")
      .def_readonly("name", &Tensor::name)
      .def_readonly("rows", &Tensor::rows)
      .def_readonly("cols", &Tensor::cols)
      .def_readonly("offset", &Tensor::offset);
  py::class_<LearnedNetwork>(module, "LearnedNetwork")
      .def_readonly("agent", &LearnedNetwork::agent)
      .def_readonly("values", &LearnedNetwork::values)
      .def_readonly("tensors", &LearnedNetwork::tensors)
      .def_readonly("features", &LearnedNetwork::features)
      .def_readonly("frames", &LearnedNetwork::frames)
      .def_readonly("state_size", &LearnedNetwork::state_size);
  py::class_<LearnerThread, UnlessForked<LearnerThread>>(module, "Learner")
      .def(py::init([](const Keywords& options) {
        const py::gil_scoped_release no_gil;
        keep_participants_of_forked();
        return new LearnerThread(read_learner_options(options), check_signals);
      }))
      .def_property_readonly("network", &LearnerThread::network)
      .def_property_readonly("parameters",
                             [](const LearnerThread& learner) {
                               const Vector<float> flat = learner.parameters();
                               return py::array_t<float>(ArrayShape{flat.size()}, flat.data());
                             })
      .def_property_readonly("progress", &progress_of)
      .def_property_readonly("actors", &LearnerThread::actors)
      .def("next",
           [](LearnerThread& learner) {
             const py::gil_scoped_release no_gil;
             return learner.next(check_signals);
           })
      .def("publish",
           [](LearnerThread& learner, const py::array_t<float>& flat, const std::map<std::string, double>& figures) {
             learner.publish(Eigen::Map<const Vector<float>>(flat.data(), flat.size()), figures_of(figures));
           })
      .def("end", [](LearnerThread& learner, bool dismiss) {
        const py::gil_scoped_release no_gil;
        learner.end(dismiss, check_signals);
      });
}

}  // namespace citylearn::python
