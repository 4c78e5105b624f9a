// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "policy_service/learning/learner.h"
#include "policy_service/learning/training_progress.h"
#include "policy_service/records/policy_service_options.h"

namespace citylearn::python {

/// The network that actors act with.
struct LearnedNetwork {
  std::string agent;                     ///< its name,
  std::map<std::string, double> values;  ///< its parameters
  std::vector<Tensor> tensors;           ///< and what is learned
  int features = 0, frames = 0;          ///< D, N
  int state_size = 0;                    ///< S
};

/// A policy_service --role learner whose updates are computed elsewhere, by one thread of Python's. Another thread, of
/// its own, serves the wire meanwhile.
class LearnerThread {
 public:
  /// Called about every 50 ms of a wait; what it throws ends the wait.
  using Interrupt = std::function<void()>;

  /// Starts the learner and waits until an env_service has told what is learned from. Throws EnvServicesMissing after
  /// `options.wait` seconds, and Error.
  LearnerThread(const PolicyServiceOptions& options, const Interrupt& interrupt);
  /// Ends it without dismissing the actors.
  ~LearnerThread();
  LearnerThread(const LearnerThread&) = delete;
  LearnerThread& operator=(const LearnerThread&) = delete;

  const LearnedNetwork& network() const;
  /// Returns the parameters that actors have, or are being sent.
  Vector<float> parameters() const;
  /// Returns how far training had come when the last batch was made, or at the end.
  TrainingProgress progress() const;
  int actors() const;  ///< number of actors heard lately

  /// Waits for the next batch: one sequence of as many agents as an update learns from. One that is not answered leaves
  /// the parameters as they are. Returns null when training has ended. Throws ServiceMissing when none has come for
  /// `options.wait` seconds, and what ended the learner.
  std::shared_ptr<Rollout> next(const Interrupt& interrupt);
  /// Answers the last batch: actors get these parameters.
  void publish(Vector<float> parameters, const UpdateFigures& figures);
  /// Ends training, saves the last checkpoint, and dismisses the actors or lets them wait for a learner that resumes.
  void end(bool dismiss, const Interrupt& interrupt);

 private:
  struct Exchange;
  void wait(const Interrupt& interrupt, const std::function<bool()>& done) const;
  void run();

  const PolicyServiceOptions options_;
  const std::unique_ptr<Exchange> exchange_;
  std::jthread thread_;
};

}  // namespace citylearn::python
