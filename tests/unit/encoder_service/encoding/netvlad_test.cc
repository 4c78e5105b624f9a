// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "core/util/random.h"
#include "encoder_service/encoding/encoder.h"
#include "encoder_service/encoding/netvlad_head.h"
#include "tests/support/files.h"
#include "tests/support/networks/tiny_onnx.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using Values = std::map<std::string, double>;

Eigen::MatrixXf random_matrix(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  Random random(seed);
  Eigen::MatrixXf numbers(rows, columns);
  for (float& number : numbers.reshaped()) number = static_cast<float>(random.normal());
  return numbers;
}

NetvladHead random_head(int channels, int clusters, int projected = 0) {
  NetvladHead head;
  head.centroids = random_matrix(channels, clusters, 1);
  head.weight = 3 * random_matrix(channels, clusters, 2);
  head.bias = random_matrix(clusters, 1, 3);
  if (projected > 0) {
    head.projection = random_matrix(projected, channels * clusters, 4);
    head.offset = random_matrix(projected, 1, 5);
  }
  return head;
}

/// Equation 4, element by element, with intra-normalisation and the final one; index k * C + j.
std::vector<double> equation_4(const NetvladHead& head, const Eigen::MatrixXf& features) {
  const int channels = head.channels(), clusters = head.clusters();
  std::vector<double> sum(static_cast<std::size_t>(channels * clusters));
  const auto scale = [](double* numbers, int count) {
    double squares = 0;
    for (int i = 0; i < count; ++i) squares += numbers[i] * numbers[i];
    for (int i = 0; i < count && squares > 0; ++i) numbers[i] /= std::sqrt(squares);
  };
  for (Eigen::Index i = 0; i < features.rows(); ++i) {
    std::vector<double> x(static_cast<std::size_t>(channels));
    for (int j = 0; j < channels; ++j) x[j] = static_cast<double>(features(i, j));
    scale(x.data(), channels);
    std::vector<double> exponential(static_cast<std::size_t>(clusters));
    double total = 0;
    for (int k = 0; k < clusters; ++k) {
      double product = static_cast<double>(head.bias[k]);
      for (int j = 0; j < channels; ++j) product += x[j] * static_cast<double>(head.weight(j, k));
      total += exponential[k] = std::exp(product);
    }
    for (int k = 0; k < clusters; ++k)
      for (int j = 0; j < channels; ++j)
        sum[k * channels + j] += exponential[k] / total * (x[j] - static_cast<double>(head.centroids(j, k)));
  }
  for (int k = 0; k < clusters; ++k) scale(sum.data() + k * channels, channels);
  scale(sum.data(), channels * clusters);
  return sum;
}

TEST(NetvladHead, IsEquationFour) {
  for (const auto& [channels, clusters, positions] : {std::array{16, 8, 30}, {512, 64, 50}, {3, 1, 1}, {5, 4, 1}}) {
    const NetvladHead head = random_head(channels, clusters);
    const Eigen::MatrixXf features = 7 * random_matrix(positions, channels, 9);
    const Eigen::VectorXf got = head(features);
    const std::vector<double> expected = equation_4(head, features);
    ASSERT_EQ(got.size(), channels * clusters);
    for (Eigen::Index i = 0; i < got.size(); ++i) EXPECT_NEAR(got[i], expected[i], 2e-5) << i;
  }
}

TEST(NetvladHead, ProjectsAndScalesAgain) {
  const NetvladHead head = random_head(6, 4, 10);
  const Eigen::MatrixXf features = random_matrix(20, 6, 9);
  const Eigen::VectorXf got = head(features);
  const std::vector<double> vlad = equation_4(head, features);
  Eigen::VectorXd expected = head.offset.cast<double>();
  for (Eigen::Index i = 0; i < 24; ++i) expected += vlad[i] * head.projection.col(i).cast<double>();
  expected.normalize();
  ASSERT_EQ(got.size(), 10);
  EXPECT_LT((got.cast<double>() - expected).norm(), 1e-5);
}

TEST(NetvladHead, ZerosStayFinite) {
  NetvladHead head = random_head(6, 4);
  EXPECT_TRUE(head(Eigen::MatrixXf::Zero(5, 6)).allFinite());
  head.centroids.setZero();
  EXPECT_EQ(head(Eigen::MatrixXf::Zero(5, 6)), Eigen::VectorXf::Zero(24));
  head.weight *= 1e6f;  // a soft assignment that is all but hard
  EXPECT_TRUE(head(random_matrix(5, 6, 1)).allFinite());
}

TEST(NetvladHead, LearnsCentresAndSharpness) {
  // Four clear directions.
  Random random(3);
  Eigen::MatrixXf directions = random_matrix(8, 4, 6).colwise().normalized();
  Eigen::MatrixXf features(8, 400);
  for (Eigen::Index i = 0; i < 400; ++i)
    features.col(i) = (directions.col(i % 4) + 0.05f * random_matrix(8, 1, 100 + i)).normalized();
  const NetvladHead head = NetvladHead::learn(features, 4);
  for (int k = 0; k < 4; ++k) EXPECT_GT((directions.col(k).transpose() * head.centroids).maxCoeff(), 0.97f) << k;
  double ratios = 0;
  for (Eigen::Index i = 0; i < 400; ++i) {
    Eigen::VectorXf score = head.weight.transpose() * features.col(i) + head.bias;
    std::sort(score.data(), score.data() + 4);
    ratios += static_cast<double>(score[3] - score[2]) / 400;
  }
  EXPECT_NEAR(ratios, std::log(100.0), 0.05);
  EXPECT_EQ(NetvladHead::learn(features, 4).save(), head.save());
  EXPECT_TRUE(contains(error_of([&] { NetvladHead::learn(features.leftCols(3), 4); }), "only 3 local features"));
  EXPECT_TRUE(contains(error_of([&] { NetvladHead::learn(Eigen::MatrixXf::Ones(8, 9), 4); }), "too similar"));
  EXPECT_NO_THROW(NetvladHead::learn(features, 1));
}

/// A safetensors file from its header and numbers.
Bytes file_of(const std::string& header, std::size_t numbers, float value = 0.5f) {
  const std::uint64_t length = header.size();
  Bytes bytes(8 + header.size() + numbers * 4);
  std::memcpy(bytes.data(), &length, 8);
  std::memcpy(bytes.data() + 8, header.data(), header.size());
  for (std::size_t i = 0; i < numbers; ++i) std::memcpy(bytes.data() + 8 + header.size() + i * 4, &value, 4);
  return bytes;
}

Json tensor(const std::vector<std::int64_t>& shape, std::int64_t begin, std::int64_t end,
            const std::string& type = "F32") {
  return {{"dtype", type}, {"shape", shape}, {"data_offsets", {begin, end}}};
}

std::string parse_error(const Bytes& bytes) {
  return error_of([&] { NetvladHead::parse(bytes, "head.safetensors"); });
}

TEST(NetvladFile, ComesBackAsItWas) {
  for (const int projected : {0, 5}) {
    const NetvladHead head = random_head(6, 4, projected);
    const NetvladHead back = NetvladHead::parse(head.save(), "x");
    EXPECT_EQ(back.centroids, head.centroids);
    EXPECT_EQ(back.weight, head.weight);
    EXPECT_EQ(back.bias, head.bias);
    EXPECT_EQ(back.projection, head.projection);
    EXPECT_EQ(back.offset, head.offset);
  }
}

TEST(NetvladFile, ReadsWhatPytorchWrites) {
  // Convolutions have four sides; biases may be missing; the file may say where it comes from.
  const Json header = {{"__metadata__", {{"format", "pt"}}},
                       {"centroids", tensor({2, 3}, 0, 24)},
                       {"conv.weight", tensor({2, 3, 1, 1}, 24, 48)},
                       {"wpca.weight", tensor({4, 6, 1, 1}, 48, 144)}};
  const NetvladHead head = NetvladHead::parse(file_of(header.dump(), 36), "x");
  EXPECT_EQ(head.channels(), 3);
  EXPECT_EQ(head.clusters(), 2);
  EXPECT_EQ(head.dimension(), 4);
  EXPECT_EQ(head.bias, Eigen::Vector2f::Zero());
  EXPECT_EQ(head.offset, Eigen::Vector4f::Zero());
}

TEST(NetvladFile, BadFilesGetOneLine) {
  const Json good = {{"centroids", tensor({2, 3}, 0, 24)}, {"conv.weight", tensor({2, 3}, 24, 48)}};
  ASSERT_EQ(parse_error(file_of(good.dump(), 12)), "");
  const auto with = [&](const std::string& name, const Json& entry, std::size_t numbers) {
    Json header = good;
    header[name] = entry;
    return parse_error(file_of(header.dump(), numbers));
  };
  const auto without = [&](const std::string& name) {
    Json header = {{name, tensor({2, 3}, 0, 24)}};
    return parse_error(file_of(header.dump(), 6));
  };
  EXPECT_TRUE(contains(without("centroids"), "no tensor 'conv.weight'"));
  EXPECT_TRUE(contains(without("conv.weight"), "no tensor 'centroids'"));
  EXPECT_TRUE(contains(with("conv.biass", tensor({2}, 48, 56), 14), "unknown tensor 'conv.biass' (known: centroids"));
  EXPECT_TRUE(contains(with("line\nbreak", tensor({2}, 48, 56), 14), "unknown tensor 'line break'"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({3}, 48, 60), 15), "'conv.bias' is 3 x 1, it has to be 2 x 1"));
  EXPECT_TRUE(contains(with("wpca.weight", tensor({4, 5}, 48, 128), 32), "it has to be any x 6"));
  EXPECT_TRUE(contains(with("wpca.bias", tensor({4}, 48, 64), 16), "without 'wpca.weight'"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 48, 52, "F16"), 13), "dtype \"F16\", must be \"F32\""));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 48, 60), 15), "does not fit its 12 bytes"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 48, 56), 13), "cut short?"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 56, 64), 16), "a hole of 8 bytes before tensor 'conv.bias'"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 24, 32), 12), "tensors 'conv.bias' and 'conv.weight' overlap"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, 40, 48), 12), "overlap"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({0}, 48, 48), 12), "side of 0"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({std::int64_t{1} << 62}, 48, 56), 14), "does not fit its 8 bytes"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({1 << 20, 1 << 20}, 48, 56), 14), "does not fit its 8 bytes"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2}, -8, 56), 14), "data_offsets must be whole numbers"));
  EXPECT_TRUE(contains(with("conv.bias", 5, 14), "'conv.bias' is not a JSON object"));
  EXPECT_TRUE(contains(with("conv.bias", tensor({2, 3, 4}, 48, 144), 36), "neither a vector nor a matrix"));
  EXPECT_TRUE(contains(parse_error(file_of(good.dump(), 13)), "belong to no tensor"));
  EXPECT_TRUE(contains(parse_error(file_of(good.dump(), 12, NAN)), "not finite"));
  EXPECT_TRUE(contains(parse_error(file_of("[1,2]", 0)), "not a JSON object"));
  EXPECT_TRUE(contains(parse_error(file_of(std::string(100000, '['), 0)), "its header is not a JSON object"));
  Bytes hostile = file_of(good.dump(), 12);
  std::fill_n(hostile.begin(), 8, std::byte{0xFF});
  EXPECT_TRUE(contains(parse_error(hostile), "its header would have 18446744073709551615 bytes"));
  const Bytes whole = file_of(good.dump(), 12);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_TRUE(contains(parse_error(Bytes(whole.begin(), whole.begin() + size)), "head.safetensors: ")) << size;
}

std::unique_ptr<Encoder> make_netvlad(const EncoderFiles& files, const Values& values = {}) {
  const auto& entry = EncoderRegistry::instance().find("encoder", "netvlad");
  return entry.create(Parameters("netvlad", entry.parameters, values), files);
}

std::vector<cv::Mat> noises(int count) {
  std::vector<cv::Mat> pictures;
  cv::RNG random(7);
  for (int i = 0; i < count; ++i) {
    pictures.emplace_back(12, 16, CV_8UC3);
    random.fill(pictures.back(), cv::RNG::UNIFORM, 0, 256);
  }
  return pictures;
}

TEST(Netvlad, LearnsRestoresAndNamesItsHead) {
  const Folder folder;
  const EncoderFiles files = network(tiny_convolution({-1, 3, 12, 16}, 6).save(folder / "a.onnx"), "conv");
  const std::vector<cv::Mat> pictures = noises(6);
  const auto first = make_netvlad(files, {{"clusters", 4}});
  EXPECT_EQ(first->training_sample_count(), 100);
  EXPECT_TRUE(first->state().empty());
  EXPECT_TRUE(contains(error_of([&] { first->encode(pictures); }), "no centres yet"));
  EXPECT_TRUE(contains(error_of([&] { first->spec(); }), "no centres yet"));
  first->learn(pictures);
  EXPECT_EQ(first->spec().dimension, 24);
  const Eigen::MatrixXf descriptors = first->encode(pictures);
  ASSERT_EQ(descriptors.cols(), 6);
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(descriptors.col(i).norm(), 1, 1e-5);
    EXPECT_EQ(first->encode(std::span(&pictures[i], 1)), descriptors.col(i)) << i;
  }

  const auto again = make_netvlad(files, {{"clusters", 4}});
  again->restore(first->state());
  EXPECT_EQ(again->spec().name, first->spec().name);
  EXPECT_EQ(again->encode(pictures), descriptors);
  const auto relearned = make_netvlad(files, {{"clusters", 4}});
  relearned->learn(pictures);
  EXPECT_EQ(relearned->state(), first->state());

  // What was learned is a head file too, and another lesson gives another name.
  const std::string path = folder / "head.safetensors";
  const Bytes state = first->state();
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(state.data()), std::ssize(state));
  EncoderFiles with_head = files;
  with_head.head = path;
  const auto filed = make_netvlad(with_head);
  EXPECT_EQ(filed->training_sample_count(), 0);
  EXPECT_EQ(filed->spec().name, first->spec().name);
  EXPECT_EQ(filed->encode(pictures), descriptors);
  EXPECT_TRUE(filed->state().empty());
  EXPECT_THROW(filed->restore(state), Error);
  const auto other = make_netvlad(files, {{"clusters", 4}});
  other->learn(std::span(pictures).subspan(1));
  EXPECT_NE(other->spec().name, first->spec().name);

  EXPECT_TRUE(contains(error_of([&] { make_netvlad(files, {{"clusters", 5}})->restore(state); }), "other parameters"));
  EXPECT_THROW(again->restore(std::span(state).first(20)), Error);
  EXPECT_EQ(again->encode(pictures), descriptors) << "a failed restore changes nothing";
}

TEST(Netvlad, RefusesWhatDoesNotFit) {
  const Folder folder;
  const std::string model = tiny_convolution({1, 3, 12, 16}, 6).save(folder / "a.onnx");
  const std::string flat = TinyOnnx()
                               .input({1, 3, 12, 16})
                               .node("GlobalAveragePool", "pool")
                               .node("Flatten", "flat", {}, {}, {{"axis", 1}})
                               .save(folder / "flat.onnx");
  EXPECT_TRUE(contains(error_of([&] { make_netvlad(network(flat)); }), "feature map"));
  const Bytes head = random_head(7, 4).save();
  std::ofstream(folder / "head", std::ios::binary).write(reinterpret_cast<const char*>(head.data()), std::ssize(head));
  EXPECT_TRUE(contains(error_of([&] { make_netvlad(network(model, "relu", "", folder / "head")); }),
                       "is made for 7 channels, the network's layer has 6"));
  EXPECT_TRUE(contains(error_of([&] { make_netvlad(network(model, "relu", "", folder / "none")); }), "No such file"));
}

}  // namespace
}  // namespace citylearn::testing
