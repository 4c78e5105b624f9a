// SPDX-License-Identifier: Apache-2.0
#include "lstm.h"

#include <algorithm>
#include <cmath>

#include "product.h"

namespace citylearn {

template <class S>
LstmNetwork<S>::LstmNetwork(const Parameters& parameters, int sensors)
    : sensors_(sensors),
      hidden_(parameters.integer("hidden")),
      cells_(parameters.integer("cells")),
      extra_(parameters.flag("mask-input") ? 2 * kActions : kActions),
      rectified_(parameters.flag("relu")) {
  sensor_weights_ = layout_.add("sensors.weight", hidden_, sensors_);
  sensor_bias_ = layout_.add("sensors.bias", hidden_, 1);
  input_weights_ = layout_.add("lstm.input", 4 * cells_, hidden_ + extra_);
  recurrent_weights_ = layout_.add("lstm.recurrent", 4 * cells_, cells_);
  gate_bias_ = layout_.add("lstm.bias", 4 * cells_, 1);
  head_weights_ = layout_.add("heads.weight", kActions + 1, cells_);
  head_bias_ = layout_.add("heads.bias", kActions + 1, 1);
  auxiliary_weights_ = layout_.add("auxiliary.weight", 2, cells_);
  auxiliary_bias_ = layout_.add("auxiliary.bias", 2, 1);
}

template <class S>
void LstmNetwork<S>::initialise(Random& random, Vector<S>& parameters) const {
  parameters.setZero(layout_.size());
  orthogonal<S>(random, std::sqrt(2.0), layout_.view(parameters, sensor_weights_));
  orthogonal<S>(random, 1, layout_.view(parameters, input_weights_));
  orthogonal<S>(random, 1, layout_.view(parameters, recurrent_weights_));
  orthogonal<S>(random, 1, layout_.view(parameters, head_weights_));
  layout_.view(parameters, head_weights_).topRows(kActions) *= S(0.01);
  orthogonal<S>(random, 1, layout_.view(parameters, auxiliary_weights_));
  layout_.view(parameters, gate_bias_).middleRows(cells_, cells_).setOnes();  // remember at first
}

template <class S>
void LstmNetwork<S>::forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
                             Workspace<S>& workspace) const {
  Work& work = static_cast<Work&>(workspace);
  const std::ptrdiff_t agents = inputs.agents, columns = agents * inputs.steps;
  resize(work, agents, columns);
  if (work.fixed == 0 || work.fixed != work.packed_of)
    for (PackedWeights<S>* weights : {&work.sensor_weights, &work.input_weights, &work.recurrent_weights})
      weights->changed();
  work.packed_of = work.fixed;
  const bool acts_packed = work.fixed && PackedWeights<S>::pay_for_steps(columns);
  work.sensor_weights.share(acts_packed);
  work.input_weights.share(acts_packed);
  work.recurrent_weights.share(acts_packed || inputs.steps > 1);

  auto embedded = work.lstm_input.topRows(hidden_);
  embed(parameters, inputs, work, embedded);
  if (rectified_)
    embedded = embedded.cwiseMax(S(0));
  else
    embedded = embedded.array().tanh();
  append_actions(inputs, work.lstm_input);

  work.input_weights.set_product(work.gates, layout_.view(parameters, input_weights_),
                                 work.lstm_input.topRows(hidden_ + extra_));
  work.gates.colwise() += layout_.view(parameters, gate_bias_).col(0);
  const auto recurrent = layout_.view(parameters, recurrent_weights_);
  for (std::ptrdiff_t t = 0; t < inputs.steps; ++t) {
    const std::ptrdiff_t begin = t * agents;
    auto before_h = work.lstm_input.middleCols(begin, agents).bottomRows(cells_);
    auto before_c = work.before_c.middleCols(begin, agents);
    if (t == 0) {
      before_h = state.topRows(cells_);
      before_c = state.bottomRows(cells_);
    } else {
      before_h = work.h.middleCols(begin - agents, agents);
      before_c = work.c.middleCols(begin - agents, agents);
    }
    for (std::ptrdiff_t b = 0; b < agents; ++b) {
      if (!inputs.first[static_cast<std::size_t>(begin + b)]) continue;
      before_h.col(b).setZero();
      before_c.col(b).setZero();
    }
    auto gates = work.gates.middleCols(begin, agents);
    work.recurrent_weights.add_product(gates, recurrent, before_h);
    for (std::ptrdiff_t b = 0; b < agents; ++b) {  // column by column: what is just computed is still in the cache
      auto gate = gates.col(b);
      gate.head(3 * cells_) = gate.head(3 * cells_).array().logistic();
      gate.tail(cells_) = gate.tail(cells_).array().tanh();
      const auto input = gate.segment(0, cells_).array(), forget = gate.segment(cells_, cells_).array();
      const auto output = gate.segment(2 * cells_, cells_).array(), candidate = gate.tail(cells_).array();
      auto c = work.c.col(begin + b), tanh_c = work.tanh_c.col(begin + b), h = work.h.col(begin + b);
      c = forget * before_c.col(b).array() + input * candidate;
      tanh_c = c.array().tanh();
      h = output * tanh_c.array();
    }
  }
  work.state.topRows(cells_) = work.h.rightCols(agents);
  work.state.bottomRows(cells_) = work.c.rightCols(agents);

  set_product(work.both, layout_.view(parameters, head_weights_), work.h);
  work.both.colwise() += layout_.view(parameters, head_bias_).col(0);
  work.heads.logits = work.both.topRows(kActions);
  work.heads.values = work.both.bottomRows(1);
  mask_logits(inputs.allowed, work.heads.logits);
  if (work.localise) {
    set_product(work.heads.auxiliary, layout_.view(parameters, auxiliary_weights_), work.h);
    work.heads.auxiliary.colwise() += layout_.view(parameters, auxiliary_bias_).col(0);
  }
}

template <class S>
void LstmNetwork<S>::backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                              const Heads<S>& derivative, Vector<S>& gradient) const {
  Work& work = static_cast<Work&>(workspace);
  const std::ptrdiff_t agents = inputs.agents;
  work.both.topRows(kActions) = derivative.logits;
  work.both.bottomRows(1) = derivative.values;
  add_product(layout_.view(gradient, head_weights_), work.both, work.h.transpose());
  layout_.view(gradient, head_bias_) += work.both.rowwise().sum();
  set_product(work.h_gradient, layout_.view(parameters, head_weights_).transpose(), work.both);
  if (derivative.auxiliary.size() > 0) {
    add_product(layout_.view(gradient, auxiliary_weights_), derivative.auxiliary, work.h.transpose());
    layout_.view(gradient, auxiliary_bias_) += derivative.auxiliary.rowwise().sum();
    add_product(work.h_gradient, layout_.view(parameters, auxiliary_weights_).transpose(), derivative.auxiliary);
  }

  const auto recurrent_back = layout_.view(parameters, recurrent_weights_).transpose();
  work.recurrent_back.changed();
  work.carried_c.setZero(cells_, agents);
  work.carried_h.setZero(cells_, agents);
  for (std::ptrdiff_t t = inputs.steps - 1; t >= 0; --t) {
    const std::ptrdiff_t begin = t * agents;
    auto gates = work.gates.middleCols(begin, agents);  // becomes the gradient by what enters the gates
    for (std::ptrdiff_t b = 0; b < agents; ++b) {
      auto gate = gates.col(b);
      auto input = gate.segment(0, cells_).array(), forget = gate.segment(cells_, cells_).array();
      auto output = gate.segment(2 * cells_, cells_).array(), candidate = gate.tail(cells_).array();
      const auto tanh_c = work.tanh_c.col(begin + b).array(), before_c = work.before_c.col(begin + b).array();
      auto dh = work.h_gradient.col(begin + b).array();
      auto dc = work.carried_c.col(b).array();
      dh += work.carried_h.col(b).array();
      dc += dh * output * (S(1) - tanh_c.square());
      output = dh * tanh_c * output * (S(1) - output);
      work.column = dc * candidate.matrix().array() * input * (S(1) - input);
      candidate = dc * input * (S(1) - candidate.square());
      input = work.column.array();
      work.column = dc * forget;
      forget = dc * before_c * forget * (S(1) - forget);
      if (inputs.first[static_cast<std::size_t>(begin + b)])
        dc.setZero();
      else
        dc = work.column.array();
    }
    if (t == 0) break;
    work.recurrent_back.set_product(work.carried_h, recurrent_back, gates);
    for (std::ptrdiff_t b = 0; b < agents; ++b)
      if (inputs.first[static_cast<std::size_t>(begin + b)]) work.carried_h.col(b).setZero();
  }

  work.left = &work.gates;
  work.right = &work.lstm_input;
  const Tensor joined = joined_weights();
  if (!work.joins)
    add_product(Eigen::Map<Matrix<S>>(gradient.data() + joined.offset, joined.rows, joined.cols), work.gates,
                work.lstm_input.transpose());
  layout_.view(gradient, gate_bias_) += work.gates.rowwise().sum();
  set_product(work.embedded_gradient, layout_.view(parameters, input_weights_).leftCols(hidden_).transpose(),
              work.gates);
  const auto embedded = work.lstm_input.topRows(hidden_).array();
  if (rectified_)
    work.embedded_gradient.array() *= (embedded > S(0)).template cast<S>();
  else
    work.embedded_gradient.array() *= S(1) - embedded.square();
  unembed(parameters, inputs, work, gradient);
}

template <class S>
void LstmNetwork<S>::embed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
                           Eigen::Block<Matrix<S>> embedded) const {
  work.sensed.resize(sensors_, embedded.cols());
  sense(inputs, work.sensed);
  work.sensor_weights.set_product(embedded, layout_.view(parameters, sensor_weights_), work.sensed);
  embedded.colwise() += layout_.view(parameters, sensor_bias_).col(0);
}

template <class S>
void LstmNetwork<S>::unembed(const Vector<S>& /*parameters*/, const NetworkInputs<S>& /*inputs*/, Work& work,
                             Vector<S>& gradient) const {
  add_product(layout_.view(gradient, sensor_weights_), work.embedded_gradient, work.sensed.transpose());
  layout_.view(gradient, sensor_bias_) += work.embedded_gradient.rowwise().sum();
}

template <class S>
void LstmNetwork<S>::resize(Work& work, std::ptrdiff_t agents, std::ptrdiff_t columns) const {
  work.lstm_input.resize(hidden_ + extra_ + cells_, columns);
  work.gates.resize(4 * cells_, columns);
  for (Matrix<S>* part : {&work.before_c, &work.h, &work.c, &work.tanh_c}) part->resize(cells_, columns);
  work.both.resize(kActions + 1, columns);
  work.state.resize(2 * cells_, agents);
  if (work.localise) work.heads.auxiliary.resize(2, columns);
}

template <class S>
void LstmNetwork<S>::append_actions(const NetworkInputs<S>& inputs, Matrix<S>& lstm_input) const {
  lstm_input.middleRows(hidden_, extra_).setZero();
  for (std::ptrdiff_t column = 0; column < lstm_input.cols(); ++column) {
    const std::uint8_t previous = inputs.previous_action[static_cast<std::size_t>(column)];
    if (previous < kActions) lstm_input(hidden_ + previous, column) = 1;
    if (extra_ == kActions) continue;
    for (int action = 0; action < kActions; ++action)
      if (!(inputs.allowed[static_cast<std::size_t>(column)] >> action & 1))
        lstm_input(hidden_ + kActions + action, column) = 1;
  }
}

template class LstmNetwork<NetworkScalar>;

}  // namespace citylearn
