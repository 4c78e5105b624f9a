// SPDX-License-Identifier: Apache-2.0
// Built where ONNX Runtime is installed.
#include <onnx/defs/schema.h>
#include <onnx/onnx_pb.h>
#include <onnxruntime_cxx_api.h>

#include <algorithm>
#include <climits>
#include <iostream>
#include <set>

#include "core/util/error.h"
#include "encoder_service/onnx/onnx_backend.h"

namespace citylearn {
namespace {

// Names of what is put before and after the model's own nodes.
constexpr const char *kPicture = "citylearn:picture", *kNumbers = "citylearn:numbers";

const std::string& name_of(const onnx::NodeProto& node) { return node.name().empty() ? node.output(0) : node.name(); }

void append_cast(onnx::GraphProto& graph, const std::string& from, const std::string& to, int type) {
  onnx::NodeProto& node = *graph.add_node();
  node.set_op_type("Cast");
  node.add_input(from);
  node.add_output(to);
  onnx::AttributeProto& attribute = *node.add_attribute();
  attribute.set_name("to");
  attribute.set_type(onnx::AttributeProto::INT);
  attribute.set_i(type);
}

/// Removes the nodes that `tensor` does not depend on.
void keep_nodes_before(onnx::GraphProto& graph, const std::string& tensor) {
  for (const onnx::NodeProto& node : graph.node())
    for (const onnx::AttributeProto& attribute : node.attribute())
      if (attribute.has_g()) return;  // graphs within nodes read tensors unseen
  std::set<std::string> needed = {tensor};
  for (int i = graph.node_size() - 1; i >= 0; --i) {
    const auto &outputs = graph.node(i).output(), &inputs = graph.node(i).input();
    if (std::any_of(outputs.begin(), outputs.end(), [&](const auto& name) { return needed.contains(name); }))
      needed.insert(inputs.begin(), inputs.end());
    else
      graph.mutable_node()->DeleteSubrange(i, 1);
  }
}

/// Debian's ONNX Runtime shares ONNX's table of operators with it. Both fill it, and ONNX names each operator that
/// comes twice on std::cerr, a thousand lines.
Ort::Env& environment() {
  static Ort::Env made = [] {
    std::cerr.setstate(std::ios::failbit);
    Ort::Env fills(ORT_LOGGING_LEVEL_FATAL, "citylearn");
    onnx::OpSchemaRegistry::Schema("Relu");  // fills it again, when first asked
    std::cerr.clear();
    return fills;
  }();
  return made;
}

class OnnxruntimeBackend : public OnnxBackend {
 public:
  OnnxruntimeBackend(const OnnxModel& model, const OnnxFile& file, std::array<int, 2> size, const std::string& where)
      : where_(where), input_(file.inputs.at(0).name) {
    model_.ParseFromArray(model.bytes.data(), static_cast<int>(model.bytes.size()));  // load_onnx() has read it
    onnx::GraphProto& graph = *model_.mutable_graph();
    graph.clear_value_info();  // as exported, perhaps for another size
    for (onnx::ValueInfoProto& input : *graph.mutable_input()) {
      if (input.name() != input_) continue;
      auto& type = *input.mutable_type()->mutable_tensor_type();
      if (type.shape().dim_size() > 0)
        batch_ = static_cast<int>(std::clamp<std::int64_t>(type.shape().dim(0).dim_value(), 0, INT_MAX));
      // The picture comes as 32-bit floats, whatever the model calculates with.
      append_cast(graph, kPicture, input_, type.elem_type());
      for (int i = graph.node_size() - 1; i > 0; --i) graph.mutable_node()->SwapElements(i, i - 1);
      input.set_name(kPicture);
      type.set_elem_type(onnx::TensorProto::FLOAT);
      type.clear_shape();
      for (const int side : {batch_, 3, size[1], size[0]}) {
        auto& dimension = *type.mutable_shape()->add_dim();
        if (side > 0) dimension.set_dim_value(side);
      }
    }
  }

  std::vector<std::string> layers() const override {
    std::vector<std::string> all;
    for (const onnx::NodeProto& node : model_.graph().node())
      if (node.output_size() > 0 && node.output(0) != input_) all.push_back(name_of(node));
    return all;
  }

  bool pools(const std::string& layer) const override {
    const std::string& type = node_of(layer).op_type();
    return type.ends_with("Pool") || type == "ReduceMean";  // as PyTorch writes the mean over all positions
  }

  void select(const std::string& layer) override {
    onnx::GraphProto& graph = *model_.mutable_graph();
    const std::string tensor = node_of(layer).output(0);
    keep_nodes_before(graph, tensor);
    append_cast(graph, tensor, kNumbers, onnx::TensorProto::FLOAT);
    graph.clear_output();
    graph.add_output()->set_name(kNumbers);
    const std::string bytes = model_.SerializeAsString();
    model_.Clear();
    Ort::SessionOptions options;
    options.SetLogSeverityLevel(ORT_LOGGING_LEVEL_FATAL);
    options.SetIntraOpNumThreads(std::max(cv::getNumThreads(), 1));
    try {
      session_ = Ort::Session(environment(), bytes.data(), bytes.size(), options);
    } catch (const std::exception& exception) {
      throw Error(std::string("ONNX Runtime cannot import it: ") + exception.what(), where_,
                  "docs/how-to/use-an-onnx-encoder.md says how to export");
    }
  }

  int batch() const override { return batch_; }

  cv::Mat run(const cv::Mat& input) override {
    const std::vector<std::int64_t> sides(input.size.p, input.size.p + input.dims);
    Ort::Value value = Ort::Value::CreateTensor<float>(Ort::MemoryInfo::CreateCpu(OrtArenaAllocator, OrtMemTypeDefault),
                                                       const_cast<float*>(input.ptr<float>()), input.total(),
                                                       sides.data(), sides.size());
    output_ = std::move(session_.Run(Ort::RunOptions(), &kPicture, &value, 1, &kNumbers, 1)[0]);
    const std::vector<std::int64_t> shape = output_.GetTensorTypeAndShapeInfo().GetShape();
    return cv::Mat(std::vector<int>(shape.begin(), shape.end()), CV_32F, output_.GetTensorMutableData<float>());
  }

 private:
  const onnx::NodeProto& node_of(const std::string& layer) const {
    const auto& nodes = model_.graph().node();
    return *std::find_if(nodes.begin(), nodes.end(),
                         [&](const auto& node) { return node.output_size() > 0 && name_of(node) == layer; });
  }

  onnx::ModelProto model_;  // until a layer is selected
  std::string where_, input_;
  int batch_ = 0;
  Ort::Session session_{nullptr};
  Ort::Value output_{nullptr};
};

}  // namespace

std::string onnx_library() { return "ONNX Runtime " + std::string(OrtGetApiBase()->GetVersionString()); }

std::unique_ptr<OnnxBackend> make_onnx_backend(OnnxModel model, const OnnxFile& file, std::array<int, 2> size,
                                               const std::string& where) {
  return std::make_unique<OnnxruntimeBackend>(model, file, size, where);
}

}  // namespace citylearn
