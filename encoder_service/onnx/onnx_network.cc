// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/onnx/onnx_network.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "core/util/text.h"
#include "encoder_service/onnx/onnx_backend.h"

namespace citylearn {
namespace {

constexpr int kMaxInputSide = 4096;                     // pixels of a network's input
constexpr int kMaxModelBatch = 64;                      // pictures that a model may want at once
constexpr int kMaxBatch = 8;                            // of a model that takes any number
constexpr int kMaxBatchPixels = kMaxBatch * 320 * 320;  // large pictures gain nothing together, and need memory

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

std::string shortest(float number) {
  std::array<char, 32> text{};
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

std::string shortest(const std::array<float, 3>& numbers) {
  return shortest(numbers[0]) + "," + shortest(numbers[1]) + "," + shortest(numbers[2]);
}

}  // namespace

struct OnnxNetwork::Impl {
  std::unique_ptr<OnnxBackend> backend;
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

  OnnxModel model = load_onnx(path_);
  const OnnxFile file = read_onnx(model.bytes, path_);
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
    // The network may hide it: OpenCV's ReLU makes 0 of what is not a number.
    for (const float number : table_[rgb_ ? c : 2 - c])
      if (!std::isfinite(number))
        throw Error("scale, mean and deviation of " + colours[c] + " give numbers that are not finite", path_);
  }

  impl_->backend = make_onnx_backend(std::move(model), file, {width_, height_}, path_);
  if (impl_->backend->batch() > kMaxModelBatch)
    throw Error("takes " + std::to_string(impl_->backend->batch()) + " pictures at once, at most " +
                    std::to_string(kMaxModelBatch) + " are allowed",
                path_, "export it for one");
  choose_layer(files.layer, preset.pooled);
  impl_->backend->select(layer_);
  const cv::Mat grey(height_, width_, CV_8UC3, cv::Scalar::all(128)),
      dark(height_, width_, CV_8UC3, cv::Scalar::all(9));
  const cv::Mat output = run(prepare(std::span(&grey, 1)));
  shape_.assign(output.size.p, output.size.p + output.dims);
  shape_[0] = 1;
  numbers_ = output.total() / output.size[0];
  const auto numbers_of = [&](const std::vector<cv::Mat>& pictures) {
    std::vector<Eigen::VectorXf> all;
    forward(pictures, [&](std::size_t, std::span<const float> numbers) {
      all.push_back(Eigen::Map<const Eigen::VectorXf>(numbers.data(), numbers.size()));
    });
    return all;
  };
  const Eigen::VectorXf alone = Eigen::Map<const Eigen::VectorXf>(output.ptr<float>(), numbers_);
  if (alone != numbers_of({grey})[0])
    throw Error("layer '" + layer_ + "' gives other numbers each time for the same picture", path_,
                "export it by model.eval()");
  batch_ = impl_->backend->batch();
  if (batch_ > 0) return;
  batch_ = std::clamp(kMaxBatchPixels / (width_ * height_), 1, kMaxBatch);
  try {  // a model may say that its batch is open and mean 1
    if (batch_ > 1 && !numbers_of({grey, dark})[0].isApprox(alone, 1e-3f)) batch_ = 1;
  } catch (const Error&) {
    batch_ = 1;
  }
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
  const std::vector<std::string> names = impl_->backend->layers();
  if (names.empty()) throw Error("has no layers", path_);
  const auto known = [&](const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  if (wanted.empty()) {
    layer_ = names.back();
    for (const std::string& name : names)
      if (pooled && impl_->backend->pools(name)) layer_ = name;
    return;
  }
  // OpenCV puts its own prefix before the names of ONNX nodes.
  const std::string prefix = "onnx_node!";
  for (const std::string& name :
       {wanted, prefix + wanted, wanted.substr(wanted.starts_with(prefix) ? prefix.size() : 0)})
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

namespace {

/// Returns the sizes (width, height) that a picture is resized to one after the other, the first bilinear and the
/// others by means over areas, of which the last is the network's. Area means over fractions of pixels cost a tenth of
/// a small network's time, so each side first goes to the wanted length times a power of two that leaves at most 2.5
/// pixels to each of its own, and is then halved, which is exact and quick.
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

const cv::Mat& OnnxNetwork::prepare(std::span<const cv::Mat> pictures) {
  const int fixed = impl_->backend->batch(), count = fixed > 0 ? fixed : static_cast<int>(pictures.size());
  impl_->input.create(std::vector<int>{count, 3, height_, width_}, CV_32F);
  const std::size_t plane = static_cast<std::size_t>(width_) * height_;
  float* first = impl_->input.ptr<float>();
  for (int i = 0; i < count; ++i, first += 3 * plane) {
    const cv::Mat* source = &pictures[std::min<std::size_t>(i, pictures.size() - 1)];
    if (source->empty() || source->type() != CV_8UC3)
      throw Error("a picture is not 8-bit with 3 channels", "encoder of " + path_);
    if (source->cols != width_ || source->rows != height_) {
      fit(*source, cv::Size(width_, height_), impl_->resized);
      source = &impl_->resized;
    }
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
  }
  return impl_->input;
}

cv::Mat OnnxNetwork::run(const cv::Mat& input) {
  cv::Mat output;
  try {
    output = impl_->backend->run(input);
  } catch (const std::exception& exception) {
    throw Error(onnx_library() + " cannot run it on a picture of " + std::to_string(width_) + " x " +
                    std::to_string(height_) + " up to layer '" + layer_ + "': " + exception.what(),
                path_,
                "is that the size it was made for? docs/how-to/use-an-onnx-encoder.md says how to export, and "
                "docs/how-to/use-a-python-encoder.md how to run it in Python");
  }
  if (output.type() != CV_32F || output.dims < 2 || output.size[0] != input.size[0] || output.total() == 0 ||
      (numbers_ > 0 && output.total() != numbers_ * output.size[0]) || !output.isContinuous())
    throw Error("layer '" + layer_ + "' does not give one row of 32-bit floats a picture, of one length", path_,
                "name another with --layer");
  return output;
}

void OnnxNetwork::forward(std::span<const cv::Mat> pictures,
                          const std::function<void(std::size_t, std::span<const float>)>& take) {
  const auto step = static_cast<std::size_t>(batch_);
  for (std::size_t first = 0; first < pictures.size(); first += step) {
    const std::size_t count = std::min(step, pictures.size() - first);
    const cv::Mat output = run(prepare(pictures.subspan(first, count)));
    const std::span numbers(output.ptr<float>(), count * numbers_);
    if (!std::all_of(numbers.begin(), numbers.end(), [](float number) { return std::isfinite(number); }))
      throw Error("layer '" + layer_ + "' gives numbers that are not finite", path_,
                  "check scale, mean and deviation, or name another with --layer");
    for (std::size_t i = 0; i < count; ++i) take(first + i, numbers.subspan(i * numbers_, numbers_));
  }
}

std::string OnnxNetwork::description() const {
  return hash_ + " layer=" + layer_ + " " + std::to_string(width_) + "x" + std::to_string(height_) +
         (rgb_ ? " rgb" : " bgr") + " scale=" + shortest(scale_) + " mean=" + shortest(mean_) +
         " deviation=" + shortest(deviation_) + (onnx_library() == "OpenCV 4.6.0" ? "" : " by " + onnx_library());
}

}  // namespace citylearn
