// SPDX-License-Identifier: Apache-2.0
// Any number of encoder_services divide a traversal, over a wire that delays, loses, repeats and reorders, in virtual
// time.
#include "encoder_service/pipeline/block_division.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <fstream>
#include <memory>
#include <numeric>
#include <utility>

#include "core/util/random.h"
#include "encoder_service/pipeline/traversal_work.h"
#include "tests/support/files.h"

namespace citylearn::testing {
namespace {

using std::chrono::milliseconds;

constexpr int kDimension = 3;
constexpr std::uint64_t kHash = 7;
const FeatureStore::Key kKey{"hog-1 bins=12", kDimension, kHash, 1000};

Eigen::VectorXf descriptor(int frame) { return Eigen::VectorXf::Constant(kDimension, static_cast<float>(frame)); }

/// An encoder_service without a wire.
struct Encoding {
  Encoding(std::uint64_t own, const FeatureStore::Key& key)
      : incarnation(own),
        division(own, key.traversal, static_cast<std::uint32_t>(key.frames)),
        work("", key, division) {}

  std::uint64_t incarnation;
  BlockDivision division;
  TraversalWork work;
  double speed = 0.5;      // frames a millisecond
  std::uint64_t sent = 0;  // statuses
  bool works = true;       // it reaches the pictures
  std::deque<int> queue;   // frames to encode
  bool alive = true;
};

/// Encoder_services that hear each other late, twice or never.
class World {
 public:
  World(std::uint64_t seed, double loss) : random_(seed), loss_(loss) {}

  Encoding& add(std::uint64_t incarnation, const FeatureStore::Key& key = kKey) {
    services.push_back(std::make_unique<Encoding>(incarnation, key));
    for (const auto& one : services)
      for (const auto& other : services)
        if (one != other && one->alive && other->alive) one->division.add_peer(other->incarnation, "peer");
    return *services.back();
  }
  /// The others note it `silence` later.
  void kill(Encoding& service, milliseconds silence) {
    service.alive = false;
    gone_.emplace_back(now_ + silence, service.incarnation);
  }
  void step() {
    now_ += milliseconds(1);
    for (const auto& [at, incarnation] : gone_)
      if (at == now_)
        for (const auto& service : services) service->division.remove_peer(incarnation);
    std::erase_if(wire_, [&](const Sent& sent) {
      if (sent.at > now_) return false;
      if (sent.to->alive) sent.to->division.take(sent.status, now_);
      return true;
    });
    for (const auto& service : services)
      if (service->alive) work(*service);
  }
  /// Returns whether all that live have all frames within so many milliseconds.
  bool finishes(int most) {
    const auto complete = [](const auto& service) { return !service->alive || service->work.complete(); };
    for (int i = 0; i < most; ++i) {
      if (std::all_of(services.begin(), services.end(), complete)) return true;
      step();
    }
    return false;
  }
  int encoded() const {
    int sum = 0;
    for (const auto& service : services) sum += service->work.made();
    return sum;
  }

  std::vector<std::unique_ptr<Encoding>> services;

 private:
  struct Sent {
    Clock::time_point at;
    Encoding* to;
    msg::DescriptorStatus status;
  };

  void work(Encoding& service) {
    for (const int frame : service.work.take_lost()) std::erase(service.queue, frame);
    while (service.works && service.queue.size() < 96) {
      const std::vector<int> frames = service.work.begin(now_);
      if (frames.empty()) break;
      service.queue.insert(service.queue.end(), frames.begin(), frames.end());
    }
    if (!service.queue.empty() && random_.uniform() < service.speed) {
      service.work.put(service.queue.front(), descriptor(service.queue.front()));
      service.queue.pop_front();
    }
    fetch(service);
    msg::DescriptorStatus status;
    if (!service.division.fill(now_, service.work.present(), status)) return;
    status.header().incarnation(service.incarnation);
    status.header().message(++service.sent);
    for (const auto& other : services)
      for (int copy = 0; other->alive && other.get() != &service && copy < 2; ++copy)
        if (random_.uniform() < (copy == 0 ? 1 - loss_ : loss_))
          wire_.push_back({now_ + milliseconds(1 + random_.below(20)), other.get(), status});
  }
  void fetch(Encoding& service) {
    for (const auto& other : services) {
      const auto peer = service.division.peers().find(other->incarnation);
      if (!other->alive || peer == service.division.peers().end()) continue;
      for (int block = 0; block < static_cast<int>(service.work.lacking().size()); ++block)
        if (!service.division.encoding().contains(block))
          for (const int frame :
               BlockDivision::frames_of(block, service.division.offered(peer->second, block) &
                                                   service.work.lacking()[static_cast<std::size_t>(block)]))
            service.work.put_fetched(frame, descriptor(frame));
    }
  }

  Random random_;
  double loss_;
  Clock::time_point now_{std::chrono::hours(1)};
  std::vector<Sent> wire_;
  std::vector<std::pair<Clock::time_point, std::uint64_t>> gone_;
};

Eigen::MatrixXf read_all(const TraversalWork& work, std::vector<int>& lost) {
  std::vector<int> frames(static_cast<std::size_t>(work.frames()));
  std::iota(frames.begin(), frames.end(), 0);
  Eigen::MatrixXf descriptors(kDimension, work.frames());
  work.read(frames, descriptors, lost);
  return descriptors;
}

void expect_all_descriptors(const World& world) {
  for (const auto& service : world.services) {
    if (!service->alive) continue;
    std::vector<int> lost;
    const Eigen::MatrixXf all = read_all(service->work, lost);
    ASSERT_TRUE(lost.empty());
    for (int frame = 0; frame < kKey.frames; ++frame) ASSERT_EQ(all.col(frame), descriptor(frame)) << frame;
  }
}

TEST(TraversalWork, MakesAgainWhatTheStoreLost) {
  const Folder folder;
  BlockDivision division(1, kHash, 100);
  const FeatureStore::Key key{"hog-1 bins=12", kDimension, kHash, 100};
  TraversalWork work(folder.path(), key, division);
  for (int frame = 0; frame < 100; ++frame) work.put(frame, descriptor(frame));
  ASSERT_TRUE(work.complete());
  std::vector<int> lost;
  read_all(work, lost);
  ASSERT_TRUE(lost.empty());
  for (const std::string& path : paths_in(folder.path())) {  // the last page of the file was not on the disk yet
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(-4, std::ios::end).write("\0\0\0\0", 4);
  }
  read_all(work, lost);
  EXPECT_EQ(lost, std::vector<int>{99});
  work.lose(lost);
  EXPECT_FALSE(work.complete());
  EXPECT_EQ(work.begin(Clock::time_point(std::chrono::hours(1))), std::vector<int>{99});
  work.put(99, descriptor(99));
  lost.clear();
  EXPECT_EQ(read_all(work, lost).col(99), descriptor(99));
  EXPECT_TRUE(lost.empty());
}

TEST(BlockDivision, EachFrameIsEncodedOnceWhileNobodyComesOrGoes) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    World world(seed, 0);
    const int count = 1 + static_cast<int>(seed % 4);
    for (int i = 0; i < count; ++i) world.add(seed * 100 + static_cast<std::uint64_t>(i));
    ASSERT_TRUE(world.finishes(10000)) << count << " services, seed " << seed;
    EXPECT_EQ(world.encoded(), kKey.frames) << count << " services, seed " << seed;
    expect_all_descriptors(world);
  }
}

TEST(BlockDivision, WhereMessagesAreLostFewBlocksAreEncodedTwice) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    World world(seed, 0.3);
    for (std::uint64_t i = 0; i < 3; ++i) world.add(seed * 100 + i);
    ASSERT_TRUE(world.finishes(60000)) << "seed " << seed;
    EXPECT_LE(world.encoded(), kKey.frames + BlockDivision::kFrames) << "seed " << seed;
    expect_all_descriptors(world);
  }
}

TEST(BlockDivision, ASlowOneIsHelped) {
  const FeatureStore::Key key{"hog-1 bins=12", kDimension, kHash, 3200};
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    World world(seed, 0);
    world.add(seed * 100 + 1, key);
    Encoding& slow = world.add(seed * 100 + 2, key);
    slow.speed = 0.05;
    // 5.8 s if both worked to the end; it has two blocks that it began, and two left to it, of 1.3 s each.
    ASSERT_TRUE(world.finishes(13000)) << "half of the frames alone would take it 32 s";
    EXPECT_EQ(world.encoded(), key.frames) << "seed " << seed;
    EXPECT_GT(slow.work.made(), 3200 / 11 / 2) << "half of its part by speed";
  }
}

TEST(BlockDivision, OneThatEncodesNothingIsNotWaitedFor) {
  World world(1, 0);
  Encoding& one = world.add(1);
  world.add(2).works = false;
  EXPECT_TRUE(world.finishes(10000));
  EXPECT_EQ(one.work.made(), kKey.frames);
}

TEST(BlockDivision, OneThatComesLateEncodesWhatNobodyHas) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    World world(seed, 0.2);
    Encoding& first = world.add(500);
    while (first.work.made() < 400) world.step();
    Encoding& second = world.add(seed % 2 ? 400 : 600);
    ASSERT_TRUE(world.finishes(60000)) << seed;
    EXPECT_LE(world.encoded(), kKey.frames + BlockDivision::kFrames) << seed;
    EXPECT_GT(second.work.made(), 100) << seed;
    EXPECT_GE(second.work.fetched(), 400) << seed;
  }
}

TEST(BlockDivision, OneThatDiesGivesItsBlocksBack) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    World world(seed, 0.1);
    Encoding& dying = world.add(1);
    world.add(2), world.add(3);
    while (dying.work.made() < 150) world.step();
    world.kill(dying, milliseconds(3000));
    ASSERT_TRUE(world.finishes(60000)) << seed;
    EXPECT_GE(world.encoded(), kKey.frames) << seed;
    // What it had not told of yet, and what it had of blocks that it had not finished.
    EXPECT_LE(world.encoded(), kKey.frames + 3 * BlockDivision::kFrames) << seed;
    expect_all_descriptors(world);
  }
}

TEST(BlockDivision, OneThatStoodStillLeavesToOthersWhatTheyTook) {
  World world(5, 0);
  Encoding& stalled = world.add(9);
  world.add(2);
  while (stalled.work.made() < 100) world.step();
  world.kill(stalled, milliseconds(3000));
  for (int i = 0; i < 4000; ++i) world.step();
  stalled.alive = true;
  world.services[1]->division.add_peer(9, "peer");
  ASSERT_TRUE(world.finishes(60000));
  EXPECT_LE(world.encoded(), kKey.frames + 3 * BlockDivision::kFrames);
  expect_all_descriptors(world);
}

TEST(BlockDivision, OthersEncodersShareNothing) {
  World world(1, 0);
  world.add(1);
  world.add(2, {"hog-1 bins=18", kDimension, kHash, kKey.frames});
  ASSERT_TRUE(world.finishes(60000));
  EXPECT_EQ(world.encoded(), 2 * kKey.frames);
}

TEST(BlockDivision, BlocksThatAPeerHasOrEncodesAreLeftToItUnlessItDoesNotSendThem) {
  BlockDivision division(1, kHash, 1000);
  division.set_encoder("hog", 3);
  division.add_peer(2, "two");
  msg::DescriptorStatus status;
  Clock::time_point now{std::chrono::hours(1)};
  const std::vector<std::uint64_t> none(16, 0);
  ASSERT_TRUE(division.fill(now, none, status));
  status.header().incarnation(2);
  status.header().message(4);
  status.encoder() = "hog";
  status.dimension(3);
  status.frames(1000);
  status.present() = none;
  status.present()[3] = 0b110;
  division.take(status, now);
  now += kEncoderSettle;  // it encodes nothing: all is for this one
  EXPECT_EQ(division.offered(division.peers().at(2), 3), 0b110u);
  const auto begins = [&](int block, std::uint64_t lacking) {
    std::vector<std::uint64_t> all(16, 0);
    all[static_cast<std::size_t>(block)] = lacking;
    const auto begun = division.begin(now, all, [](int) { return true; });
    if (begun) division.release(*begun);
    return begun == block;
  };
  EXPECT_FALSE(begins(3, 0b100));
  EXPECT_TRUE(begins(3, 0b1001)) << "it has none of these";
  division.withhold(2, 3);
  EXPECT_TRUE(begins(3, 0b100));
  // An older status changes nothing.
  status.header().message(3);
  status.encoding().push_back(5);
  division.take(status, now);
  EXPECT_TRUE(begins(5, 1));
  status.header().message(5);
  division.take(status, now);
  EXPECT_FALSE(begins(5, 1));
  division.remove_peer(2);
  EXPECT_TRUE(begins(5, 1));
}

}  // namespace
}  // namespace citylearn::testing
