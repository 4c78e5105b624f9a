// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "policy_service/network/agent_network.h"

namespace citylearn {

class OnnxGraph;

/// A tensor within a graph, batch x width unless an operator made it otherwise. The operators below append a node each,
/// element by element; a side of 1 is stretched to the other's length.
struct OnnxValue {
  OnnxGraph* graph = nullptr;  ///< outlives it
  std::string name;
};
OnnxValue operator+(const OnnxValue& a, const OnnxValue& b);
OnnxValue operator-(const OnnxValue& a, const OnnxValue& b);
OnnxValue operator*(const OnnxValue& a, const OnnxValue& b);
OnnxValue operator+(const OnnxValue& a, float b);
OnnxValue operator*(float a, const OnnxValue& b);
OnnxValue relu(const OnnxValue& x);
OnnxValue tanh(const OnnxValue& x);
OnnxValue sigmoid(const OnnxValue& x);
OnnxValue exp(const OnnxValue& x);
OnnxValue log(const OnnxValue& x);
OnnxValue softmax(const OnnxValue& x);  ///< over each row

/// Builds an ONNX model node by node (https://github.com/onnx/onnx, onnx.proto). Numbers are 32-bit floats, the first
/// side of inputs and outputs is the batch, of any size.
class OnnxGraph {
 public:
  /// The version of the operators' definitions: the newest that readers of some years ago (OpenCV 4.6) know well.
  static constexpr int kOpset = 11;
  using Attribute = std::pair<std::string, std::variant<std::int64_t, float, std::vector<std::int64_t>>>;

  explicit OnnxGraph(const std::string& name);
  virtual ~OnnxGraph();
  OnnxGraph(const OnnxGraph&) = delete;
  OnnxGraph& operator=(const OnnxGraph&) = delete;

  OnnxValue input(const std::string& name, std::int64_t width, const std::string& help);
  void output(const std::string& name, const OnnxValue& value, std::int64_t width, const std::string& help);
  /// Adds numbers that the model keeps, rows x cols, named as the tensor they come from.
  OnnxValue constant(const std::string& name, const Eigen::Ref<const Matrix<float>>& numbers);
  /// Returns the same with sides of its own; `numbers` row by row.
  OnnxValue constant(const std::string& name, const std::vector<std::int64_t>& shape,
                     const std::vector<float>& numbers);
  /// Adds any operator of the opset, with one output.
  OnnxValue node(const std::string& type, const std::vector<OnnxValue>& inputs,
                 const std::vector<Attribute>& attributes = {});
  /// Integers as an operator's input (a Reshape's sides).
  OnnxValue integers(const std::vector<std::int64_t>& numbers);

  /// x (batch x in) through a linear layer: `weight` out x in, `bias` out x 1.
  OnnxValue linear(const OnnxValue& x, const std::string& name, const Eigen::Ref<const Matrix<float>>& weight);
  OnnxValue linear(const OnnxValue& x, const std::string& name, const Eigen::Ref<const Matrix<float>>& weight,
                   const std::string& bias_name, const Eigen::Ref<const Matrix<float>>& bias);
  /// batch x 1 to batch x width, the same in each column.
  OnnxValue stretched(const OnnxValue& x, std::int64_t width);
  /// Returns each row of `width` numbers over its length; zeros stay zeros.
  OnnxValue unit_length(const OnnxValue& x, std::int64_t width);
  /// Returns the columns begin .. end - 1.
  OnnxValue columns(const OnnxValue& x, std::int64_t begin, std::int64_t end);
  /// Joins them side by side.
  OnnxValue concat(const std::vector<OnnxValue>& parts);

  /// Returns the model as a file's bytes, the same for the same graph.
  std::string bytes(const std::string& help, const std::map<std::string, std::string>& metadata) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
