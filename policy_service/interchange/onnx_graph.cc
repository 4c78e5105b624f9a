// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/onnx_graph.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <onnx/onnx_pb.h>

#include <bit>
#include <set>

#include "core/util/error.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are written as they lie in memory");

constexpr int kIrVersion = 6;  // of the format itself, as it came with opset 11
constexpr const char* kProducer = "citylearn";

void describe(onnx::ValueInfoProto& value, const std::string& name, std::int64_t width, const std::string& help) {
  value.set_name(name);
  value.set_doc_string(help);
  auto& tensor = *value.mutable_type()->mutable_tensor_type();
  tensor.set_elem_type(onnx::TensorProto::FLOAT);
  tensor.mutable_shape()->add_dim()->set_dim_param("batch");
  tensor.mutable_shape()->add_dim()->set_dim_value(width);
}

}  // namespace

struct OnnxGraph::Impl {
  onnx::GraphProto graph;
  std::set<std::string> names;

  /// `wanted`, with a number where it is taken.
  std::string fresh(const std::string& wanted) {
    std::string name = wanted;
    for (int number = 2; !names.insert(name).second; ++number) name = wanted + "_" + std::to_string(number);
    return name;
  }
  onnx::TensorProto& tensor(const std::string& name, int type, const std::vector<std::int64_t>& shape,
                            const void* numbers, std::size_t bytes) {
    onnx::TensorProto& added = *graph.add_initializer();
    added.set_name(fresh(name));
    added.set_data_type(type);
    for (const std::int64_t side : shape) added.add_dims(side);
    added.set_raw_data(numbers, bytes);
    return added;
  }
};

OnnxGraph::OnnxGraph(const std::string& name) : impl_(std::make_unique<Impl>()) { impl_->graph.set_name(name); }
OnnxGraph::~OnnxGraph() = default;

OnnxValue OnnxGraph::input(const std::string& name, std::int64_t width, const std::string& help) {
  if (!impl_->names.insert(name).second) throw Error("is there already", "input " + name);
  describe(*impl_->graph.add_input(), name, width, help);
  return {this, name};
}

void OnnxGraph::output(const std::string& name, const OnnxValue& value, std::int64_t width, const std::string& help) {
  if (!impl_->names.insert(name).second) throw Error("is there already", "output " + name);
  onnx::NodeProto& node = *impl_->graph.add_node();
  node.set_op_type("Identity");
  node.set_name(impl_->fresh("out_" + name));
  node.add_input(value.name);
  node.add_output(name);
  describe(*impl_->graph.add_output(), name, width, help);
}

OnnxValue OnnxGraph::constant(const std::string& name, const Eigen::Ref<const Matrix<float>>& numbers) {
  const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rows = numbers;
  const auto& added = impl_->tensor(name, onnx::TensorProto::FLOAT, {rows.rows(), rows.cols()}, rows.data(),
                                    static_cast<std::size_t>(rows.size()) * sizeof(float));
  return {this, added.name()};
}

OnnxValue OnnxGraph::constant(const std::string& name, const std::vector<std::int64_t>& shape,
                              const std::vector<float>& numbers) {
  const auto& added =
      impl_->tensor(name, onnx::TensorProto::FLOAT, shape, numbers.data(), numbers.size() * sizeof(float));
  return {this, added.name()};
}

OnnxValue OnnxGraph::integers(const std::vector<std::int64_t>& numbers) {
  const auto& added = impl_->tensor("integers", onnx::TensorProto::INT64, {static_cast<std::int64_t>(numbers.size())},
                                    numbers.data(), numbers.size() * sizeof(std::int64_t));
  return {this, added.name()};
}

OnnxValue OnnxGraph::node(const std::string& type, const std::vector<OnnxValue>& inputs,
                          const std::vector<Attribute>& attributes) {
  onnx::NodeProto& node = *impl_->graph.add_node();
  node.set_op_type(type);
  node.set_name(impl_->fresh(type));
  for (const OnnxValue& one : inputs) node.add_input(one.name);
  node.add_output(impl_->fresh(node.name() + "_out"));
  for (const auto& [name, value] : attributes) {
    onnx::AttributeProto& attribute = *node.add_attribute();
    attribute.set_name(name);
    if (const auto* number = std::get_if<std::int64_t>(&value)) {
      attribute.set_type(onnx::AttributeProto::INT);
      attribute.set_i(*number);
    } else if (const auto* real = std::get_if<float>(&value)) {
      attribute.set_type(onnx::AttributeProto::FLOAT);
      attribute.set_f(*real);
    } else {
      attribute.set_type(onnx::AttributeProto::INTS);
      for (const std::int64_t one : std::get<std::vector<std::int64_t>>(value)) attribute.add_ints(one);
    }
  }
  return {this, node.output(0)};
}

OnnxValue OnnxGraph::linear(const OnnxValue& x, const std::string& name,
                            const Eigen::Ref<const Matrix<float>>& weight) {
  // The bias may be left out from opset 11 on only.
  return linear(x, name, weight, name + ".none", Matrix<float>::Zero(weight.rows(), 1));
}

OnnxValue OnnxGraph::linear(const OnnxValue& x, const std::string& name, const Eigen::Ref<const Matrix<float>>& weight,
                            const std::string& bias_name, const Eigen::Ref<const Matrix<float>>& bias) {
  const std::vector<float> numbers(bias.reshaped().begin(), bias.reshaped().end());
  return node("Gemm", {x, constant(name, weight), constant(bias_name, {bias.size()}, numbers)},
              {{"transB", std::int64_t{1}}});
}

OnnxValue OnnxGraph::stretched(const OnnxValue& x, std::int64_t width) {
  return linear(x, "ones", Matrix<float>::Ones(width, 1));  // readers differ in what they stretch by themselves
}

OnnxValue OnnxGraph::unit_length(const OnnxValue& x, std::int64_t width) {
  const OnnxValue length = linear(x * x, "sum", Matrix<float>::Ones(1, width));
  return x * stretched(exp(-0.5f * log(length + 1e-30f)), width);
}

OnnxValue OnnxGraph::columns(const OnnxValue& x, std::int64_t begin, std::int64_t end) {
  return node("Slice", {x, integers({begin}), integers({end}), integers({1})});
}

OnnxValue OnnxGraph::concat(const std::vector<OnnxValue>& parts) {
  return node("Concat", parts, {{"axis", std::int64_t{1}}});
}

std::string OnnxGraph::bytes(const std::string& help, const std::map<std::string, std::string>& metadata) const {
  onnx::ModelProto model;
  model.set_ir_version(kIrVersion);
  model.set_producer_name(kProducer);
  model.set_doc_string(help);
  onnx::OperatorSetIdProto& opset = *model.add_opset_import();
  opset.set_domain("");
  opset.set_version(kOpset);
  for (const auto& [key, value] : metadata) {
    onnx::StringStringEntryProto& entry = *model.add_metadata_props();
    entry.set_key(key);
    entry.set_value(value);
  }
  *model.mutable_graph() = impl_->graph;
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream coded(&stream);
  coded.SetSerializationDeterministic(true);
  if (!model.SerializeToCodedStream(&coded)) throw Error("cannot be written as protobuf: 2 GiB or more", "ONNX model");
  coded.Trim();
  return bytes;
}

namespace {

OnnxValue one_number(OnnxGraph& graph, float number) { return graph.constant("number", {1}, {number}); }

}  // namespace

OnnxValue operator+(const OnnxValue& a, const OnnxValue& b) { return a.graph->node("Add", {a, b}); }
OnnxValue operator-(const OnnxValue& a, const OnnxValue& b) { return a.graph->node("Sub", {a, b}); }
OnnxValue operator*(const OnnxValue& a, const OnnxValue& b) { return a.graph->node("Mul", {a, b}); }
OnnxValue operator+(const OnnxValue& a, float b) { return a + one_number(*a.graph, b); }
OnnxValue operator*(float a, const OnnxValue& b) { return b * one_number(*b.graph, a); }
OnnxValue relu(const OnnxValue& x) { return x.graph->node("Relu", {x}); }
OnnxValue tanh(const OnnxValue& x) { return x.graph->node("Tanh", {x}); }
OnnxValue sigmoid(const OnnxValue& x) { return x.graph->node("Sigmoid", {x}); }
OnnxValue exp(const OnnxValue& x) { return x.graph->node("Exp", {x}); }
OnnxValue log(const OnnxValue& x) { return x.graph->node("Log", {x}); }
OnnxValue softmax(const OnnxValue& x) { return x.graph->node("Softmax", {x}, {{"axis", std::int64_t{1}}}); }

}  // namespace citylearn
