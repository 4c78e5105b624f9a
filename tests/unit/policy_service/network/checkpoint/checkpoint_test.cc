// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/checkpoint/checkpoint.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/files/files.h"
#include "core/util/error.h"
#include "policy_service/network/checkpoint/trained_agent.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class CheckpointFile : public ::testing::Test {
 protected:
  CheckpointFile() {
    checkpoint_.header = {{"agent", "nobody"}, {"number", 0.1}};
    checkpoint_.tensors["a"] = Matrix<float>::Random(3, 5);
    checkpoint_.tensors["empty"] = Matrix<float>(0, 4);
  }

  /// Reading must fail with one line that names the file and says `what`.
  void expect_refused(const std::string& bytes, const std::string& what) {
    std::ofstream(path_, std::ios::binary) << bytes;
    const std::string message = error_of([&] { read_checkpoint(path_); });
    EXPECT_TRUE(holds(message, path_));
    EXPECT_TRUE(holds(message, what));
  }

  Folder folder_;
  const std::string path_ = folder_ / "one.clk";
  Checkpoint checkpoint_;
};

TEST_F(CheckpointFile, ComesBackAsItWas) {
  write_checkpoint(path_, checkpoint_);
  const Checkpoint back = read_checkpoint(path_);
  EXPECT_EQ(back.header.at("agent"), "nobody");
  EXPECT_EQ(back.header.at("number"), 0.1);
  EXPECT_EQ(back.tensors.at("a"), checkpoint_.tensors.at("a"));
  EXPECT_EQ(back.tensors.at("empty").cols(), 4);
  const std::string bytes = read_file(path_);
  write_checkpoint(path_, back);
  EXPECT_EQ(read_file(path_), bytes);
}

TEST_F(CheckpointFile, OfARemovedAgentSaysWhatToDo) {
  checkpoint_.header = {{"agent", "place_memory"}};
  EXPECT_TRUE(holds(error_of([&] { trained_agent(checkpoint_); }), "train place_filter on the same data"));
}

TEST_F(CheckpointFile, OfAnEarlierPlaceFilterActsAsItDid) {
  checkpoint_.header = {{"agent", "place_filter"}, {"task", {{"features", 4}, {"frames", 9}, {"first_frame", 0}}}};
  checkpoint_.header["network"] = {{"slip", -1}, {"kidnap", -1}, {"units", 5}};
  checkpoint_.tensors["reference"] = checkpoint_.tensors["learner.parameters"] = Matrix<float>(0, 0);
  EXPECT_EQ(unbuilt_agent(checkpoint_).network_parameters.at("slips-limit-tempering"), 0);
  checkpoint_.header["network"]["slips-limit-tempering"] = 1;
  EXPECT_EQ(unbuilt_agent(checkpoint_).network_parameters.at("slips-limit-tempering"), 1);
}

TEST_F(CheckpointFile, IsRefusedWhenAnyByteChanged) {
  write_checkpoint(path_, checkpoint_);
  const std::string bytes = read_file(path_);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string changed = bytes;
    changed[i] = static_cast<char>(changed[i] ^ 0x40);
    std::ofstream(path_, std::ios::binary) << changed;
    EXPECT_THROW(read_checkpoint(path_), Error) << "byte " << i;
  }
}

TEST_F(CheckpointFile, IsRefusedWhenCutShort) {
  write_checkpoint(path_, checkpoint_);
  const std::string bytes = read_file(path_);
  for (std::size_t length = 0; length < bytes.size(); ++length) expect_refused(bytes.substr(0, length), "cut short");
}

TEST_F(CheckpointFile, IsRefusedWhenForeignNewerOrLonger) {
  write_checkpoint(path_, checkpoint_);
  const std::string bytes = read_file(path_);
  expect_refused("frame,feature\n0,1\n", "is not a checkpoint");
  std::string newer = bytes;
  newer[8] = 99;
  expect_refused(newer, "version 99");
  expect_refused(bytes + "x", "damaged");
  std::filesystem::remove(path_);
  EXPECT_THROW(read_checkpoint(path_), Error);
}

TEST_F(CheckpointFile, OnlyTheNewestAreKept) {
  EXPECT_FALSE(newest_checkpoint(folder_ / "none"));
  const std::string kept = folder_ / "run";
  for (const std::uint64_t update : {5, 10, 95, 100}) write_checkpoint_of_update(kept, update, checkpoint_);
  std::ofstream(kept + "/checkpoint-999.clk.tmp") << "left by a crash";
  EXPECT_EQ(newest_checkpoint(kept), kept + "/checkpoint-100.clk");
  EXPECT_FALSE(std::filesystem::exists(kept + "/checkpoint-5.clk"));
  EXPECT_TRUE(std::filesystem::exists(kept + "/checkpoint-10.clk"));
}

TEST_F(CheckpointFile, TheBestOneStaysAndIsFoundWhereItIsAlone) {
  const std::string kept = folder_ / "run", best = kept + "/best.clk";
  std::filesystem::create_directories(kept);
  write_checkpoint(best, checkpoint_);
  EXPECT_EQ(newest_checkpoint(kept), best);
  for (const std::uint64_t update : {5, 10, 95, 100}) write_checkpoint_of_update(kept, update, checkpoint_, 1);
  EXPECT_TRUE(std::filesystem::exists(best));
  EXPECT_EQ(newest_checkpoint(kept), kept + "/checkpoint-100.clk");
}

TEST_F(CheckpointFile, AFailedWriteLeavesTheOldOnes) {
  const std::string kept = folder_ / "run";
  const std::string old = write_checkpoint_of_update(kept, 1, checkpoint_);
  const std::string bytes = read_file(old);
  // Nothing can be written there.
  std::filesystem::create_directory(kept + "/checkpoint-2.clk." + std::to_string(::getpid()) + ".tmp");
  EXPECT_THROW(write_checkpoint_of_update(kept, 2, checkpoint_, 1), Error);
  EXPECT_EQ(newest_checkpoint(kept), old);
  EXPECT_EQ(read_file(old), bytes);
  EXPECT_THROW(write_checkpoint("/dev/full/x", checkpoint_), Error);
}

TEST_F(CheckpointFile, AnAgentNeedsItsHeader) {
  EXPECT_THROW(trained_agent(checkpoint_), Error);
  checkpoint_.header = {{"agent", "nobody"},
                        {"task", {{"features", 4}, {"frames", 8}, {"first_frame", 0}}},
                        {"network", nlohmann::json::object()}};
  EXPECT_THROW(trained_agent(checkpoint_), Error);
  checkpoint_.tensors["reference"] = Matrix<float>::Zero(4, 8);
  EXPECT_THROW(trained_agent(checkpoint_), Error);  // no such network
  checkpoint_.header["agent"] = "baseline";
  EXPECT_THROW(trained_agent(checkpoint_), Error);  // no parameters
  checkpoint_.tensors["learner.parameters"] = Matrix<float>::Zero(3, 1);
  EXPECT_THROW(trained_agent(checkpoint_), Error);  // too few
}

}  // namespace
}  // namespace citylearn::testing
