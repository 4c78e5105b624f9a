// SPDX-License-Identifier: Apache-2.0
// place_filter on streets.
#include <gtest/gtest.h>

#include <algorithm>

#include "policy_service/network/agent_network.h"
#include "policy_service/network/layers/layers.h"
#include "tests/support/networks/carried_state.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/streets.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::unique_ptr<AgentNetwork<double>> street_network(const NetworkTask& task, std::map<std::string, double> values) {
  const auto& entry = NetworkRegistry<double>::instance().find("network", "place_filter");
  values["units"] = 5;
  return entry.create(Parameters(entry.name, entry.parameters, values), task);
}

Vector<double> some_parameters(const AgentNetwork<double>& network) {
  Random random{4};
  Vector<double> parameters;
  network.initialise(random, parameters);
  for (double& value : parameters) value += 0.1 * random.normal();
  return parameters;
}

TEST(StreetFilter, CarriesItsStateFromCallToCall) {
  const NetworkTask task = street_task(small_states());
  const auto network = street_network(task, {});
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  expect_carried_state(*network, some_parameters(*network), inputs, some_state(*network, inputs.agents));
}

/// On streets seen in a mirror, left and right are exchanged and all else is the same.
TEST(StreetFilter, FavoursNeitherSide) {
  StreetMap streets = small_streets();
  streets.heading[8] = 170;  // by no tie two links are equally near to the heading from the dead end
  StreetMap mirrored = streets;
  for (float& east : mirrored.east) east = -east;
  for (float& heading : mirrored.heading) heading = 360 - heading;
  const std::vector<std::uint32_t> before = mirrored.put_in_order();
  std::vector<int> image(before.size());  // of a state
  for (std::size_t state = 0; state < before.size(); ++state) image[before[state]] = static_cast<int>(state);
  const auto map_of = [](const StreetMap& map) {
    return std::make_shared<const StateMap>(map, StateRule::kStreet, 100);
  };
  const NetworkTask task = street_task(map_of(streets));
  NetworkTask other = task;
  other.streets = map_of(mirrored);
  for (std::size_t state = 0; state < image.size(); ++state)
    other.reference.col(image[state]) = task.reference.col(static_cast<std::ptrdiff_t>(state));
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  NetworkInputs<double> reflected;
  reflected.resize(task.features, inputs.steps, inputs.agents);
  reflected.frames = inputs.frames;
  for (std::size_t i = 0; i < inputs.goal.size(); ++i) {
    const auto column = static_cast<std::ptrdiff_t>(i);
    reflected.copy_column(inputs, column, column);
    reflected.position[i] = image[static_cast<std::size_t>(inputs.position[i])];
    ASSERT_EQ(other.streets->allowed(reflected.position[i]), inputs.allowed[i]);
    if (inputs.previous_action[i] == kLeft || inputs.previous_action[i] == kRight)
      reflected.previous_action[i] = static_cast<std::uint8_t>(kLeft + kRight - inputs.previous_action[i]);
  }
  const auto network = street_network(task, {}), twin = street_network(other, {});
  const Vector<double> parameters = some_parameters(*network);
  const Matrix<double> state = Matrix<double>::Zero(network->state_size(), inputs.agents);
  const auto seen = network->make_workspace(), in_the_mirror = twin->make_workspace();
  network->forward(parameters, inputs, state, *seen);
  twin->forward(parameters, reflected, state, *in_the_mirror);
  EXPECT_TRUE(seen->heads.values.isApprox(in_the_mirror->heads.values, 1e-9));
  EXPECT_TRUE(seen->heads.logits.row(kForward).isApprox(in_the_mirror->heads.logits.row(kForward), 1e-9));
  EXPECT_TRUE(seen->heads.logits.row(kLeft).isApprox(in_the_mirror->heads.logits.row(kRight), 1e-9));
  EXPECT_TRUE(seen->heads.logits.row(kRight).isApprox(in_the_mirror->heads.logits.row(kLeft), 1e-9));
  EXPECT_GT((seen->heads.logits.row(kLeft) - seen->heads.logits.row(kRight)).cwiseAbs().maxCoeff(), 0.01);
}

/// After four turns in a row it goes forward; a turn is then no choice.
TEST(StreetFilter, DoesNotTurnForEver) {
  const NetworkTask task = street_task(small_states());
  const auto network = street_network(task, {});
  const Vector<double> parameters = some_parameters(*network);
  const auto workspace = network->make_workspace();
  Matrix<double> state = Matrix<double>::Zero(network->state_size(), 1);
  for (int step = 0; step < 7; ++step) {
    const int position = step % 2 == 0 ? 2 : 3;  // turns round at place 1
    NetworkInputs<double> inputs;
    inputs.resize(task.features, 1, 1);
    inputs.frames = task.frames;
    inputs.position[0] = position;
    inputs.goal[0] = 6;
    inputs.first[0] = step == 0;
    inputs.previous_action[0] = step == 0 ? std::uint8_t{kNoAction} : std::uint8_t{kRight};
    inputs.allowed[0] = 7;
    inputs.see(0, position, task.reference.col(position).cast<double>());
    network->forward(parameters, inputs, state, *workspace);
    state = workspace->state;
    EXPECT_EQ(workspace->heads.logits(kLeft, 0) < 0.5 * kMasked, step >= 4) << step;
    EXPECT_EQ(workspace->heads.logits(kRight, 0) < 0.5 * kMasked, step >= 4) << step;
    EXPECT_GT(workspace->heads.logits(kForward, 0), 0.5 * kMasked);
  }
}

}  // namespace
}  // namespace citylearn::testing
