// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>

#include "encoder_service/onnx/onnx_network.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxOutputs = 65536;

/// Any network from a picture to a vector. A feature map [1,C,H,W] becomes its mean over H and W (C numbers) unless
/// pool=0; every other output is taken as it lies in memory. Nothing is normalised: Reduction does that.
class Onnx : public Encoder {
 public:
  Onnx(const Parameters& parameters, const EncoderFiles& files)
      : network_(parameters, files), pool_(parameters.flag("pool")) {
    const std::vector<int>& shape = network_.shape();
    std::size_t numbers = 1;
    for (const int side : shape) numbers *= side;
    positions_ = pool_ && shape.size() == 4 ? static_cast<Eigen::Index>(shape[2]) * shape[3] : 1;
    dimension_ = static_cast<Eigen::Index>(numbers) / positions_;
    if (numbers / positions_ > kMaxOutputs)
      throw Error("its layer gives " + std::to_string(dimension_) + " numbers, at most " + std::to_string(kMaxOutputs) +
                      " are allowed",
                  network_.model(), "name another with --layer, or leave pool at 1");
  }

  Spec spec() const override {
    return {fit_name("onnx-2 " + network_.description() + (pool_ ? "" : " pool=0")), static_cast<int>(dimension_), 4};
  }

  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    Eigen::MatrixXf descriptors(dimension_, pictures.size());
    for (std::size_t i = 0; i < pictures.size(); ++i) {
      const cv::Mat output = network_.forward(pictures[i]);
      descriptors.col(i) =
          Eigen::Map<const Eigen::MatrixXf>(output.ptr<float>(), positions_, dimension_).colwise().mean();
    }
    return descriptors;
  }

 private:
  OnnxNetwork network_;
  bool pool_;
  Eigen::Index positions_ = 1, dimension_ = 0;
};

std::vector<ParameterSpec> onnx_parameters() {
  std::vector<ParameterSpec> specs = network_parameters();
  specs.push_back({"pool", "1: a feature map becomes its mean over all positions; 0: all its numbers", 1, 0, 1, true});
  return specs;
}

const EncoderRegistry::Registration onnx_registration({
    "onnx",
    "a network (--model FILE.onnx, --layer, --preset) run by OpenCV, from a picture to a vector",
    onnx_parameters(),
    [](const Parameters& values, const EncoderFiles& files) { return std::make_unique<Onnx>(values, files); },
    {},
    {{"presets", list_presets()}},
});

}  // namespace
}  // namespace citylearn
