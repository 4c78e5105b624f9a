// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal_server.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/support/data/fake_images.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/samples.h"

namespace citylearn::testing {
namespace {

Node::Options options(const std::string& id) { return {middleware_options("inprocess"), "test", id, "ours"}; }

/// Frame 3 fills three chunks.
class LargeImages : public FakeImages {
 public:
  using FakeImages::FakeImages;
  void read(int frame, Bytes& bytes) override {
    bytes.assign(frame == 3 ? 2 * msg::MAX_CHUNK + 1 : 1, std::byte(frame));
  }
};

class PictureRequests : public ::testing::Test {
 protected:
  PictureRequests() {
    encoder_.create_reader<msg::ImageChunk>();
    encoder_.create_reader_at<msg::ImageChunk>("dashboard");  // whatever it is sent is seen here as well
  }
  void ask(const std::vector<std::uint64_t>& frames, const std::vector<std::uint32_t>& chunks = {},
           const std::string& service = "encoder", int other = 0) {
    msg::ImageRequest request;
    request.server() = "env";
    request.hash() = environment_.traversal_hash() + static_cast<std::uint64_t>(other);
    request.items() = frames;
    request.chunks() = chunks;
    (service == "encoder" ? encoder_ : dashboard_).publish(request);
    server_.take_requests();
  }
  /// Returns the frames of the chunks that come, in their order.
  std::vector<int> sent_by(int ticks) {
    while (ticks-- > 0) server_.send_objects();
    std::vector<int> frames;
    for (msg::ImageChunk chunk; encoder_.take(chunk);) frames.push_back(static_cast<int>(chunk.item()));
    return frames;
  }
  static Traversal pictured(const std::shared_ptr<Images>& images) {
    Traversal traversal = small_traversal(images->frames());
    traversal.features.clear();
    traversal.dimension = 0;
    traversal.images = images;
    return traversal;
  }

  std::shared_ptr<LargeImages> images_ = std::make_shared<LargeImages>(6);
  const Traversal traversal_ = pictured(images_);
  Environment environment_{traversal_, 1};
  Node env_{options("env")}, encoder_{options("encoder")}, dashboard_{options("dashboard")};
  TraversalServer server_{env_, environment_};
};

using Frames = std::vector<int>;

TEST_F(PictureRequests, AreOfWhatIsAnnounced) {
  const msg::TraversalInfo info = server_.info();
  EXPECT_EQ(info.dataset(), "test");
  EXPECT_EQ(info.traversal(), "line");
  EXPECT_EQ(info.condition(), traversal_.condition);
  EXPECT_EQ(info.hash(), traversal_.hash());
  EXPECT_EQ(info.frames(), 6u);
  EXPECT_EQ(info.feature_dimension(), 0u) << "an encoder_service has to come";
  EXPECT_EQ(info.agents(), 1u);
  EXPECT_TRUE(info.images());
}

TEST_F(PictureRequests, AreAnsweredOnePictureATickAndService) {
  ask({0, 1, 2});
  ask({4}, {}, "dashboard");
  EXPECT_EQ(sent_by(1), (Frames{4, 0}));
  EXPECT_TRUE(server_.send_objects());
  EXPECT_FALSE(server_.send_objects());
  EXPECT_EQ(sent_by(0), (Frames{1, 2}));
}

TEST_F(PictureRequests, GoOnWithTheChunksThatAreMissing) {
  ask({3}, {1, 2});
  EXPECT_EQ(sent_by(2), (Frames{3, 3}));
  ask({2}, {7});
  EXPECT_EQ(sent_by(1), Frames{}) << "it has one chunk";
  ask({2}, {}, "encoder", 1);
  EXPECT_EQ(sent_by(1), Frames{}) << "another traversal was asked for";
}

TEST(TraversalServerOfStreets, AnnouncesThemInAFewBytes) {
  const Traversal traversal = streets_traversal(small_streets(), StateRule::kStreetFixed);
  const Environment environment(traversal, 16);
  Node node(options("env"));
  const msg::TraversalInfo info = TraversalServer(node, environment).info();
  EXPECT_EQ(info.rule(), msg::STREET_FIXED);
  EXPECT_EQ(info.frames(), 16 * info.places());
  EXPECT_LT(encoded(info).size(), 500u);
}

}  // namespace
}  // namespace citylearn::testing
