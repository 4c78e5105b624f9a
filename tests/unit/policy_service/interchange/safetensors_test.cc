// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/safetensors.h"

#include <gtest/gtest.h>

#include <bit>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "policy_service/interchange/export.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/paths.h"
#include "tests/support/networks/some_agent.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

const std::map<std::string, double> kSmall = {{"hidden", 6}, {"cells", 4}};

TrainedAgent small_agent() { return some_agent("features", some_task(5, 7), kSmall); }

/// A file with this header (as it is) and so many bytes of numbers.
std::string raw(const std::string& header, std::size_t bytes) {
  const std::uint64_t length = header.size();
  std::string file(8, '\0');
  std::memcpy(file.data(), &length, 8);
  return file + header + std::string(bytes, '\1');
}

std::string parse_error(const std::string& bytes) {
  return error_of([&] { Safetensors::parse(bytes, "some.safetensors"); });
}

TEST(SafetensorsFile, APerlProgramReadsWhatWeWrite) {
  Folder folder;
  const TrainedAgent agent = small_agent();
  make_file(folder / "a.safetensors", parameters_of(agent, {{"agent", agent.name}, {"frames", "7"}}).bytes());
  Service perl({CITYLEARN_PERL, std::string(CITYLEARN_SOURCE_DIR) + "/tests/support/read_safetensors.pl",
                folder / "a.safetensors"},
               folder / "read");
  ASSERT_EQ(perl.wait(seconds(60)), 0) << perl.output();

  // Row by row out of the network's columns; the reference has a place a row.
  std::map<std::string, std::string> expected = {{"meta agent", "features"}, {"meta frames", "7"}};
  const auto add = [&](const std::string& name, const Eigen::Ref<const Matrix<float>>& numbers) {
    std::string line = std::to_string(numbers.rows()) + "x" + std::to_string(numbers.cols());
    for (std::ptrdiff_t row = 0; row < numbers.rows(); ++row)
      for (std::ptrdiff_t col = 0; col < numbers.cols(); ++col)
        line += " " + std::to_string(std::bit_cast<std::uint32_t>(numbers(row, col)));
    expected[name] = line;
  };
  for (const Tensor& tensor : agent.network->tensors())
    add(tensor.name,
        Eigen::Map<const Matrix<float>>(agent.parameters.data() + tensor.offset, tensor.rows, tensor.cols));
  add("reference", agent.task.reference.transpose());
  std::map<std::string, std::string> found;
  for (const std::string& line : lines_of(perl.output())) {
    const std::size_t end = line.find(' ', line.starts_with("meta ") ? 5 : 0);
    found[line.substr(0, end)] = line.substr(end + 1);
  }
  EXPECT_EQ(found, expected);
}

TEST(SafetensorsFile, ComesBackAsItWas) {
  Folder folder;
  for (const char* name : {"features", "baseline", "place_filter"}) {
    const TrainedAgent agent = some_agent(name, some_task());
    const std::string bytes = parameters_of(agent, {{"agent", name}}).bytes();
    EXPECT_EQ(Safetensors::parse(bytes, "there").bytes(), bytes) << name;
    make_file(folder / "a.safetensors", bytes);
    TrainedAgent other = agent;
    other.parameters.setConstant(7);
    load_parameters(folder / "a.safetensors", other);
    EXPECT_EQ(other.parameters, agent.parameters) << name;
  }
}

TEST(SafetensorsFile, LoadedOverACheckpointItLeavesWithItsNumbers) {
  Folder folder;
  const NetworkTask task = some_task();
  write_checkpoint(folder / "one.clk", some_checkpoint("place_filter", task));
  const TrainedAgent other = some_agent("place_filter", task);
  make_file(folder / "other.safetensors", parameters_of(other, {}).bytes());
  export_agent({folder / "one.clk", folder / "other.safetensors", folder / "both.safetensors"});
  const Safetensors both = Safetensors::parse(read_file(folder / "both.safetensors"), "both");
  TrainedAgent read = trained_agent(read_checkpoint(folder / "one.clk"));
  EXPECT_NE(read.parameters, other.parameters);
  load_parameters(folder / "both.safetensors", read);
  EXPECT_EQ(read.parameters, other.parameters);
  EXPECT_EQ(both.metadata.at("agent"), "place_filter");
  EXPECT_EQ(both.metadata.at("checkpoint_sha256").size(), 64u);
  EXPECT_EQ(both.metadata.at("parameters_sha256").size(), 64u);
  EXPECT_NE(both.metadata.at("checkpoint_sha256"), both.metadata.at("parameters_sha256"));
}

TEST(SafetensorsFile, ABadOneIsRefusedInOneLine) {
  const auto expect_refused = [](const std::string& bytes, const std::string& what) {
    const std::string error = parse_error(bytes);
    EXPECT_TRUE(error.starts_with("some.safetensors: ")) << error;
    EXPECT_TRUE(holds(error, what));
  };
  const auto tensor = [](const std::string& name, const std::string& shape, const std::string& offsets,
                         const std::string& dtype = "F32") {
    return "\"" + name + "\":{\"dtype\":\"" + dtype + "\",\"shape\":" + shape + ",\"data_offsets\":" + offsets + "}";
  };
  const std::string a = tensor("a", "[2]", "[0,8]");
  ASSERT_EQ(parse_error(raw("{" + a + "}", 8)), "") << "what follows must fail for its own reason";
  ASSERT_EQ(
      parse_error(raw("{" + a + "," + tensor("b", "[0,3]", "[8,8]") + "," + tensor("c", "[]", "[8,12]") + "}  ", 12)),
      "");
  ASSERT_EQ(parse_error(raw("{}", 0)), "");

  expect_refused("", "fewer than 8 bytes");
  expect_refused("1234567", "fewer than 8 bytes");
  expect_refused(raw("{" + a + "}", 8).substr(0, 20), "cut short");
  std::string endless = raw("{" + a + "}", 8);
  endless[7] = '\x7F';
  expect_refused(endless, "its header would have");
  expect_refused(raw("{" + a, 8), "its header is not a JSON object");
  expect_refused(raw("[" + a + "]", 8), "its header is not a JSON object");
  expect_refused(raw("[1]", 0), "its header is not a JSON object");
  expect_refused(raw("", 0), "its header is not a JSON object");
  expect_refused(raw(std::string(100000, '['), 0), "its header is not a JSON object");
  expect_refused(raw("{\"a\":1}", 0), "tensor 'a' is not a JSON object");
  expect_refused(raw("{\"a\":{\"dtype\":\"F32\",\"shape\":[2]}}", 8), "has no data_offsets");
  expect_refused(raw("{" + tensor("a", "[4]", "[0,8]", "BF16") + "}", 8), "has dtype \"BF16\"");
  expect_refused(raw("{" + tensor("a", "2", "[0,8]") + "}", 8), "its shape is not a list");
  expect_refused(raw("{" + tensor("a", "[2]", "[8]") + "}", 8), "data_offsets are not a list of two");
  expect_refused(raw("{" + tensor("a", "[-2]", "[0,8]") + "}", 8), "must be whole numbers");
  expect_refused(raw("{" + tensor("a", "[2.0]", "[0,8]") + "}", 8), "must be whole numbers");
  expect_refused(raw("{" + tensor("a", "[3]", "[0,8]") + "}", 8), "of shape [3] does not fit its 8 bytes");
  expect_refused(raw("{" + tensor("a", "[4611686018427387904,2]", "[0,8]") + "}", 8), "does not fit its 8 bytes");
  expect_refused(raw("{" + tensor("a", "[4611686018427387905,4611686018427387904]", "[0,8]") + "}", 8),
                 "does not fit its 8 bytes");
  expect_refused(raw("{" + tensor("a", "[2]", "[8,0]") + "}", 8), "lies at [8, 0]");
  expect_refused(raw("{" + a + "}", 7), "cut short");
  expect_refused(raw("{" + a + "}", 9), "1 bytes that belong to no tensor");
  expect_refused(raw("{" + a + "," + tensor("b", "[2]", "[4,12]") + "}", 12), "tensors 'a' and 'b' overlap");
  expect_refused(raw("{" + a + "," + tensor("b", "[2]", "[0,8]") + "}", 8), "tensors 'a' and 'b' overlap");
  expect_refused(raw("{" + a + "," + tensor("b", "[1]", "[12,16]") + "}", 16), "a hole of 4 bytes before tensor 'b'");
  expect_refused(raw("{\"__metadata__\":[]," + a + "}", 8), "__metadata__ is not a JSON object");
  expect_refused(raw("{\"__metadata__\":{\"x\":1}," + a + "}", 8), "__metadata__ 'x' is not a string");
}

TEST(SafetensorsFile, WhatDoesNotFitTheAgentIsRefused) {
  Folder folder;
  const TrainedAgent agent = small_agent();
  const std::string path = folder / "a.safetensors";
  const Safetensors good = parameters_of(agent, {{"agent", "features"}});
  const auto expect_refused = [&](const Safetensors& file, const std::string& what) {
    make_file(path, file.bytes());
    TrainedAgent over = agent;
    const std::string refusal = error_of([&] { load_parameters(path, over); });
    EXPECT_TRUE(contains(refusal, path));
    EXPECT_TRUE(contains(refusal, what));
    EXPECT_EQ(over.parameters, agent.parameters) << "is as before";
  };
  Safetensors bad = good;
  bad.tensors.erase("lstm.bias");
  expect_refused(bad, "has no tensor 'lstm.bias'");
  bad = good;
  bad.tensors["more"] = {{1}, {1}};
  expect_refused(bad, "has tensor 'more', which network 'features' does not know");
  bad = good;
  std::swap(bad.tensors["lstm.input"].shape[0], bad.tensors["lstm.input"].shape[1]);
  expect_refused(bad, "tensor 'lstm.input' has shape [12, 16], network 'features' needs [16, 12]");
  bad = good;
  bad.tensors["lstm.bias"].numbers[3] = std::numeric_limits<float>::quiet_NaN();
  expect_refused(bad, "tensor 'lstm.bias' has numbers that are not finite");
  bad = good;
  bad.metadata["agent"] = "baseline";
  expect_refused(bad, "has parameters of network 'baseline', the agent is 'features'");

  Safetensors vectors = good;  // as PyTorch would write them, and without what is not a parameter
  vectors.tensors["lstm.bias"].shape = {16};
  vectors.tensors.erase("reference");
  vectors.metadata.clear();
  make_file(path, vectors.bytes());
  TrainedAgent over = agent;
  over.parameters.setZero();
  load_parameters(path, over);
  EXPECT_EQ(over.parameters, agent.parameters);
}

/// Broken in all sorts of ways a file gives an Error or, where the change does no harm, tensors: nothing else.
TEST(SafetensorsFile, ThousandsOfBrokenOnesNeverCrash) {
  const std::string whole = parameters_of(small_agent(), {{"agent", "features"}}).bytes();
  std::uint64_t length = 0;
  std::memcpy(&length, whole.data(), 8);
  const std::string pieces[] = {"{",       "}",    "[",  "]",      "-1", "1e999", "18446744073709551615",
                                "\"F64\"", "null", "\"", "\\u0000"};
  Random random{3};
  int refused = 0, read = 0;
  for (int round = 0; round < 6000; ++round) {
    std::string bytes = whole;
    for (std::uint64_t changes = 1 + random.below(3); changes > 0; --changes) {
      // Mostly in the header, where the structure is.
      const std::size_t at = random.below(4) ? random.below(std::min<std::size_t>(8 + length, bytes.size()) + 1)
                                             : random.below(bytes.size() + 1);
      switch (random.below(5)) {
        case 0:
          if (at < bytes.size()) bytes[at] = static_cast<char>(bytes[at] ^ 1 << random.below(8));
          break;
        case 1:
          bytes.resize(at);
          break;
        case 2:
          bytes.insert(at, pieces[random.below(std::size(pieces))]);
          break;
        case 3:
          bytes.erase(at, random.below(12));
          break;
        default:
          if (at < bytes.size()) bytes[at] = static_cast<char>('0' + random.below(10));
      }
    }
    try {
      const Safetensors file = Safetensors::parse(bytes, "broken");
      for (const auto& [name, tensor] : file.tensors) {
        std::size_t count = 1;
        for (const std::uint64_t side : tensor.shape) count *= side;
        ASSERT_EQ(tensor.numbers.size(), count) << name;
      }
      ++read;
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 4000);
  EXPECT_GT(read, 100) << "the changes are too wild to reach what comes after the header";
}

}  // namespace
}  // namespace citylearn::testing
