// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "bench/cases/cases.h"
#include "encoder_service/encoding/encoder.h"
#include "env_service/drawn_city/drawn_images.h"

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
