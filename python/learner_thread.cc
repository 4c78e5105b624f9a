// SPDX-License-Identifier: Apache-2.0
#include "python/learner_thread.h"

#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

#include "core/exchange/timing.h"
#include "policy_service/distributed/final_status_guard.h"
#include "policy_service/learning/optimization/random_streams.h"
#include "policy_service/learning/optimization/saved_state.h"
#include "policy_service/run/training_run.h"
#include "python/errors.h"

namespace citylearn::python {

/// The data that the two threads exchange.
struct LearnerThread::Exchange {
  struct Answer {
    Vector<float> parameters;
    UpdateFigures figures;
  };

  std::mutex mutex;
  std::condition_variable changed;
  std::optional<LearnedNetwork> network;  // set once, before `ready`
  bool ready = false;                     // for batches: nothing else changes the parameters
  Vector<float> parameters;
  std::shared_ptr<Rollout> batch;  // that an update waits for
  bool taken = false;              // next() has returned it
  std::optional<Answer> answer;
  bool stop = false, dismiss = false;  // wanted of the learner: to stop, and then to dismiss its actors
  bool over = false;                   // the learner has ended, by
  std::exception_ptr failure;          // or null
  TrainingProgress progress;
  int actors = 0;
};

namespace {

/// Lets Python make the updates. Python's own state, such as Adam's moments, is not part of what it saves.
template <class Exchange>
class PythonLearner : public Learner {
 public:
  PythonLearner(const LearnerTask& task, Exchange& exchange) : exchange_(exchange) {
    Random random{task.seed, kInitialise};
    task.network.initialise(random, parameters_);
    const std::lock_guard lock(exchange.mutex);
    exchange.network = LearnedNetwork{task.agent,         task.parameters.values(), task.network.tensors(),
                                      task.task.features, task.task.frames,         task.network.state_size()};
    exchange.parameters = parameters_;
  }

  UpdateFigures update(std::span<Rollout* const> /*rollouts*/) override {
    const std::lock_guard lock(exchange_.mutex);
    typename Exchange::Answer answer = *std::exchange(exchange_.answer, std::nullopt);
    exchange_.batch.reset();
    exchange_.parameters = parameters_ = std::move(answer.parameters);
    ++updates_;
    return answer.figures;
  }

  const Vector<float>& parameters() const override { return parameters_; }

  void save(LearnerState& state) const override {
    state.counters = {{"updates", updates_}};
    state.tensors = {{"parameters", parameters_}};
  }

  void load(const LearnerState& state) override {
    require_state(state, "learner python", {"updates"}, {"parameters"}, parameters_.size());
    updates_ = state.counters.at("updates");
    parameters_ = state.tensors.at("parameters");
    const std::lock_guard lock(exchange_.mutex);
    exchange_.parameters = parameters_;
  }

 private:
  Exchange& exchange_;
  Vector<float> parameters_;
  std::uint64_t updates_ = 0;
};

/// Makes the learner of the LearnerThread that this thread is of. A registered factory knows its parameters alone.
thread_local std::function<std::unique_ptr<Learner>(const LearnerTask&)> make_learner;

const LearnerRegistry::Registration registration{
    {"python", "updates that a Python program computes", {}, [](const Parameters&, const LearnerTask& task) {
       if (!make_learner) throw Error("learns in a Python program", "learner python", "use citylearn.Trajectories");
       return make_learner(task);
     }}};

}  // namespace

LearnerThread::LearnerThread(const PolicyServiceOptions& options, const Interrupt& interrupt)
    : options_(options), exchange_(std::make_unique<Exchange>()), thread_([this] { run(); }) {
  try {
    wait(interrupt, [this] { return exchange_->ready || exchange_->over; });
    if (exchange_->failure) std::rethrow_exception(exchange_->failure);
  } catch (...) {
    const std::lock_guard lock(exchange_->mutex);
    exchange_->stop = true;
    throw;
  }
}

LearnerThread::~LearnerThread() {
  const std::lock_guard lock(exchange_->mutex);
  exchange_->stop = true;
  exchange_->changed.notify_all();
}

/// Waits until done(), which is called under the lock.
void LearnerThread::wait(const Interrupt& interrupt, const std::function<bool()>& done) const {
  std::unique_lock lock(exchange_->mutex);
  while (!exchange_->changed.wait_for(lock, kStopCheckInterval, done)) {
    lock.unlock();
    interrupt();
    lock.lock();
  }
}

void LearnerThread::run() {
  Exchange& x = *exchange_;
  make_learner = [&x](const LearnerTask& task) { return std::make_unique<PythonLearner<Exchange>>(task, x); };
  std::exception_ptr failure;
  try {
    Node node(options_.node);
    const FinalStatusGuard final_status(node);
    EnvClient client(node, options_.client);
    RunContext context(options_, node, client);
    context.progress.hide();
    EvaluationRun evaluation(context);
    LearnerRun training(context, evaluation);
    context.stopped = [&] {
      const std::lock_guard lock(x.mutex);
      x.actors = training.actors();
      if (training.trainer() && !std::exchange(x.ready, true)) {
        x.progress = training.trainer()->progress();
        x.changed.notify_all();
      }
      return x.stop && !x.answer;  // what was published before the end counts
    };
    training.compute = [&](const Rollout& rollout) {
      std::unique_lock lock(x.mutex);
      if (!x.batch) {
        x.batch = std::make_shared<Rollout>(rollout);
        x.taken = false;
        x.progress = training.trainer()->progress();
        x.changed.notify_all();
      }
      x.changed.wait_for(lock, kStopCheckInterval, [&x] { return x.answer || x.stop; });
      return x.answer.has_value();
    };
    bool dismiss = true;
    try {
      training.execute();
    } catch (const StopRequested&) {
      const std::lock_guard lock(x.mutex);
      dismiss = x.dismiss;
    }
    context.stopped = nullptr;
    if (training.trainer()) {
      const std::lock_guard lock(x.mutex);
      x.progress = training.trainer()->progress();
    }
    if (dismiss) {
      training.dismiss_actors();
      context.records.require_all_written();
      context.leave();
    }
  } catch (const StopRequested&) {  // before there was anything to end
  } catch (...) {
    failure = std::current_exception();
  }
  const std::lock_guard lock(x.mutex);
  x.failure = failure;
  x.over = true;
  x.changed.notify_all();
}

const LearnedNetwork& LearnerThread::network() const { return *exchange_->network; }

Vector<float> LearnerThread::parameters() const {
  const std::lock_guard lock(exchange_->mutex);
  return exchange_->parameters;
}

TrainingProgress LearnerThread::progress() const {
  const std::lock_guard lock(exchange_->mutex);
  return exchange_->progress;
}

int LearnerThread::actors() const {
  const std::lock_guard lock(exchange_->mutex);
  return exchange_->actors;
}

std::shared_ptr<Rollout> LearnerThread::next(const Interrupt& interrupt) {
  Exchange& x = *exchange_;
  {
    const std::lock_guard lock(x.mutex);
    if (x.batch && x.taken && !x.answer) x.answer = {x.parameters, {}};
    x.changed.notify_all();
  }
  const Clock::time_point since = Clock::now();
  const auto too_late = [&] { return seconds_since(since) > options_.wait; };
  const auto offered = [&x] { return x.batch && !x.taken && !x.answer; };
  wait(interrupt, [&] { return offered() || x.over || too_late(); });
  const std::lock_guard lock(x.mutex);
  if (x.failure) std::rethrow_exception(x.failure);
  if (x.over) return nullptr;
  if (offered()) {
    x.taken = true;
    return x.batch;
  }
  const std::string seconds = std::to_string(static_cast<int>(options_.wait)) + " s";
  if (x.actors == 0)
    throw ServiceMissing("no actor has come within " + seconds, "",
                         "start policy_service with role actor in the same session '" + options_.node.session +
                             "', domain " + std::to_string(options_.node.middleware.domain) + " and interface");
  throw ServiceMissing(std::to_string(x.actors) + (x.actors == 1 ? " actor has" : " actors have") +
                           " not sent a whole batch within " + seconds,
                       "", "are there env_services on '" + options_.train.front() + "' for them?");
}

void LearnerThread::publish(Vector<float> parameters, const UpdateFigures& figures) {
  Exchange& x = *exchange_;
  const std::lock_guard lock(x.mutex);
  if (x.failure) std::rethrow_exception(x.failure);
  x.answer = {std::move(parameters), figures};
  x.changed.notify_all();
}

void LearnerThread::end(bool dismiss, const Interrupt& interrupt) {
  Exchange& x = *exchange_;
  {
    const std::lock_guard lock(x.mutex);
    x.stop = true;
    x.dismiss = dismiss;
    x.changed.notify_all();
  }
  wait(interrupt, [&x] { return x.over; });
  if (x.failure) std::rethrow_exception(x.failure);
}

}  // namespace citylearn::python
