// SPDX-License-Identifier: Apache-2.0
// See README.md.
#include <cstdio>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "bench/bench.h"
#include "bench/figures.h"
#include "encoder_service/encoding/encoder.h"
#include "env_service/drawn_city/drawn_images.h"

namespace {

using namespace citylearn;
using bench::median;
using bench::seconds;

constexpr int kPictures = 32;
constexpr int kTraining = 64;  // pictures that encoders learn from

struct Kind {
  std::string name;
  int width, height;
  const char* format;  // of the files; nullptr: PNG, as they are drawn
};

struct Contender {
  std::string name;
  std::function<void()> work;  // kPictures of them
  std::vector<double> times = {}, ratios = {};
};

cv::Mat decoded(const Bytes& file) { return decode_picture(file, "drawn picture"); }

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
    cv::imencode(kind.format, decoded(file), other);
    const auto bytes = std::as_bytes(std::span(other));
    file.assign(bytes.begin(), bytes.end());
  }
  return files;
}

/// Returns the encoders that need no file, or those with the given names. They have learned.
std::vector<std::unique_ptr<Encoder>> encoders(const std::vector<std::string>& names,
                                               std::span<const cv::Mat> training) {
  std::vector<std::unique_ptr<Encoder>> result;
  for (const std::string& name : names) {
    const auto& entry = EncoderRegistry::instance().find("encoder", name);
    result.push_back(entry.create(Parameters(name, entry.parameters, {}), {}));
    if (result.back()->training_sample_count() > 0) result.back()->learn(training);
  }
  return result;
}

void measure(const Kind& kind, const std::vector<std::string>& names, int threads, int rounds) {
  cv::setNumThreads(threads);
  const std::vector<Bytes> files = drawn_files(kind, kTraining);
  std::vector<cv::Mat> pictures;
  for (const Bytes& file : files) pictures.push_back(decoded(file));
  const auto all = encoders(names, pictures);
  pictures.resize(kPictures);

  std::vector<Contender> contenders = {{"decoding", [&] {
                                          cv::parallel_for_({0, kPictures}, [&](const cv::Range& range) {
                                            for (int i = range.start; i < range.end; ++i)
                                              decoded(files[static_cast<std::size_t>(i)]);
                                          });
                                        }}};
  for (std::size_t i = 0; i < all.size(); ++i)
    contenders.push_back({names[i], [&pictures, encoder = all[i].get()] {
                            const auto batch = static_cast<std::size_t>(encoder->spec().batch);
                            for (std::size_t first = 0; first < kPictures; first += batch)
                              encoder->encode(std::span(pictures).subspan(first, std::min(batch, kPictures - first)));
                          }});
  for (int round = -1; round < rounds; ++round)  // the first one warms up
    for (Contender& contender : contenders) {
      const double time = seconds(contender.work);
      if (round < 0) continue;
      contender.times.push_back(time);
      contender.ratios.push_back(time / contenders[0].times.back());
    }
  std::printf("%s, %d thread%s\n", kind.name.c_str(), threads, threads == 1 ? "" : "s");
  for (const Contender& contender : contenders) {
    const double each = median(contender.times) / kPictures;
    std::printf("  %-14s %10.3f %12.0f %10.2f\n", contender.name.c_str(), 1e3 * each, 1 / each,
                median(contender.ratios));
    if (contender.name == "decoding") continue;
    bench::record_figure({.name = kind.name + ", " + contender.name + (threads == 1 ? ", one thread" : ", all threads"),
                          .value = median(contender.ratios),
                          .unit = "ratio",
                          .better = bench::Better::kLower});
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> names = {"hog", "vlad", "vlad_spatial", "hog_vlad", "patchnorm", "raw84"};
  int rounds = 15;
  CLI::App app("What encoders cost beside decoding the pictures", "bench_encoding");
  app.add_option("--encoder", names, "encoders")->capture_default_str();
  app.add_option("--rounds", rounds, "rounds")->check(CLI::Range(1, 1000))->capture_default_str();
  return bench::run(app, argc, argv, [&] {
    const int processors = cv::getNumberOfCPUs();
    std::printf("%d rounds of %d pictures, medians\n  %-14s %10s %12s %10s\n", rounds, kPictures, "", "ms/picture",
                "pictures/s", "/ decoding");
    for (const Kind& kind : {Kind{"JPEG 640 x 480", 640, 480, ".jpg"}, Kind{"PNG 160 x 96", 160, 96, nullptr},
                             Kind{"PNG 64 x 32", 64, 32, nullptr}}) {
      measure(kind, names, 1, rounds);
      if (processors > 1) measure(kind, names, processors, rounds);
    }
  });
}
