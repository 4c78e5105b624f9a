// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>

#include "encoder_service/onnx/onnx_backend.h"
#include "encoder_service/onnx/onnx_network.h"

namespace citylearn {
namespace {

constexpr Eigen::Index kMaxOutputs = 65536;

/// Any network from a picture to a vector. A feature map [1,C,H,W] becomes its mean over H and W (C numbers), or with
/// pool=N its means over N x N cells (C N N numbers), unless pool=0; every other output is taken as it lies in memory.
/// Nothing is normalised: Reduction does that.
class Onnx : public Encoder {
 public:
  Onnx(const Parameters& parameters, const EncoderFiles& files)
      : network_(parameters, files), pool_(parameters.integer("pool")) {
    const std::vector<int>& shape = network_.shape();
    const bool pooled = pool_ > 0 && shape.size() == 4;
    for (const int side : shape) dimension_ *= side;
    if (pooled) dimension_ = static_cast<Eigen::Index>(shape[1]) * pool_ * pool_;
    if (pooled) rows_ = cell_means(shape[2], pool_), columns_ = cell_means(shape[3], pool_);
    if (dimension_ > kMaxOutputs)
      throw Error("its layer gives " + std::to_string(dimension_) + " numbers, at most " + std::to_string(kMaxOutputs) +
                      " are allowed",
                  network_.model(), "name another with --layer, or average a feature map by pool=1 or a grid, pool=4");
  }

  Spec spec() const override {
    return {fit_name("onnx-2 " + network_.description() + (pool_ == 1 ? "" : " pool=" + std::to_string(pool_))),
            static_cast<int>(dimension_), network_.pictures_a_call()};
  }

  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    Eigen::MatrixXf descriptors(dimension_, pictures.size());
    const Eigen::Index height = rows_.cols(), width = columns_.cols(), cells = rows_.rows() * columns_.rows();
    network_.forward(pictures, [&](std::size_t i, std::span<const float> numbers) {
      if (cells <= 1)
        descriptors.col(i) =
            Eigen::Map<const Eigen::MatrixXf>(numbers.data(), std::max<Eigen::Index>(height * width, 1), dimension_)
                .colwise()
                .mean();
      for (Eigen::Index c = 0; cells > 1 && c * cells < dimension_; ++c)
        descriptors.col(i).segment(c * cells, cells) =
            (columns_ * Eigen::Map<const Eigen::MatrixXf>(numbers.data() + c * height * width, width, height) *
             rows_.transpose())
                .reshaped();
    });
    return descriptors;
  }

 private:
  OnnxNetwork network_;
  int pool_;
  Eigen::MatrixXf rows_, columns_;  // of a feature map: the means of its cells; empty: all numbers
  Eigen::Index dimension_ = 1;
};

std::vector<ParameterSpec> onnx_parameters() {
  std::vector<ParameterSpec> specs = network_parameters();
  specs.push_back({"pool", "N: a feature map becomes its means over N x N cells; 0: all its numbers", 1, 0, 64, true});
  return specs;
}

const EncoderRegistry::Registration onnx_registration({
    "onnx",
    "a network (--model, --layer, --preset) run by " + onnx_library() + ", from a picture to a vector",
    onnx_parameters(),
    [](const Parameters& values, const EncoderFiles& files) { return std::make_unique<Onnx>(values, files); },
    {},
    {{"presets", list_presets()}},
});

}  // namespace
}  // namespace citylearn
