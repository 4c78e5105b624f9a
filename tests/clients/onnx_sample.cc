// SPDX-License-Identifier: Apache-2.0
// onnx_sample FOLDER: agents trained on the drawn city as FOLDER/ENCODER/agent.onnx, pictures.bin (bytes, a frame after
// the other, its red, green and blue planes) and episodes.json: what the services' agent does with them, step by step.
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/support/networks/picture_agent.h"
#include "tests/support/networks/tiny_onnx.h"

namespace {

using namespace citylearn;
using namespace citylearn::testing;

void write(const std::string& target, const PictureAgent& agent) {
  const Folder folder;
  std::filesystem::create_directories(target);
  write_file(target + "agent.onnx", agent.exported(folder));
  std::ofstream pictures(target + "pictures.bin", std::ios::binary);
  for (int frame = 0; frame < PictureAgent::kFrames; ++frame) {
    const cv::Mat picture = agent.season_picture(frame);
    for (const int channel : {2, 1, 0})
      for (int y = 0; y < picture.rows; ++y)
        for (int x = 0; x < picture.cols; ++x) pictures.put(static_cast<char>(picture.at<cv::Vec3b>(y, x)[channel]));
  }
  nlohmann::json steps = nlohmann::json::array();
  for (const ServiceStep& step : agent.long_steps(30))
    steps.push_back({{"frame", step.frame},
                     {"goal", step.goal},
                     {"previous", step.previous},
                     {"allowed", step.allowed},
                     {"first", step.first},
                     {"random", step.random},
                     {"action", step.action}});
  std::ofstream(target + "episodes.json") << nlohmann::json{{"frames", PictureAgent::kFrames}, {"steps", steps}};
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error("needs FOLDER");
  const std::string target = std::string(argv[1]) + "/";
  write(target + "patchnorm/", PictureAgent("place_filter", "patchnorm", {}, {}, Centring::kRunning, 16));
  // Padding that counts, which OpenCV tells by the producer and ONNX Runtime by the attribute.
  std::vector<float> kernel;
  tiny_convolution({1, 3, 48, 80}, 32, &kernel);
  const TinyOnnx model = TinyOnnx()
                             .input({1, 3, 48, 80})
                             .producer("pytorch")
                             .weights("kernel", {32, 3, 3, 3}, kernel)
                             .node("Conv", "conv", {"kernel"}, {{"kernel_shape", {3, 3}}, {"strides", {4, 4}}})
                             .node("Relu", "relu")
                             .node("AveragePool", "padded", {}, {{"kernel_shape", {7, 7}}, {"pads", {3, 3, 3, 3}}},
                                   {{"count_include_pad", 1}});
  const Folder folder;
  write(target + "onnx/",
        PictureAgent("place_filter", "onnx", {}, network(model.save(folder / "net.onnx")), Centring::kRunning, 8));
} catch (const std::exception& error) {
  std::cerr << "onnx_sample: " << error.what() << "\n";
  return 1;
}
