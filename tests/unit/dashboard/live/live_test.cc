// SPDX-License-Identifier: Apache-2.0
// The dashboard's live part: pictures and maps from a real env_service, and what goes to the hub's clients.
#include "dashboard/live/live.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <atomic>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "core/files/image_header.h"
#include "dashboard/live/json.h"
#include "env_service/images/image_sources.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/env/env.h"
#include "tests/support/env/env_service_thread.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/options.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using Readiness = LiveView::Readiness;

/// Clients that watch what the test says.
class TestHub : public Hub {
 public:
  struct Published {
    Json header;
    std::vector<std::byte> payload;
    Merge merge;
    Json json() const {
      const auto* begin = reinterpret_cast<const char*>(payload.data());
      return Json::parse(begin, begin + payload.size());
    }
    template <class T>
    std::vector<T> numbers() const {
      std::vector<T> values(payload.size() / sizeof(T));
      std::memcpy(values.data(), payload.data(), values.size() * sizeof(T));
      return values;
    }
  };
  void publish(const std::string& topic, Json header, std::vector<std::byte> payload, Merge merge) override {
    published[topic].push_back({std::move(header), std::move(payload), merge});
  }
  std::vector<std::string> watched() const override { return topics; }

  std::vector<std::string> topics;
  std::map<std::string, std::vector<Published>> published;
};

/// 40 pictures of one brightness each; the last one cannot be read.
class GreyImages : public FakeImages {
 public:
  GreyImages() : FakeImages(40) {}
  void read(int frame, Bytes& bytes) override {
    ++reads;
    if (frame == 39) throw Error("cannot be read", name(frame));
    encode_png(cv::Mat(60, 80, CV_8UC3, cv::Scalar::all(frame * 6)), bytes);
  }
  std::atomic<int> reads = 0;
};

Node::Options node_options(const std::string& id, const std::string& run, const std::string& service) {
  return {middleware_options("inprocess", 3), service, id, run};
}

class LiveTest : public ::testing::Test {
 protected:
  LiveTest() {
    spdlog::set_level(spdlog::level::off);
    node.create_reader<msg::ServiceStatus>();
    node.create_reader<msg::TraversalInfo>();
    node.create_reader<msg::RunInfo>();
    node.create_reader<msg::TrainingStat>();
  }
  void spin() {
    node.wait(std::min(live.due(), Clock::now() + milliseconds(20)));
    while (node.take(status)) live.on_message(status);
    while (node.take(traversal)) live.on_message(traversal);
    while (node.take(info)) live.on_message(info);
    while (node.take(stat)) live.on_message(stat);
    live.poll();
  }
  bool until(const std::function<bool()>& condition) {
    return eventually([this] { spin(); }, condition);
  }
  /// Newest message of a topic.
  const TestHub::Published& newest(const std::string& topic) { return hub.published.at(topic).back(); }
  std::size_t count(const std::string& topic) { return hub.published[topic].size(); }
  Json service(const std::string& id) {
    const Json all = live.services();
    for (const Json& one : all["services"])
      if (one["id"] == id && one["session"].get<std::string>().find(std::to_string(getpid())) != std::string::npos)
        return one;
    return {};
  }

  const std::string run = "live-" + std::to_string(getpid());
  TestHub hub;
  Node node{node_options("dashboard", "", "dashboard")};  // of all runs
  Live live{node, hub};
  msg::ServiceStatus status;
  msg::TraversalInfo traversal;
  msg::RunInfo info;
  msg::TrainingStat stat;
};

/// An env_service on pictures, and one who drives it.
class LiveRun : public LiveTest {
 protected:
  LiveRun() : images(std::make_shared<GreyImages>()) {
    street.dataset = "test";
    street.name = "street";
    street.frames = 40;
    street.images = images;
    for (int i = 0; i < 40; ++i) {
      street.positions.push_back(i == 3 ? std::numeric_limits<float>::quiet_NaN() : 2.5f * static_cast<float>(i));
      street.latitude.push_back(-27 + 1e-4 * i);
      street.longitude.push_back(153);
    }
    EnvServiceOptions options;
    options.agents = 2;
    options.node = node_options("", run, "");
    env = std::make_unique<EnvServiceThread>(options, street);
  }
  /// Steps on the way: the policy and the dashboard turn by turn.
  bool drive(const std::function<bool()>& condition) {
    if (!policy) {
      policy = std::make_unique<ScriptedPolicy>(node_options("", "", "").middleware, run, "env-street");
      policy->walker = &walker;
      msg::TaskSettings with = settings(msg::TRAIN, 30, 30);
      with.first_frame() = 5;
      with.policy() = "blind";
      policy->command(with);
    }
    return eventually(
        [&] {
          policy->spin();
          spin();
        },
        condition);
  }
  const std::string source = "env-street@" + run;
  std::shared_ptr<GreyImages> images;
  Traversal street;
  std::unique_ptr<EnvServiceThread> env;
  BlindSweep walker{30};
  std::unique_ptr<ScriptedPolicy> policy;
};

TEST_F(LiveTest, HearsServicesOfAllRunsAndTellsWhoWatches) {
  auto one = std::make_unique<Node>(node_options("env", run + "-a", "env_service"));
  Node two(node_options("policy", run + "-b", "policy_service"));
  hub.topics = {"services"};
  const auto beat = [&] {
    if (one) one->wait(Clock::now());
    two.wait(Clock::now());
    return true;
  };
  ASSERT_TRUE(until([&] { return beat() && !service("env").is_null() && !service("policy").is_null(); }));
  EXPECT_EQ(service("env")["session"], run + "-a");
  ASSERT_TRUE(until([&] { return beat() && count("services") > 0; }));
  EXPECT_EQ(newest("services").merge, Hub::Merge::kReplace);
  EXPECT_TRUE(newest("services").json()["services"].is_array());
  EXPECT_GT(count("events"), 0u);
  // One dies. The other one goes on.
  const Clock::time_point died = Clock::now();
  one.reset();
  ASSERT_TRUE(until([&] { return beat() && service("env")["state"] == "lost"; }));
  EXPECT_LT(Clock::now() - died, (kSilence + milliseconds(500)) * kSlowness);
  EXPECT_NE(service("policy")["state"], "lost");
  EXPECT_EQ(newest("events").json()["kind"], "lost");
  EXPECT_EQ(newest("events").json()["service"], "env");
  EXPECT_EQ(newest("events").merge, Hub::Merge::kEach);
  EXPECT_EQ(live.events(1)[0], newest("events").json());
  one = std::make_unique<Node>(node_options("env", run + "-a", "env_service"));
  ASSERT_TRUE(until([&] { return beat() && service("env")["state"] == "starting"; }));
  EXPECT_EQ(newest("events").json()["kind"], "restarted");
  const double seconds_since = std::chrono::duration<double>(Clock::now() - died).count();
  EXPECT_LE(static_cast<double>(count("services")), 4 * (seconds_since + 25)) << "no more than four times a second";
}

TEST_F(LiveTest, EventsGoToWhoTakesThemAndAreKeptWhereNobodyDoes) {
  std::vector<std::string> taken;
  bool disk_full = false;
  live.on_event = [&](const Event& event) {
    if (disk_full) throw Error("no space left");
    taken.push_back(event.service);
  };
  const auto start = [&](const std::string& id) {
    sign(status.header(), id, 9, 1, run);
    status.service_state() = msg::RUNNING;
    live.on_message(status);
  };
  start("first");
  EXPECT_EQ(taken, std::vector<std::string>{"first"});
  EXPECT_TRUE(live.events(10).empty());
  disk_full = true;
  start("second");
  start("third");
  ASSERT_EQ(live.events(10).size(), 2u);
  EXPECT_EQ(live.events(10)[0]["service"], "third") << "newest first";
  EXPECT_EQ(live.events(1).size(), 1u);
  EXPECT_EQ(count("events"), 3u) << "whoever watches hears of them anyway";
}

TEST_F(LiveTest, TrainingGoesToWhoWatchesThatRun) {
  Node policy(node_options("policy", run, "policy_service"));
  const auto tell = [&](std::uint64_t job, std::uint64_t update) {
    msg::TrainingStat one;
    one.log() = log_position(update, job);
    one.update() = update;
    one.steps() = update * 512;
    one.reward() = std::numeric_limits<float>::quiet_NaN();
    one.policy_lag() = 1.5f;
    policy.publish(one);
  };
  msg::RunInfo about;
  about.run_id() = 77;
  about.seed() = 3;
  policy.publish(about);
  const std::string topic = "training:" + run + "/policy/3/77";
  tell(77, 1);
  ASSERT_TRUE(until([&] { return stat.log().number() == 1; }));
  hub.topics = {topic};
  const Clock::time_point watched = Clock::now();
  ASSERT_TRUE(until([&] { return Clock::now() > watched + milliseconds(150); })) << "until it knows who watches";
  EXPECT_EQ(count(topic), 0u) << "what came before is asked for over the API";
  for (std::uint64_t update = 2; update <= 40; ++update) tell(77, update);
  tell(78, 2);
  std::size_t rows = 0;
  ASSERT_TRUE(until([&] {
    rows = 0;
    for (const auto& message : hub.published[topic]) rows += message.header["rows"].get<std::size_t>();
    return rows >= 39;
  }));
  EXPECT_EQ(rows, 39u);
  EXPECT_LE(count(topic), 4u) << "rows that come together go together";
  EXPECT_EQ(newest(topic).merge, Hub::Merge::kAppend);
  const auto columns = newest(topic).header["columns"].get<std::vector<std::string>>();
  EXPECT_EQ(columns.front(), "update");
  EXPECT_EQ(columns.back(), "policy_lag");
  const auto values = newest(topic).numbers<double>();
  ASSERT_EQ(values.size(), newest(topic).header["rows"].get<std::size_t>() * columns.size());
  const double* last = values.data() + values.size() - columns.size();
  EXPECT_EQ(last[0], 40);
  EXPECT_EQ(last[1], 40 * 512);
  EXPECT_TRUE(std::isnan(last[6]));
  EXPECT_EQ(last[columns.size() - 1], 1.5);
}

TEST_F(LiveRun, ScenesComeWhileSomebodyWatches) {
  ASSERT_TRUE(drive([&] { return policy->steps() > 20; }));
  const std::string topic = "scene:" + source;
  EXPECT_EQ(hub.published.count(topic), 0u);
  EXPECT_FALSE(policy->seen.wants_belief());
  hub.topics = {topic,     "picture:", "picture:nobody", "picture:" + source + ":99", "picture:" + source + ":x",
                "nonsense"};
  ASSERT_TRUE(drive([&] { return count(topic) >= 5; }));
  const auto& scene = newest(topic);
  EXPECT_EQ(scene.merge, Hub::Merge::kReplace);
  EXPECT_EQ(scene.header["traversal"], "street");
  EXPECT_EQ(scene.header["first_frame"], 5);
  EXPECT_EQ(scene.header["frames"], 30);
  EXPECT_EQ(scene.header["mode"], "train");
  EXPECT_EQ(scene.header["policy"], "blind");
  EXPECT_EQ(scene.header["hash"].get<std::string>().size(), 16u);
  EXPECT_EQ(scene.header["agents"], 2);
  const auto numbers = scene.numbers<std::uint32_t>();
  ASSERT_EQ(numbers.size(), 12u);
  for (int agent = 0; agent < 2; ++agent) {
    EXPECT_TRUE(numbers[static_cast<std::size_t>(2 + agent)] >= 5 && numbers[static_cast<std::size_t>(2 + agent)] < 35);
    EXPECT_NE(numbers[static_cast<std::size_t>(2 + agent)], numbers[static_cast<std::size_t>(6 + agent)])
        << "position and goal";
  }
  EXPECT_EQ(images->reads, 0) << "nobody watches a picture";
  // Beliefs come along, of a policy that has some.
  EXPECT_EQ(scene.header["likely"], 0);
  EXPECT_TRUE(policy->seen.wants_belief());
  std::vector<std::uint32_t> likely;
  for (std::uint32_t i = 0; i < 16; ++i) likely.push_back(5 + i);
  policy->spoil = [&](msg::Action& action) {
    action.belief().likely() = likely;
    action.belief().probability().assign(16, 0.125f);
    action.belief().entropy() = {3, 2.5f};
    action.belief().lost() = {0.625f, 0.25f};
  };
  ASSERT_TRUE(drive([&] { return newest(topic).header["likely"] == 8; }));
  const auto believed = newest(topic).numbers<std::uint32_t>();
  ASSERT_EQ(believed.size(), 12u + 16 + 16 + 2 + 2);
  EXPECT_EQ(std::vector(believed.begin() + 12, believed.begin() + 28), likely);
  const auto shares = newest(topic).numbers<float>();
  EXPECT_EQ(std::vector(shares.begin() + 43, shares.end()), (std::vector{0.125f, 3.0f, 2.5f, 0.625f, 0.25f}));
  hub.topics = {};
  ASSERT_TRUE(drive([&] { return policy->node.readers<msg::Scene>() == 0; })) << "nothing is sent any more";
  ASSERT_TRUE(drive([&] { return !policy->seen.wants_belief(); })) << "nor asked for";
}

TEST_F(LiveRun, PicturesShowWhatAnAgentSees) {
  const std::string topic = "picture:" + source + ":1";
  hub.topics = {topic, "scene:" + source};
  ASSERT_TRUE(drive([&] { return count(topic) >= 4; }));
  for (const auto& message : hub.published[topic]) {
    EXPECT_EQ(message.merge, Hub::Merge::kReplace);
    EXPECT_EQ(message.header["type"], "image/png");
    const auto frame = message.header["frame"].get<int>();
    const auto* bytes = reinterpret_cast<const uchar*>(message.payload.data());
    const cv::Mat picture = cv::imdecode(std::vector<uchar>(bytes, bytes + message.payload.size()), cv::IMREAD_COLOR);
    EXPECT_EQ(picture.at<cv::Vec3b>(30, 40)[0], frame * 6) << "the very frame";
  }
  // When it stands still, what is shown is what it sees.
  policy->walker = nullptr;
  const auto& scenes = hub.published["scene:" + source];
  std::size_t seen = 0;
  Clock::time_point last = Clock::now();  // scene; the agent's last step may not be in one yet
  ASSERT_TRUE(drive([&] {
    if (std::exchange(seen, scenes.size()) != scenes.size()) last = Clock::now();
    return seen > 0 && Clock::now() > last + milliseconds(300) &&
           newest(topic).header["frame"] == scenes.back().numbers<std::uint32_t>()[1];
  }));
  const int reads = images->reads;
  const std::size_t shown = count(topic);
  const Clock::time_point since = Clock::now();
  ASSERT_TRUE(drive([&] { return Clock::now() > since + milliseconds(300); }));
  EXPECT_EQ(images->reads, reads);
  EXPECT_EQ(count(topic), shown) << "it sees the same";
}

TEST_F(LiveRun, TheApiGetsPicturesAndMapsByHash) {
  const std::uint64_t hash = street.hash();
  EXPECT_EQ(live.frame(hash, 7).readiness, Readiness::kNone) << "nobody is known to have it";
  EXPECT_EQ(live.map(hash).readiness, Readiness::kNone);
  ASSERT_TRUE(until([&] { return live.frame(hash, 7).readiness != Readiness::kNone; }));
  ASSERT_TRUE(until([&] { return live.frame(hash, 7).readiness == Readiness::kHere; }));
  const Json hosted = live.traversals(run);
  ASSERT_EQ(hosted.size(), 1u);
  EXPECT_EQ(hosted[0]["environment"], "env-street");
  EXPECT_EQ(hosted[0]["traversal"], "street");
  EXPECT_EQ(hosted[0]["hash"], fmt::format("{:016x}", hash));
  EXPECT_EQ(hosted[0]["agents"], 2);
  EXPECT_EQ(hosted[0]["images"], true);
  EXPECT_EQ(live.traversals("another run"), Json::array());
  const LiveView::Picture picture = live.frame(hash, 7);
  EXPECT_EQ(picture.type, "image/png");
  EXPECT_EQ(read_image_header(std::as_bytes(std::span(picture.bytes)), "picture").width, 80);
  EXPECT_EQ(images->reads, 1);
  EXPECT_EQ(live.frame(hash, 40).readiness, Readiness::kNone) << "beyond the last frame";
  EXPECT_EQ(live.frame(hash + 1, 7).readiness, Readiness::kNone);
  EXPECT_EQ(live.frame(hash, 39).readiness, Readiness::kComing);
  ASSERT_TRUE(until([&] { return live.frame(hash, 39).readiness != Readiness::kComing; }));
  EXPECT_EQ(live.frame(hash, 39).readiness, Readiness::kNone) << "it cannot be read";
  EXPECT_EQ(live.map(hash).readiness, Readiness::kComing);
  ASSERT_TRUE(until([&] { return live.map(hash).readiness == Readiness::kHere; }));
  const Json map = map_json(hash, *live.map(hash).map, {});
  EXPECT_EQ(map["frames"], 40);
  ASSERT_EQ(map["position"].size(), 40u);
  EXPECT_TRUE(map["position"][3].is_null());
  EXPECT_EQ(map["position"][4], 10.0);
  EXPECT_NEAR(map["latitude"][10].get<double>(), -26.999, 1e-9);
  EXPECT_EQ(map["longitude"].size(), 40u);
}

TEST_F(LiveTest, MapsOfStreetsCome) {
  const Traversal city = streets_traversal();
  EnvServiceOptions options;
  options.node = node_options("", run, "");
  const EnvServiceThread env(options, city);
  const std::uint64_t hash = city.hash();
  ASSERT_TRUE(until([&] { return live.map(hash).readiness == Readiness::kHere; }));
  const RouteMap& map = *live.map(hash).map;
  EXPECT_EQ(map.frames, 13u);
  EXPECT_EQ(map.rule, StateRule::kStreet);
  EXPECT_EQ(map.streets->to, city.streets->to);
  EXPECT_EQ(live.traversals(run)[0]["streets"], true);
}

TEST(Outline, KeepsCornersAndDeadEndsOfALongRoute) {
  // East, with a spike to the north at frame 537, and 80 frames on out and back within one of 10 pieces.
  RouteMap map{1001, std::vector<float>(1001), std::vector<double>(1001, 48), std::vector<double>(1001)};
  for (int i = 0; i < 1001; ++i) map.longitude[i] = 1e-5 * i;
  map.latitude[537] = 48.01;
  for (int i = 0; i < 40; ++i) map.longitude[810 + i] = map.longitude[890 - i] = 1e-5 * (810 + 3 * i);
  map.longitude[850] = 0.01;
  std::vector<std::uint32_t> frames = outline(map, {.points = 11});
  ASSERT_EQ(frames.size(), 11u);
  EXPECT_EQ(frames.front(), 0u);
  EXPECT_EQ(frames[5], 537u);
  EXPECT_EQ(frames[8], 850u);
  EXPECT_EQ(frames.back(), 1000u);
  EXPECT_TRUE(std::is_sorted(frames.begin(), frames.end()));
  EXPECT_EQ(outline(map, {.first = 530, .last = 540}).size(), 11u) << "all of them";
  EXPECT_EQ(outline(map, {.first = 7, .last = 7}), std::vector<std::uint32_t>{7});
  for (int i = 500; i < 600; ++i) map.latitude[i] = std::nan("");
  frames = outline(map, {.points = 11});
  EXPECT_TRUE(std::isnan(map.latitude[frames[5]])) << "a gap stays one";
  map.longitude.clear();  // nobody should send that
  EXPECT_EQ(outline(map, {.points = 3}), (std::vector<std::uint32_t>{0, 500, 1000}));
}

TEST_F(LiveRun, ManyFramesAskedForAtOnceAllCome) {
  const std::uint64_t hash = street.hash();
  const auto all = [&](Readiness wanted) {
    bool every = true;
    for (std::uint32_t frame = 0; frame < 39; ++frame) every = live.frame(hash, frame).readiness == wanted && every;
    return every;
  };
  ASSERT_TRUE(until([&] { return live.frame(hash, 0).readiness != Readiness::kNone; }));
  ASSERT_TRUE(until([&] { return all(Readiness::kHere); }));
  EXPECT_EQ(images->reads, 39) << "each once";
}

TEST_F(LiveRun, APauseFollowsAPictureThatNobodyWaitsFor) {
  const std::uint64_t hash = street.hash();
  Node own(node_options("other", run, "dashboard"));
  Pictures::Options options;
  options.spare_pause = 1'000'000;
  Pictures pictures(own, options);
  const Pictures::Source host{run, "env-street"};
  ASSERT_TRUE(pictures.fetch_spare({hash, 3}, host, false));
  EXPECT_FALSE(pictures.fetch_spare({hash, 4}, host, true)) << "one at a time";
  const auto here = [&](std::uint32_t frame) {
    return eventually(
        [&] {
          own.wait(Clock::now() + milliseconds(5));
          pictures.poll(Clock::now());
        },
        [&] {
          return pictures.find({hash, frame}) != nullptr;
        });
  };
  ASSERT_TRUE(here(3));
  EXPECT_FALSE(pictures.fetch_spare({hash, 4}, host, true)) << "the pause";
  pictures.fetch({hash, 5}, host);
  EXPECT_TRUE(here(5)) << "somebody waits for it";
}

TEST_F(LiveRun, WhoLooksGoesBeforeWhatIsStored) {
  const std::uint64_t hash = street.hash();
  ASSERT_TRUE(until([&] { return !live.hosted().empty(); }));
  ASSERT_EQ(live.hosted()[0].hash, hash);
  EXPECT_EQ(live.frame(hash, 1).readiness, Readiness::kComing);
  EXPECT_EQ(live.frame(hash, 2).readiness, Readiness::kComing);
  spin();
  EXPECT_FALSE(live.spare_picture({hash, 3}).coming) << "others are fetched";
  ASSERT_TRUE(until([&] {
    return live.frame(hash, 1).readiness == Readiness::kHere && live.frame(hash, 2).readiness == Readiness::kHere;
  }));
  ASSERT_TRUE(until([&] { return live.spare_picture({hash, 3}).coming; }));
  ASSERT_TRUE(until([&] { return live.spare_picture({hash, 3}).picture != nullptr; }));
  EXPECT_FALSE(live.spare_picture({hash + 1, 3}).coming) << "nobody has it";
}

}  // namespace
}  // namespace citylearn::testing
