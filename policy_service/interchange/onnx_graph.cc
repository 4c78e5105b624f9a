// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/onnx_graph.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <onnx/onnx_pb.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <set>

#include "core/util/error.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "tensors are written as they lie in memory");

constexpr int kIrVersion = 6;  // of the format itself, as it came with opset 11
constexpr const char* kProducer = "citylearn";

void describe(onnx::ValueInfoProto& value, const std::string& name, const std::vector<std::int64_t>& sides,
              const std::string& help) {
  value.set_name(name);
  value.set_doc_string(help);
  auto& tensor = *value.mutable_type()->mutable_tensor_type();
  tensor.set_elem_type(onnx::TensorProto::FLOAT);
  tensor.mutable_shape()->add_dim()->set_dim_param("batch");
  for (const std::int64_t side : sides) tensor.mutable_shape()->add_dim()->set_dim_value(side);
}

/// Returns the nodes that `wanted` depends on, in the graph's order.
std::vector<const onnx::NodeProto*> nodes_before(const onnx::GraphProto& graph, const std::string& wanted) {
  std::set<std::string> needed = {wanted};
  std::vector<const onnx::NodeProto*> nodes;
  for (int i = graph.node_size() - 1; i >= 0; --i) {  // nodes are sorted: what a node reads comes before it
    const onnx::NodeProto& node = graph.node(i);
    if (std::none_of(node.output().begin(), node.output().end(),
                     [&](const std::string& name) { return needed.contains(name); }))
      continue;
    needed.insert(node.input().begin(), node.input().end());
    nodes.insert(nodes.begin(), &node);
  }
  return nodes;
}

/// Takes the padding of an AveragePool that counts it, and returns it as a Pad has it; empty: none. Throws Error when
/// it depends on the picture's size.
std::vector<std::int64_t> take_counted_padding(onnx::NodeProto& pool) {
  std::vector<std::int64_t> pads;
  onnx::AttributeProto *own = nullptr, *counts = nullptr;
  bool same = false, ceil = false;
  for (onnx::AttributeProto& one : *pool.mutable_attribute()) {
    if (one.name() == "pads") own = &one;
    if (one.name() == "count_include_pad" && one.i() != 0) counts = &one;
    same |= one.name() == "auto_pad" && one.s().starts_with("SAME");
    ceil |= one.name() == "ceil_mode" && one.i() != 0;
  }
  if (own) pads.assign(own->ints().begin(), own->ints().end());
  const bool none = std::all_of(pads.begin(), pads.end(), [](std::int64_t pad) { return pad == 0; });
  if (pool.op_type() != "AveragePool" || !counts || (none && !same)) return {};
  if (same || ceil)
    throw Error("counts padding, with auto_pad or ceil_mode", "operator AveragePool '" + pool.name() + "'",
                "put a Pad before it, and leave its own pads at 0");
  for (std::int64_t& pad : *own->mutable_ints()) pad = 0;
  counts->set_i(0);
  pads.insert(pads.begin() + static_cast<std::ptrdiff_t>(pads.size() / 2), {0, 0});  // of the batch and the channels
  pads.insert(pads.begin(), {0, 0});
  return pads;
}

}  // namespace

struct OnnxGraph::Impl {
  onnx::GraphProto graph;
  std::set<std::string> names;
  std::int64_t opset = kOpset, ir_version = kIrVersion;

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
  onnx::TensorProto& integers(const std::vector<std::int64_t>& numbers) {
    return tensor("integers", onnx::TensorProto::INT64, {static_cast<std::int64_t>(numbers.size())}, numbers.data(),
                  numbers.size() * sizeof(std::int64_t));
  }
  /// Appends nodes of another graph and the weights that they read. `renamed`: tensors of that graph that are here
  /// already, by the name they have there; the appended ones are added to it.
  void append(const onnx::GraphProto& other, const std::vector<const onnx::NodeProto*>& nodes,
              std::map<std::string, std::string>& renamed) {
    std::set<std::string> read;
    for (const onnx::NodeProto* node : nodes) read.insert(node->input().begin(), node->input().end());
    for (const onnx::TensorProto& weights : other.initializer()) {
      if (!read.contains(weights.name())) continue;
      onnx::TensorProto& added = *graph.add_initializer();
      added = weights;
      added.set_name(renamed[weights.name()] = fresh(weights.name()));
    }
    for (const onnx::NodeProto* node : nodes) {
      onnx::NodeProto& added = *graph.add_node();
      added = *node;
      added.set_name(fresh(node->name().empty() ? node->op_type() : node->name()));
      for (std::string& name : *added.mutable_input())
        if (const auto found = renamed.find(name); found != renamed.end())
          name = found->second;
        else if (!name.empty())  // an empty one is left out
          throw Error("reads '" + name + "', which nothing gives", "operator " + added.op_type());
      if (const auto pads = take_counted_padding(added); !pads.empty()) {  // readers differ in whether they count it
        if (opset < 11) throw Error("counts padding", "operator AveragePool", "export it with opset 11 or newer");
        onnx::NodeProto& pad = *graph.add_node();
        pad.set_op_type("Pad");
        pad.set_name(fresh("Pad"));
        pad.add_input(added.input(0));
        pad.add_input(integers(pads).name());
        pad.add_output(fresh(pad.name() + "_out"));
        added.set_input(0, pad.output(0));
        graph.mutable_node()->SwapElements(graph.node_size() - 2, graph.node_size() - 1);
      }
      for (std::string& name : *added.mutable_output())
        if (!name.empty()) name = renamed[name] = fresh(name);
    }
  }
};

OnnxGraph::OnnxGraph(const std::string& name) : impl_(std::make_unique<Impl>()) { impl_->graph.set_name(name); }
OnnxGraph::~OnnxGraph() = default;

OnnxValue OnnxGraph::input(const std::string& name, std::int64_t width, const std::string& help) {
  return input(name, std::vector{width}, help);
}

OnnxValue OnnxGraph::input(const std::string& name, const std::vector<std::int64_t>& sides, const std::string& help) {
  if (!impl_->names.insert(name).second) throw Error("is there already", "input " + name);
  describe(*impl_->graph.add_input(), name, sides, help);
  return {this, name};
}

void OnnxGraph::output(const std::string& name, const OnnxValue& value, std::int64_t width, const std::string& help) {
  if (!impl_->names.insert(name).second) throw Error("is there already", "output " + name);
  onnx::NodeProto& node = *impl_->graph.add_node();
  node.set_op_type("Identity");
  node.set_name(impl_->fresh("out_" + name));
  node.add_input(value.name);
  node.add_output(name);
  describe(*impl_->graph.add_output(), name, {width}, help);
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
  return {this, impl_->integers(numbers).name()};
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

OnnxValue OnnxGraph::append_network(const std::string& model, const OnnxValue& input, const std::string& node,
                                    const std::string& where) {
  onnx::ModelProto network;
  if (!network.ParseFromString(model)) throw Error("is not an ONNX model", where);
  const onnx::GraphProto& graph = network.graph();
  std::set<std::string> weights;
  for (const onnx::TensorProto& tensor : graph.initializer()) weights.insert(tensor.name());
  std::map<std::string, std::string> renamed;
  for (const auto& one : graph.input())  // old files list weights among the inputs
    if (!weights.contains(one.name())) renamed[one.name()] = input.name;
  if (renamed.size() != 1) throw Error("has " + std::to_string(renamed.size()) + " inputs, a picture is one", where);
  for (const auto& opset : network.opset_import()) {
    if (!opset.domain().empty() && opset.domain() != "ai.onnx")
      throw Error("has operators of '" + opset.domain() + "'", where, "export it with standard operators alone");
    if (opset.version() < kOldestOpset)
      throw Error("is of opset " + std::to_string(opset.version()), where,
                  "export it with opset " + std::to_string(kOldestOpset) + " or newer");
    impl_->opset = opset.version();
  }
  impl_->ir_version = std::max<std::int64_t>(kIrVersion, network.ir_version());
  for (const onnx::NodeProto& one : graph.node()) {
    if (one.output_size() == 0 || (one.name() != node && one.output(0) != node)) continue;
    impl_->append(graph, nodes_before(graph, one.output(0)), renamed);
    return {this, renamed.at(one.output(0))};
  }
  throw Error("has no node '" + node + "'", where);
}

void OnnxGraph::append(const OnnxGraph& other, const std::map<std::string, OnnxValue>& given) {
  const onnx::GraphProto& graph = other.impl_->graph;
  std::map<std::string, std::string> renamed;
  for (const auto& one : graph.input())
    if (const auto found = given.find(one.name()); found != given.end()) {
      renamed[one.name()] = found->second.name;
    } else {
      if (!impl_->names.insert(one.name()).second) throw Error("is there already", "input " + one.name());
      *impl_->graph.add_input() = one;
      renamed[one.name()] = one.name();
    }
  std::vector<const onnx::NodeProto*> nodes;
  for (const onnx::NodeProto& one : graph.node()) nodes.push_back(&one);
  impl_->append(graph, nodes, renamed);
  for (const auto& one : graph.output()) {
    *impl_->graph.add_output() = one;
    if (renamed.at(one.name()) != one.name()) throw Error("is there already", "output " + one.name());
  }
}

void OnnxGraph::close_batch() {
  for (auto* values : {impl_->graph.mutable_input(), impl_->graph.mutable_output()})
    for (onnx::ValueInfoProto& value : *values)
      value.mutable_type()->mutable_tensor_type()->mutable_shape()->mutable_dim(0)->set_dim_value(1);
}

bool OnnxGraph::has_input(const std::string& name) const {
  return std::any_of(impl_->graph.input().begin(), impl_->graph.input().end(),
                     [&](const auto& input) { return input.name() == name; });
}

std::string OnnxGraph::bytes(const std::string& help, const std::map<std::string, std::string>& metadata) const {
  onnx::ModelProto model;
  model.set_ir_version(impl_->ir_version);
  model.set_producer_name(kProducer);
  model.set_doc_string(help);
  onnx::OperatorSetIdProto& opset = *model.add_opset_import();
  opset.set_domain("");
  opset.set_version(impl_->opset);
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
