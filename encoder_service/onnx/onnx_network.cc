// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_network.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <map>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <regex>

#include "core/util/text.h"
#include "encoder_service/onnx/onnx_file.h"
#include "encoder_service/onnx/onnx_refusals.h"

namespace citylearn {
namespace {

constexpr int kMaxInputSide = 4096;  // pixels of a network's input

struct Preset {
  int width, height;  // 0: the model's own
  float scale;
  std::array<float, 3> mean, deviation;  // red, green, blue
  bool pooled;                           // the layer is the last pooling one
};

constexpr std::array<float, 3> kImagenetMean = {0.485f, 0.456f, 0.406f}, kImagenetDeviation = {0.229f, 0.224f, 0.225f};

/// Returns the presets, which all take RGB. It is a function because registrations use it before main().
const std::map<std::string, Preset>& presets() {
  static const std::map<std::string, Preset> all = {
      {"imagenet", {0, 0, 1, kImagenetMean, kImagenetDeviation, false}},
      // pytorch-NetVlad (Nanne) and Patch-NetVLAD: torchvision's mean and deviation, pictures of 640 x 480.
      {"netvlad", {640, 480, 1, kImagenetMean, kImagenetDeviation, false}},
      // The weights of Arandjelovic et al. (2016): the mean of VGG-16's training set (Simonyan & Zisserman), 0..255.
      {"netvlad-vgg", {640, 480, 255, {123.68f, 116.779f, 103.939f}, {1, 1, 1}, false}},
      {"resnet50", {224, 224, 1, kImagenetMean, kImagenetDeviation, true}},
      {"cosplace", {512, 512, 1, kImagenetMean, kImagenetDeviation, false}},
      // MobileNets of TensorFlow and Keras: -1..1.
      {"mobilenet", {224, 224, 1, {0.5f, 0.5f, 0.5f}, {0.5f, 0.5f, 0.5f}, false}},
      {"mixvpr", {320, 320, 1, kImagenetMean, kImagenetDeviation, false}},
  };
  return all;
}

/// OpenCV logs what it throws; our Error says it once.
class Silence {
 public:
  Silence() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~Silence() { cv::utils::logging::setLogLevel(before_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

/// Returns the innermost reason of an exception that OpenCV wrapped in others, in one line.
std::string reason_of(const std::exception& exception) {
  const auto* own = dynamic_cast<const cv::Exception*>(&exception);
  std::string text = own ? own->err : exception.what();
  static const std::regex kFrame(R"(OpenCV\([^)]*\)[^\n]*? error: \([^)]*\) )");
  std::smatch match;
  while (std::regex_search(text, match, kFrame)) text = match.suffix();
  text = one_line(text);
  // What it says goes before the function's name, or after that when it compared two numbers.
  static const std::regex kFunction("^[ >]*in function '[^']*'"), kRest("( in function '|, where >).*");
  text = std::regex_replace(std::regex_replace(text, kFunction, ""), kRest, "");
  while (!text.empty() && (text.front() == ' ' || text.front() == '>')) text.erase(0, 1);
  while (!text.empty() && text.back() == ' ') text.pop_back();
  if (text.size() > 160) text = text.substr(0, 160) + " ...";
  return text;
}

std::string import_fault(const std::exception& exception, std::int64_t opset) {
  static const std::regex kNode(R"(Node \[([^@\]]*)@?[^\]]*\]:\(([^)]*)\) parse error)");
  std::smatch match;
  const std::string text = exception.what();
  if (!std::regex_search(text, match, kNode))
    return "OpenCV cannot import it: " + reason_of(exception) + " (opset " + std::to_string(opset) + ")";
  const std::string what = one_line("layer '" + match[2].str() + "', operator " + match[1].str());
  if (text.find("Can't create layer") != std::string::npos) return "OpenCV has no such operator: " + what;
  return "OpenCV cannot import " + what + ": " + reason_of(exception);
}

std::string shortest(float number) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

std::string shortest(const std::array<float, 3>& numbers) {
  return shortest(numbers[0]) + "," + shortest(numbers[1]) + "," + shortest(numbers[2]);
}

}  // namespace

struct OnnxNetwork::Impl {
  cv::dnn::Net net;
  cv::Mat resized, input;
};

std::vector<ParameterSpec> network_parameters() {
  const auto channel = [](const std::string& what, const std::string& colour, double standard, double largest) {
    return ParameterSpec{what + "-" + colour,
                         what == "mean" ? "subtracted from " + colour + ", after scale; -1: the preset's"
                                        : "divides " + colour + " after that; 0: the preset's",
                         standard, standard, largest};
  };
  return {
      {"width", "pixels of the network's input; 0: the model's or the preset's", 0, 0, kMaxInputSide, true},
      {"height", "pixels of the network's input; 0: the model's or the preset's", 0, 0, kMaxInputSide, true},
      {"rgb", "1: channels are red, green, blue; 0: blue, green, red; -1: the preset's", -1, -1, 1, true},
      {"scale", "value of the brightest pixel, mostly 1 or 255; 0: the preset's", 0, 0, 65536},
      channel("mean", "red", -1, 65536),
      channel("mean", "green", -1, 65536),
      channel("mean", "blue", -1, 65536),
      channel("deviation", "red", 0, 65536),
      channel("deviation", "green", 0, 65536),
      channel("deviation", "blue", 0, 65536),
  };
}

std::string list_presets() { return joined(presets(), &std::pair<const std::string, Preset>::first); }

std::string fit_name(const std::string& name) {
  constexpr std::size_t kMaxNameLength = 200;
  if (name.size() <= kMaxNameLength) return name;
  const std::string hash = short_hash(std::as_bytes(std::span(name)));
  return name.substr(0, kMaxNameLength - hash.size() - 2) + " #" + hash;
}

OnnxNetwork::OnnxNetwork(const Parameters& parameters, const EncoderFiles& files)
    : impl_(std::make_unique<Impl>()), path_(files.model) {
  if (path_.empty()) throw Error("needs a network", "", "give an ONNX file with --model FILE");
  const std::string preset_name = files.preset.empty() ? "imagenet" : files.preset;
  const auto found = presets().find(preset_name);
  if (found == presets().end()) throw Error("unknown preset '" + preset_name + "'", "", "known: " + list_presets());
  const Preset& preset = found->second;

  const OnnxModel model = load_onnx(path_);
  const std::span<const std::byte> bytes = model.bytes;
  const OnnxFile file = read_onnx(bytes, path_);
  hash_ = model.hash;
  if (file.inputs.size() != 1)
    throw Error("has " + std::to_string(file.inputs.size()) + " inputs, a picture is one", path_);
  choose_size(file.inputs[0].shape, parameters.integer("width"), parameters.integer("height"), true);
  choose_size(file.inputs[0].shape, preset.width, preset.height, false);

  rgb_ = parameters["rgb"] != 0;
  scale_ = parameters["scale"] > 0 ? static_cast<float>(parameters["scale"]) : preset.scale;
  const std::array<std::string, 3> colours = {"red", "green", "blue"};
  for (int c = 0; c < 3; ++c) {
    const double mean = parameters["mean-" + colours[c]], deviation = parameters["deviation-" + colours[c]];
    mean_[c] = mean >= 0 ? static_cast<float>(mean) : preset.mean[c];
    deviation_[c] = deviation > 0 ? static_cast<float>(deviation) : preset.deviation[c];
    for (int value = 0; value < 256; ++value)
      table_[rgb_ ? c : 2 - c][value] =
          static_cast<float>((value / 255.0 * static_cast<double>(scale_) - static_cast<double>(mean_[c])) /
                             static_cast<double>(deviation_[c]));
  }

  const Silence silence;
  const std::vector<std::int64_t> input = {1, 3, height_, width_};
  refuse_misread_nodes(bytes, input, "", path_);
  try {
    impl_->net = cv::dnn::readNetFromONNX(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    impl_->net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    impl_->net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
  } catch (const std::exception& exception) {
    throw Error(import_fault(exception, file.opset), path_,
                "run it in Python for a file of features, or on Debian 13, where ONNX Runtime runs it; or export it as "
                "docs/how-to/use-an-onnx-encoder.md says");
  }
  choose_layer(files.layer, preset.pooled);
  refuse_misread_nodes(bytes, input, layer_, path_);
  const cv::Mat grey(height_, width_, CV_8UC3, cv::Scalar::all(128)), output = forward(grey).clone();
  if (cv::norm(output, forward(grey), cv::NORM_INF) != 0)
    throw Error("layer '" + layer_ + "' gives other numbers each time for the same picture", path_,
                "export it by model.eval()");
  shape_.assign(output.size.p, output.size.p + output.dims);
}

OnnxNetwork::~OnnxNetwork() = default;

void OnnxNetwork::choose_size(const std::vector<std::int64_t>& shape, int width, int height, bool firm) {
  if (!shape.empty() && (shape.size() != 4 || (shape[1] != 3 && shape[1] != -1)))
    throw Error("its input is not a picture of 3 channels [n,3,height,width]", path_);
  const auto choose = [&](const std::string& name, std::int64_t own, int wanted, int& side) {
    if (own > kMaxInputSide) throw Error("its input has a " + name + " of " + std::to_string(own), path_);
    if (firm && own > 0 && wanted > 0 && own != wanted)
      throw Error("its input has a " + name + " of " + std::to_string(own) + ", not " + std::to_string(wanted), path_,
                  "leave " + name + " away");
    if (side == 0) side = own > 0 ? static_cast<int>(own) : wanted;
    if (!firm && side == 0) throw Error("leaves the " + name + " of its input open", path_, "give " + name);
  };
  choose("height", shape.empty() ? -1 : shape[2], height, height_);
  choose("width", shape.empty() ? -1 : shape[3], width, width_);
}

void OnnxNetwork::choose_layer(const std::string& wanted, bool pooled) {
  const std::vector<std::string> names = impl_->net.getLayerNames();
  if (names.empty()) throw Error("has no layers", path_);
  const auto known = [&](const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  if (wanted.empty()) {
    layer_ = names.back();
    for (const std::string& name : names)
      if (pooled && impl_->net.getLayer(impl_->net.getLayerId(name))->type == "Pooling") layer_ = name;
    return;
  }
  // OpenCV puts its own prefix before the names of ONNX nodes.
  for (const std::string& name : {wanted, "onnx_node!" + wanted})
    if (known(name)) {
      layer_ = name;
      return;
    }
  std::vector<std::string> close;
  for (const std::string& name : names)
    if (lower(name).find(lower(wanted)) != std::string::npos) close.push_back(name);
  const std::vector<std::string>& shown = close.empty() ? names : close;
  const std::span last = std::span(shown).last(std::min<std::size_t>(shown.size(), 5));
  throw Error("has no layer '" + wanted + "'", path_, (close.empty() ? "its last are " : "it has ") + joined(last));
}

Eigen::MatrixXf cell_means(int side, int cells) {
  Eigen::MatrixXf means = Eigen::MatrixXf::Zero(cells, side);
  for (int cell = 0; cell < cells; ++cell) {
    const int begin = cell * side / cells, end = ((cell + 1) * side + cells - 1) / cells;
    means.block(cell, begin, 1, end - begin).setConstant(1.0f / static_cast<float>(end - begin));
  }
  return means;
}

std::vector<std::array<int, 2>> resizing_steps(std::array<int, 2> from, std::array<int, 2> to) {
  std::array<int, 2> at = to;
  for (int side = 0; side < 2; ++side)
    while (from[side] > 2.5 * at[side]) at[side] *= 2;
  // Halving both sides at once is quicker still.
  if (at[0] == 2 * to[0] && at[1] == to[1]) at[1] *= 2;
  if (at[1] == 2 * to[1] && at[0] == to[0]) at[0] *= 2;
  std::vector<std::array<int, 2>> steps = {at};
  while (at != to) {
    for (int side = 0; side < 2; ++side)
      if (at[side] > to[side]) at[side] /= 2;
    steps.push_back(at);
  }
  return steps;
}

namespace {

/// `picture` at another size into `resized`.
void fit(const cv::Mat& picture, cv::Size size, cv::Mat& resized) {
  const auto steps = resizing_steps({picture.cols, picture.rows}, {size.width, size.height});
  cv::resize(picture, resized, {steps[0][0], steps[0][1]}, 0, 0, cv::INTER_LINEAR);
  for (std::size_t step = 1; step < steps.size(); ++step) {
    cv::Mat half;
    cv::resize(resized, half, {steps[step][0], steps[step][1]}, 0, 0, cv::INTER_AREA);
    resized = half;
  }
}

}  // namespace

const cv::Mat& OnnxNetwork::prepare(const cv::Mat& picture) {
  if (picture.empty() || picture.type() != CV_8UC3)
    throw Error("a picture is not 8-bit with 3 channels", "encoder of " + path_);
  const cv::Mat* source = &picture;
  if (picture.cols != width_ || picture.rows != height_) {
    fit(picture, cv::Size(width_, height_), impl_->resized);
    source = &impl_->resized;
  }
  impl_->input.create(std::vector<int>{1, 3, height_, width_}, CV_32F);
  const std::size_t plane = static_cast<std::size_t>(width_) * height_;
  float* first = impl_->input.ptr<float>();
  // Input channel c is the picture's channel 2 - c (blue, green, red) when it goes red, green, blue.
  float* blue = first + (rgb_ ? 2 * plane : 0);
  float* green = first + plane;
  float* red = first + (rgb_ ? 0 : 2 * plane);
  const auto &blues = table_[rgb_ ? 2 : 0], &greens = table_[1], &reds = table_[rgb_ ? 0 : 2];
  for (int y = 0; y < height_; ++y) {
    const unsigned char* pixel = source->ptr(y);
    for (int x = 0; x < width_; ++x, pixel += 3) {
      *blue++ = blues[pixel[0]];
      *green++ = greens[pixel[1]];
      *red++ = reds[pixel[2]];
    }
  }
  return impl_->input;
}

cv::Mat OnnxNetwork::run(const cv::Mat& input) {
  const Silence silence;
  cv::Mat output;
  try {
    impl_->net.setInput(input);
    output = impl_->net.forward(layer_);
  } catch (const std::exception& exception) {
    throw Error("OpenCV cannot run it on a picture of " + std::to_string(width_) + " x " + std::to_string(height_) +
                    " up to layer '" + layer_ + "': " + reason_of(exception),
                path_, "is that the size it was made for? docs/how-to/use-an-onnx-encoder.md says how to export");
  }
  if (output.type() != CV_32F || output.dims < 2 || output.size[0] != 1 || output.total() == 0 ||
      !output.isContinuous())
    throw Error("layer '" + layer_ + "' does not give one row of 32-bit floats a picture", path_,
                "name another with --layer");
  return output;
}

cv::Mat OnnxNetwork::forward(const cv::Mat& picture) {
  cv::Mat output = run(prepare(picture));
  const float* numbers = output.ptr<float>();
  if (!std::all_of(numbers, numbers + output.total(), [](float number) { return std::isfinite(number); }))
    throw Error("layer '" + layer_ + "' gives numbers that are not finite", path_,
                "check scale, mean and deviation, or name another with --layer");
  return output;
}

std::string OnnxNetwork::description() const {
  return hash_ + " layer=" + layer_ + " " + std::to_string(width_) + "x" + std::to_string(height_) +
         (rgb_ ? " rgb" : " bgr") + " scale=" + shortest(scale_) + " mean=" + shortest(mean_) +
         " deviation=" + shortest(deviation_);
}

}  // namespace citylearn
