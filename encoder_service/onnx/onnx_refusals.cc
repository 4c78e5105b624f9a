// SPDX-License-Identifier: Apache-2.0
// What OpenCV 4.6 misreads without a word: docs/how-to/use-an-onnx-encoder.md says how it was found.
#include "encoder_service/onnx/onnx_refusals.h"

#include <onnx/onnx_pb.h>
#include <onnx/shape_inference/implementation.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>

#include "core/util/error.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

using Sides = std::vector<std::int64_t>;
using onnx::NodeProto;

constexpr std::size_t kMaxShapeBytes = 4096;  // bytes of a constant that may be a tensor's sides

bool one_of(const std::string& word, std::initializer_list<const char*> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

bool any_above(const Sides& sides, std::int64_t most) {
  return std::any_of(sides.begin(), sides.end(), [most](std::int64_t side) { return side > most; });
}

bool any_odd(const Sides& sides) {
  return std::any_of(sides.begin(), sides.end(), [](std::int64_t side) { return side % 2 != 0; });
}

std::int64_t product_of(const Sides& sides, std::size_t first = 0) {
  std::int64_t all = 1;
  for (std::size_t i = first; i < sides.size(); ++i) all *= sides[i];
  return all;
}

/// Returns whether `small`, stretched to `large`, has full sides first and then ones: C x 1 x 1.
bool leads_sides(Sides small, const Sides& large) {
  if (small.size() < large.size()) small.insert(small.begin(), large.size() - small.size(), 1);
  std::size_t i = 0;
  while (i < large.size() && small[i] == large[i]) ++i;
  return product_of(small, i) == 1;
}

const onnx::AttributeProto& attribute_of(const NodeProto& node, const std::string& name) {
  for (const onnx::AttributeProto& one : node.attribute())
    if (one.name() == name) return one;
  return onnx::AttributeProto::default_instance();
}
bool has_attribute(const NodeProto& node, const std::string& name) { return !attribute_of(node, name).name().empty(); }
std::int64_t number_of(const NodeProto& node, const std::string& name, std::int64_t standard = 0) {
  return has_attribute(node, name) ? attribute_of(node, name).i() : standard;
}
std::string text_of(const NodeProto& node, const std::string& name, const std::string& standard = "") {
  return has_attribute(node, name) ? attribute_of(node, name).s() : standard;
}
Sides list_of(const NodeProto& node, const std::string& name) {
  return {attribute_of(node, name).ints().begin(), attribute_of(node, name).ints().end()};
}

/// A graph, and what is known of its tensors before it runs.
class OnnxChecker {
 public:
  OnnxChecker(std::span<const std::byte> bytes, const Sides& picture) {
    if (!model_.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return;  // read_onnx() has said so
    onnx::GraphProto& graph = *model_.mutable_graph();
    for (const auto& set : model_.opset_import())
      if (set.domain().empty() || set.domain() == "ai.onnx") opset_ = set.version();
    for (onnx::TensorProto& weights : *graph.mutable_initializer()) {
      sides_[weights.name()] = {weights.dims().begin(), weights.dims().end()};
      if (weights.raw_data().size() > kMaxShapeBytes) weights.clear_raw_data();  // the copy need not have it
      constants_[weights.name()] = &weights;
    }
    for (onnx::ValueInfoProto& input : *graph.mutable_input())
      if (!constants_.contains(input.name())) {
        auto& shape = *input.mutable_type()->mutable_tensor_type()->mutable_shape();
        shape.clear_dim();
        for (const std::int64_t side : picture) shape.add_dim()->set_dim_value(side);
        sides_[input_ = input.name()] = picture;
        seen_.insert(input_);
      }
    for (const NodeProto& node : graph.node())
      for (const std::string& name : node.output()) {
        makers_[name] = &node;
        if (node.op_type() == "Constant") constants_[name] = &attribute_of(node, "value").t();
        if (node.op_type() != "Shape" && std::any_of(node.input().begin(), node.input().end(),
                                                     [&](const auto& input) { return seen_.contains(input); }))
          seen_.insert(name);
      }
    onnx::ModelProto copy = model_;
    copy.mutable_graph()->clear_value_info();  // as exported, perhaps for another size
    for (auto& one : *copy.mutable_graph()->mutable_output()) one.mutable_type()->mutable_tensor_type()->clear_shape();
    try {
      onnx::shape_inference::InferShapes(copy, onnx::OpSchemaRegistry::Instance(), {false, 0, true});
    } catch (const std::exception&) {  // what it cannot tell stays unknown
    }
    for (const auto* values : {&copy.graph().value_info(), &copy.graph().output()})
      for (const onnx::ValueInfoProto& value : *values) {
        Sides sides;
        for (const auto& side : value.type().tensor_type().shape().dim()) sides.push_back(side.dim_value());
        if (product_of(sides) > 0) sides_[value.name()] = sides;
      }
  }

  void refuse(const std::string& layer, const std::string& where) const {
    const auto& nodes = model_.graph().node();
    const std::string last = layer.substr(layer.find('!') + 1);
    std::set<std::string> needed = {last};
    const auto counts = [&](const NodeProto& node) {
      return node.name() == last || std::any_of(node.output().begin(), node.output().end(),
                                                [&](const auto& name) { return needed.contains(name); });
    };
    const bool all = std::none_of(nodes.begin(), nodes.end(), counts);  // OpenCV has made one node of several
    for (auto node = nodes.rbegin(); node != nodes.rend(); ++node) {
      const bool wanted = !layer.empty() && (all || counts(*node));
      if (wanted) needed.insert(node->input().begin(), node->input().end());
      needed.erase("");  // an input left out
      const Misread found = crashes(*node) ? Misread{"its negative axis ends the process", "count it from the front"}
                            : wanted       ? misread(*node)
                                           : Misread();
      if (found.first)
        throw Error("OpenCV reads operator " + node->op_type() + ", node '" +
                        one_line(node->name().empty() ? node->output(0) : node->name()) +
                        "', otherwise than ONNX defines: " + found.first,
                    where, std::string(found.second) + "; or run it in Python: docs/how-to/use-a-python-encoder.md");
    }
  }

 private:
  using Misread = std::pair<const char*, const char*>;  // what is, and what to do; null: nothing

  Sides sides(const std::string& name) const {
    const auto found = sides_.find(name);
    return found == sides_.end() ? Sides() : found->second;
  }
  bool constant(const std::string& name) const { return !name.empty() && !seen_.contains(name); }
  std::string maker(const std::string& name) const {
    const auto found = makers_.find(name);
    return found == makers_.end() ? "" : found->second->op_type();
  }

  static bool crashes(const NodeProto& node) {
    const Sides axes = list_of(node, "axes");
    return (node.op_type() == "Squeeze" && std::any_of(axes.begin(), axes.end(), [](auto axis) { return axis < 0; })) ||
           (node.op_type() == "Gather" && number_of(node, "axis") < 0);
  }

  /// Returns the padding that auto_pad SAME_* adds along each side.
  Sides same_padding(const NodeProto& node) const {
    const Sides from = sides(node.input(0)), kernel = list_of(node, "kernel_shape"), strides = list_of(node, "strides"),
                dilations = list_of(node, "dilations");
    Sides all;
    for (std::size_t i = 0; i < kernel.size() && i + 2 < from.size(); ++i) {
      const std::int64_t stride = i < strides.size() ? std::max<std::int64_t>(strides[i], 1) : 1;
      const std::int64_t reach = (kernel[i] - 1) * (i < dilations.size() ? dilations[i] : 1) + 1;
      all.push_back(std::max<std::int64_t>((from[i + 2] - 1) / stride * stride + reach - from[i + 2], 0));
    }
    return all;
  }

  /// Returns whether OpenCV would pad wrongly: it takes SAME_LOWER for SAME_UPPER, and leaves dilations out of both.
  bool pads_wrongly(const NodeProto& node) const {
    const std::string mode = text_of(node, "auto_pad");
    if (mode == "VALID" && number_of(node, "ceil_mode") != 0) return any_above(list_of(node, "strides"), 1);
    if (!mode.starts_with("SAME")) return false;
    const Sides total = same_padding(node);
    return node.op_type() == "ConvTranspose" || (mode == "SAME_LOWER" && any_odd(total)) ||
           (any_above(list_of(node, "dilations"), 1) && any_above(total, 0));
  }
  bool counts_wrongly(const NodeProto& node) const {
    const bool same = text_of(node, "auto_pad").starts_with("SAME"), counts = number_of(node, "count_include_pad") != 0;
    const Sides pads = same ? same_padding(node) : list_of(node, "pads");
    return any_above(pads, 0) && (counts != (model_.producer_name() == "pytorch") || (counts && same && any_odd(pads)));
  }

  /// Constants, and addends, are stretched from their first sides on; quotients and comparisons are turned round.
  bool stretches_wrongly(const NodeProto& node) const {
    if (node.input_size() != 2 || (constant(node.input(0)) && constant(node.input(1)))) return false;
    const Sides operands[] = {sides(node.input(0)), sides(node.input(1))};
    const bool first = constant(node.input(0)), sum = one_of(node.op_type(), {"Add", "Sub", "Sum"});
    if (one_of(node.op_type(), {"Less", "Greater"})) return first;
    if (node.op_type() == "Div" && !operands[0].empty() &&
        (first ? product_of(operands[0]) > 1 : product_of(operands[0]) < product_of(operands[1])))
      return true;
    for (const int i : {0, 1}) {
      const Sides &own = operands[i], &other = operands[1 - i];
      const bool fixed = constant(node.input(i));
      if (product_of(own) > 1 && own.size() <= other.size() && product_of(own) <= product_of(other) &&
          !leads_sides(own, other) && (sum ? !fixed || own.size() + 2 > other.size() || own[0] == 1 : fixed))
        return true;
    }
    return false;
  }

  /// Before opset 13 all sides from the axis on are one; 4.6 takes the axis alone, and 1 where there is none.
  bool softmax_wrongly(const NodeProto& node) const {
    const Sides from = sides(node.input(0));
    if (opset_ >= 13 || from.empty()) return !has_attribute(node, "axis") && !from.empty() && from.size() != 2;
    const std::int64_t axis = number_of(node, "axis", 1), rank = static_cast<std::int64_t>(from.size());
    return product_of(from, static_cast<std::size_t>((axis + rank) % rank) + 1) != 1;
  }

  /// Returns whether OpenCV would resize wrongly: it ignores how places are rounded and scales by the sides' ratio.
  bool resizes_wrongly(const NodeProto& node) const {
    const int place = opset_ < 11 ? 1 : 2;
    const auto scales = constants_.find(place < node.input_size() ? node.input(place) : "");
    const auto own = attribute_of(node, "scales").floats();  // of Upsample before opset 9
    std::vector<float> factors(own.begin(), own.end());
    if (scales != constants_.end()) {
      const auto& numbers = scales->second->float_data();
      const std::string& raw = scales->second->raw_data();
      factors.assign(numbers.begin(), numbers.end());
      for (std::size_t at = 0; at + sizeof(float) <= raw.size(); at += sizeof(float))
        std::memcpy(&factors.emplace_back(), raw.data() + at, sizeof(float));
    }
    const std::string places = text_of(node, "coordinate_transformation_mode", "half_pixel"),
                      rounding = text_of(node, "nearest_mode", "round_prefer_floor");
    const bool nearest = text_of(node, "mode", "nearest") == "nearest", floor = rounding == "floor";
    const bool round = rounding.starts_with("round_prefer"), down = rounding == "round_prefer_floor";
    const Sides from = sides(node.input(0)), to = sides(node.output(0));
    for (std::size_t i = 0; i < to.size() && i < from.size(); ++i) {
      const std::int64_t side = from[i], now = to[i];
      if (i < factors.size() && static_cast<double>(factors[i]) * static_cast<double>(side) != static_cast<double>(now))
        return true;
      if (opset_ < 11 || now == side) continue;
      if (!nearest                    ? places == "pytorch_half_pixel" && now == 1
          : places == "asymmetric"    ? !floor && side % now != 0 && !(down && now == 2 * side)
          : places == "align_corners" ? !round || now != 2 * side
                                      : !places.ends_with("half_pixel") || !round || (down ? 2 : 1) * now % side != 0)
        return true;
    }
    return false;
  }

  bool casts_wrongly(const NodeProto& node) const {
    const auto to = static_cast<onnx::TensorProto::DataType>(number_of(node, "to"));
    if (one_of(onnx::TensorProto::DataType_Name(to), {"FLOAT", "FLOAT16", "DOUBLE", "BFLOAT16"})) return false;
    const std::string from = maker(node.input(0));
    const auto fixed = constants_.find(node.input(0));
    if (fixed != constants_.end()) return fixed->second->data_type() == onnx::TensorProto::FLOAT;
    return !constant(node.input(0)) && !one_of(from, {"Equal", "Less", "Greater", "ArgMax", "ArgMin"}) &&
           (to == onnx::TensorProto::BOOL || !one_of(from, {"Floor", "Ceil", "Round"}));
  }

  /// x / ReduceL2(x), also through Clip and Expand, becomes a layer of its own that scales over channels.
  bool normalises_wrongly(const NodeProto& node) const {
    float least = 0;
    for (auto found = makers_.find(node.input(1)); found != makers_.end();
         found = makers_.find(found->second->input(0))) {
      const NodeProto& one = *found->second;
      if (one.op_type() == "ReduceL2") {
        const Sides axes = list_of(one, "axes");
        const auto rank = static_cast<std::int64_t>(sides(one.input(0)).size());
        const bool channels = axes.size() == 1 && (axes[0] < 0 ? axes[0] + rank : axes[0]) == 1;
        return one.input(0) == node.input(0) && (!channels || least > 1e-6f);
      }
      if (one.op_type() == "Clip") least = attribute_of(one, "min").f();
      if (one.op_type() != "Clip" && (one.op_type() != "Expand" || maker(one.input(1)) != "Shape")) return false;
    }
    return false;
  }

  Misread misread(const NodeProto& node) const {
    const char* const other = "write it with other operators, or cut the network before it with --layer";
    const std::string& type = node.op_type();
    const auto is = [&](std::initializer_list<const char*> words) { return one_of(type, words); };
    const auto any_input = [&](auto matches) { return std::any_of(node.input().begin(), node.input().end(), matches); };
    const auto scales = [&](const char* name) {
      return has_attribute(node, name) && attribute_of(node, name).f() != 1;
    };
    if (is({"AveragePool", "MaxPool", "Conv", "ConvTranspose"}) && pads_wrongly(node))
      return {"its auto_pad is read as another one", "export it with explicit pads"};
    if (is({"AveragePool", "MaxPool", "ConvTranspose"}) &&
        (any_above(list_of(node, "dilations"), 1) || has_attribute(node, "output_shape")))
      return {"its dilations or output_shape are not read", other};
    if (is({"AveragePool"}) && counts_wrongly(node))
      return {"whether padding counts is not read from count_include_pad, but from the file's producer",
              "put a Pad before it, and leave its own pads at 0"};
    if (is({"Softmax", "LogSoftmax"}) && softmax_wrongly(node))
      return {"its axis, or the default, means other sides", "export it with opset 13 or newer, and give the axis"};
    if (is({"Gemm"}) && (scales("alpha") || scales("beta")))
      return {"its alpha and beta are not read", "multiply its weights by them"};
    if (is({"Div"}) && normalises_wrongly(node)) return {"lengths are those of channels, without a lower limit", other};
    if (is({"Add", "Sub", "Sum", "Mul", "Div", "Less", "Greater"}) && stretches_wrongly(node))
      return {"its operands are exchanged, or one is stretched along other sides",
              "put constants second and give them the shape [1,C,1,1] or all sides, or cut the network before it with "
              "--layer"};
    if (is({"PRelu"}) && !leads_sides(sides(node.input(1)), {1, product_of(sides(node.input(1))), 1, 1}))
      return {"its slope is read per channel", "give it the shape [C,1,1]"};
    if (is({"Resize", "Upsample"}) && resizes_wrongly(node))
      return {"how places are rounded is not read, and scales that do not lead to whole sides are others",
              "export it with whole scales, coordinate_transformation_mode asymmetric and nearest_mode floor"};
    if (is({"Cast"}) && casts_wrongly(node))
      return {"casts to whole numbers are left out", "put a Floor before it, or leave it out"};
    if (is({"Concat"}) && number_of(node, "axis") == 1 && any_input([&](const auto& name) { return name == input_; }) &&
        any_input([&](const auto& name) { return constant(name); }))
      return {"a constant beside the picture itself is lost", "put an operator between the picture and it"};
    if (is({"BatchNormalization"}) && (number_of(node, "training_mode") != 0 || number_of(node, "spatial", 1) == 0))
      return {"its training_mode or spatial is not read", "export it by model.eval()"};
    if (is({"Split"}) && opset_ >= 13 && number_of(node, "axis") < 0)
      return {"its negative axis is misread", "count it from the front"};
    if (is({"LSTM"}) && (has_attribute(node, "clip") || number_of(node, "input_forget") != 0 || node.input_size() > 7 ||
                         number_of(node, "layout") != 0 || text_of(node, "direction") == "reverse"))
      return {"clip, input_forget, layout, peepholes and the direction reverse are not read", other};
    if (is({"CumSum", "Not", "QuantizeLinear"})) return {"its numbers are unset, or those before it", other};
    return {};
  }

  onnx::ModelProto model_;
  std::int64_t opset_ = 0;
  std::string input_;
  std::map<std::string, Sides> sides_;  // of tensors; missing: unknown
  std::set<std::string> seen_;          // tensors whose numbers depend on the picture's
  std::map<std::string, const NodeProto*> makers_;
  std::map<std::string, const onnx::TensorProto*> constants_;
};

}  // namespace

void refuse_misread_nodes(std::span<const std::byte> model, const std::vector<std::int64_t>& input,
                          const std::string& layer, const std::string& where) {
  OnnxChecker(model, input).refuse(layer, where);
}

}  // namespace citylearn
