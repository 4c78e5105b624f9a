// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "bench/cases/cases.h"
#include "encoder_service/onnx/onnx_network.h"
#include "env_service/drawn_city/drawn_images.h"
#include "tests/support/data/real_data.h"

namespace citylearn::bench {
namespace {

constexpr int kTraining = 64;  // pictures that encoders learn from

struct Kind {
  std::string name;
  int width, height;
  const char* format;  // of the files; nullptr: PNG, as they are drawn
};

const Kind kJpeg{"JPEG 640 x 480", 640, 480, ".jpg"};

std::vector<cv::Mat> decoded(std::span<const Bytes> files) {
  std::vector<cv::Mat> pictures;
  for (const Bytes& file : files) pictures.push_back(decode_picture(file, "drawn picture"));
  return pictures;
}

/// Draws frames of a drive, a metre apart.
std::vector<Bytes> drawn_files(const Kind& kind, int count) {
  DrawnOptions options;
  options.width = kind.width;
  options.height = kind.height;
  DrawnDrive drive(options, "summer");
  std::vector<Bytes> files(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    Bytes& file = files[static_cast<std::size_t>(i)];
    drive.draw(static_cast<float>(i), file);
    if (!kind.format) continue;
    std::vector<unsigned char> other;
    cv::imencode(kind.format, decode_picture(file, "drawn picture"), other);
    const auto bytes = std::as_bytes(std::span(other));
    file.assign(bytes.begin(), bytes.end());
  }
  return files;
}

/// Times by turns what is done with so many pictures, and prints a line for each. Ratios are to the first one.
void compare(const std::string& title, std::vector<Contender>& contenders, int rounds, std::size_t pictures) {
  take_turns(contenders, rounds);
  std::printf("%s, %d thread(s), %d rounds of %zu pictures, medians\n", title.c_str(), cv::getNumThreads(), rounds,
              pictures);
  std::printf("  %-40s %10s %12s %10s\n", "", "ms/picture", "pictures/s", "ratio");
  for (const Contender& one : contenders) {
    const double each = median(one.seconds) / static_cast<double>(pictures);
    std::printf("  %-40s %10.3f %12.1f %10.3f\n", one.name.c_str(), 1e3 * each, 1 / each, median(one.ratios));
  }
}

struct EncoderCase {
  EncoderFiles files;
  std::map<std::string, double> values;  ///< of the network's parameters
  int rounds = 15;
};

void measure(const EncoderCase& options) {
  constexpr int kPictures = 16;
  const std::string& model = options.files.model;
  if (!std::filesystem::exists(model)) {
    std::printf("skipped: no model '%s' (name one with --model)\n", model.c_str());
    return;
  }
  const auto& entry = EncoderRegistry::instance().find("encoder", "onnx");
  const auto encoder = entry.create(Parameters("onnx", entry.parameters, options.values), options.files);
  OnnxNetwork network(Parameters("onnx", network_parameters(), options.values), options.files);
  const std::vector<Bytes> files = drawn_files(kJpeg, kPictures);
  const std::vector<cv::Mat> large = decoded(files);
  std::vector<cv::Mat> exact(large.size()), inputs;
  for (std::size_t i = 0; i < large.size(); ++i) cv::resize(large[i], exact[i], {network.width(), network.height()});
  const auto in_batches = [&](const std::vector<cv::Mat>& pictures, const auto& use) {
    const auto batch = static_cast<std::size_t>(network.batch());
    for (std::size_t i = 0; i < pictures.size(); i += batch)
      use(network.prepare(std::span(pictures).subspan(i, std::min(batch, pictures.size() - i))));
  };
  in_batches(exact, [&](const cv::Mat& input) { inputs.push_back(input.clone()); });

  // The library and nothing else: inputs prepared, outputs thrown away.
  const auto forward = [&] {
    for (const cv::Mat& input : inputs) network.run(input);
  };
  std::vector<Contender> contenders = {
      {"the library's forward pass alone", forward},
      {"encoder, pictures of the input's size", [&] { encoder->encode(exact); }},
      {"encoder, pictures of 640 x 480", [&] { encoder->encode(large); }},
      {"encoder, 640 x 480, from JPEG", [&] { encoder->encode(decoded(files)); }},
      {"of that: decoding", [&] { decoded(files); }},
      {"of that: resizing and normalising", [&] { in_batches(large, [](const cv::Mat&) {}); }}};
  compare(encoder->spec().name, contenders, options.rounds, kPictures);
  for (const Contender& one : contenders)
    record_figure({.name = one.name,
                   .value = 1e3 * median(one.seconds) / kPictures,
                   .unit = "ms/image",
                   .better = Better::kLower});
}

void measure(const Kind& kind, const std::vector<std::string>& names, int threads, int rounds) {
  constexpr std::size_t kPictures = 32;
  cv::setNumThreads(threads);
  const std::vector<Bytes> files = drawn_files(kind, kTraining);
  std::vector<cv::Mat> pictures = decoded(files);
  std::vector<Contender> contenders = {{"decoding", [&] {
                                          cv::parallel_for_({0, kPictures}, [&](const cv::Range& range) {
                                            decoded(std::span(files).subspan(static_cast<std::size_t>(range.start),
                                                                             static_cast<std::size_t>(range.size())));
                                          });
                                        }}};
  for (const std::string& name : names) {
    const auto& entry = EncoderRegistry::instance().find("encoder", name);
    const std::shared_ptr<Encoder> encoder = entry.create(Parameters(name, entry.parameters, {}), {});
    if (encoder->training_sample_count() > 0) encoder->learn(pictures);
    contenders.push_back({name, [&pictures, encoder] {
                            const auto batch = static_cast<std::size_t>(encoder->spec().batch);
                            for (std::size_t first = 0; first < kPictures; first += batch)
                              encoder->encode(std::span(pictures).subspan(first, std::min(batch, kPictures - first)));
                          }});
  }
  pictures.resize(kPictures);
  compare(kind.name, contenders, rounds, kPictures);
  for (const Contender& one : std::span(contenders).subspan(1))
    record_figure({.name = kind.name + ", " + one.name + (threads == 1 ? ", one thread" : ", all threads"),
                   .value = median(one.ratios),
                   .unit = "ratio",
                   .better = Better::kLower});
}

}  // namespace

Measure encoder(CLI::App& command) {
  const auto options = std::make_shared<EncoderCase>();
  options->files.model = testing::real_data(CITYLEARN_SOURCE_DIR, "nets/osnet_x0_25_msmt17.onnx");
  command.add_option("--model", options->files.model, "ONNX file");
  command.add_option("--layer", options->files.layer, "output layer; the last one by default");
  command.add_option("--preset", options->files.preset, "input size, mean, deviation and layer of a known network");
  command.add_option("--rounds", options->rounds, "rounds")->check(CLI::Range(1, 1000));
  for (const std::string side : {"width", "height"})
    command.add_option_function<int>(
        "--" + side, [options, side](int pixels) { options->values[side] = pixels; }, "of the input, in pixels");
  return [options] { measure(*options); };
}

Measure encoding(CLI::App& command) {
  const auto names = std::make_shared<std::vector<std::string>>(
      std::vector<std::string>{"hog", "vlad", "vlad_spatial", "hog_vlad", "patchnorm", "raw84"});
  const auto rounds = std::make_shared<int>(15);
  command.add_option("--encoder", *names, "encoders");
  command.add_option("--rounds", *rounds, "rounds")->check(CLI::Range(1, 1000));
  return [=] {
    const int processors = cv::getNumberOfCPUs();
    for (const Kind& kind : {kJpeg, Kind{"PNG 160 x 96", 160, 96, nullptr}, Kind{"PNG 64 x 32", 64, 32, nullptr}}) {
      measure(kind, *names, 1, *rounds);
      if (processors > 1) measure(kind, *names, processors, *rounds);
    }
  };
}

}  // namespace citylearn::bench
