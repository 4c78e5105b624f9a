// SPDX-License-Identifier: Apache-2.0
// onnx_sample FOLDER: an agent trained on the drawn city as FOLDER/agent.onnx, pictures.bin (bytes, a frame after the
// other, its red, green and blue planes) and episodes.json: what the services' agent does with them, step by step.
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "tests/support/networks/picture_agent.h"

int main(int argc, char** argv) try {
  using namespace citylearn;
  using namespace citylearn::testing;
  if (argc != 2) throw Error("needs FOLDER");
  const std::string target = std::string(argv[1]) + "/";
  const PictureAgent agent("place_filter", "patchnorm", {}, {}, Centring::kRunning, 16);
  const Folder folder;
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
} catch (const std::exception& error) {
  std::cerr << "onnx_sample: " << error.what() << "\n";
  return 1;
}
