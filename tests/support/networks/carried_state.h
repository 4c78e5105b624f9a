// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include "policy_service/network/agent_network.h"

namespace citylearn::testing {

/// Expects B agents over T steps to be as each agent and step alone. `begin`: the state before the first step.
inline void expect_carried_state(const AgentNetwork<double>& network, const Vector<double>& parameters,
                                 const NetworkInputs<double>& inputs, const Matrix<double>& begin) {
  const auto together = network.make_workspace(), single = network.make_workspace();
  network.forward(parameters, inputs, begin, *together);
  for (int b = 0; b < inputs.agents; ++b) {
    Matrix<double> state = begin.col(b);
    for (int t = 0; t < inputs.steps; ++t) {
      NetworkInputs<double> one;
      one.resize(static_cast<int>(inputs.features.rows()), 1, 1);
      one.frames = inputs.frames;
      one.copy_column(inputs, t * inputs.agents + b, 0);
      network.forward(parameters, one, state, *single);
      state = single->state;
      EXPECT_TRUE(single->heads.logits.col(0).isApprox(together->heads.logits.col(t * inputs.agents + b), 1e-9));
      EXPECT_NEAR(single->heads.values(0), together->heads.values(t * inputs.agents + b), 1e-9);
    }
    EXPECT_TRUE(state.isApprox(together->state.col(b), 1e-9));
  }
}

}  // namespace citylearn::testing
