// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "bench/bench.h"
#include "bench/figures.h"
#include "encoder_service/onnx/onnx_network.h"
#include "tests/support/data/real_data.h"

namespace {

using namespace citylearn;
using bench::median;
using bench::seconds;

constexpr int kPictures = 16;

/// Something like a street: large shapes with some grain, so that JPEG has its usual work.
cv::Mat picture(int width, int height, int seed) {
  cv::RNG random(static_cast<std::uint64_t>(seed));
  cv::Mat coarse(12, 16, CV_8UC3), grain(height, width, CV_8UC3), whole;
  random.fill(coarse, cv::RNG::UNIFORM, 0, 220);
  random.fill(grain, cv::RNG::UNIFORM, 0, 30);
  cv::resize(coarse, whole, grain.size(), 0, 0, cv::INTER_CUBIC);
  return whole + grain;
}

struct Contender {
  std::string name;
  std::function<void()> work;  // kPictures of them
  std::vector<double> times = {}, ratios = {};
};

struct Options {
  EncoderFiles files;
  std::map<std::string, double> values;  ///< of the network's parameters
  int rounds = 15;
};

void measure(const Options& options) {
  const std::string& model = options.files.model;
  if (!std::filesystem::exists(model)) {
    std::printf("skipped: no model '%s' (name one with --model)\n", model.c_str());
    return;
  }
  const auto& entry = EncoderRegistry::instance().find("encoder", "onnx");
  const auto encoder = entry.create(Parameters("onnx", entry.parameters, options.values), options.files);
  OnnxNetwork network(Parameters("onnx", network_parameters(), options.values), options.files);

  std::vector<cv::Mat> exact, large, inputs;
  std::vector<Bytes> jpegs;
  for (int i = 0; i < kPictures; ++i) {
    exact.push_back(picture(network.width(), network.height(), i));
    large.push_back(picture(640, 480, i));
    inputs.push_back(network.prepare(exact.back()).clone());
    std::vector<unsigned char> jpeg;
    cv::imencode(".jpg", large.back(), jpeg);
    const auto bytes = std::as_bytes(std::span(jpeg));
    jpegs.emplace_back(bytes.begin(), bytes.end());
  }
  const auto decoded = [&] {
    std::vector<cv::Mat> pictures;
    for (const Bytes& jpeg : jpegs) pictures.push_back(decode_picture(jpeg, "jpeg"));
    return pictures;
  };

  // OpenCV and nothing else: inputs prepared, outputs thrown away.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  cv::dnn::Net bare = cv::dnn::readNetFromONNX(model);
  bare.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  std::array<Contender, 6> contenders = {{
      {"OpenCV's forward pass alone",
       [&] {
         for (const cv::Mat& input : inputs) {
           bare.setInput(input);
           bare.forward(network.layer());
         }
       }},
      {"encoder, pictures of the input's size", [&] { encoder->encode(exact); }},
      {"encoder, pictures of 640 x 480", [&] { encoder->encode(large); }},
      {"encoder, 640 x 480, from JPEG", [&] { encoder->encode(decoded()); }},
      {"of that: decoding", [&] { decoded(); }},
      {"of that: resizing and normalising",
       [&] {
         for (const cv::Mat& one : large) network.prepare(one);
       }},
  }};
  for (int round = -1; round < options.rounds; ++round)  // the first one warms up
    for (Contender& contender : contenders) {
      const double time = seconds(contender.work);
      if (round < 0) continue;
      contender.times.push_back(time);
      contender.ratios.push_back(time / contenders[0].times.back());
    }
  std::printf("%s\n%d threads, %d rounds of %d pictures, medians\n", encoder->spec().name.c_str(), cv::getNumThreads(),
              options.rounds, kPictures);
  std::printf("%-40s %10s %10s %16s\n", "", "ms/image", "images/s", "time / bare");
  for (const Contender& contender : contenders) {
    const double each = median(contender.times) / kPictures;
    std::printf("%-40s %10.3f %10.1f %16.3f\n", contender.name.c_str(), 1e3 * each, 1 / each, median(contender.ratios));
    bench::record_figure(
        {.name = contender.name, .value = 1e3 * each, .unit = "ms/image", .better = bench::Better::kLower});
  }
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.files.model = testing::real_data(CITYLEARN_SOURCE_DIR, "nets/osnet_x0_25_msmt17.onnx");
  CLI::App app("What the encoder of ONNX networks costs beside OpenCV's forward pass", "bench_encoder");
  app.add_option("--model", options.files.model, "ONNX file")->capture_default_str();
  app.add_option("--layer", options.files.layer, "output layer; the last one by default");
  app.add_option("--preset", options.files.preset, "input size, mean, deviation and layer of a known network");
  app.add_option("--rounds", options.rounds, "rounds")->check(CLI::Range(1, 1000))->capture_default_str();
  for (const std::string side : {"width", "height"})
    app.add_option_function<int>(
        "--" + side, [&, side](int pixels) { options.values[side] = pixels; }, "of the input, in pixels");
  return bench::run(app, argc, argv, [&] { measure(options); });
}
