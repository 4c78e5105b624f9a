// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "policy_service/distributed/learner_server.h"
#include "policy_service/run/training_run.h"

namespace citylearn {

/// Learns from what actors send (role learner).
class LearnerRun : public TrainingRun {
 public:
  using TrainingRun::TrainingRun;
  ~LearnerRun() override { context_.on_spin = nullptr; }

 private:
  void train() override;
  void evaluate_others() override;
  double policy_lag() const override { return server_->policy_lag(); }
  std::string actors_note() const override;
  void await_release();

  std::unique_ptr<LearnerServer> server_;
};

}  // namespace citylearn
