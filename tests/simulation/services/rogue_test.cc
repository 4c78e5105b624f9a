// SPDX-License-Identifier: Apache-2.0
// A rogue participant sends each type of message with each field at its extremes, in its own name and in those of
// others, into a running training. The training goes on, ends as it would have, and loses no episode.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "core/wire/cdr.h"
#include "tests/support/processes/every_topic.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/ledger.h"
#include "tests/support/records/samples.h"

namespace citylearn::testing {
namespace {

constexpr milliseconds kPace{1};  // between two messages, so that readers are not merely flooded

/// Sets one field of a message to one of its extremes, both by number. The names stay empty where there is none.
class Extreme {
 public:
  Extreme(int which_field, int which) : fields_left_(which_field), which_(which) {}
  std::string field, value;

  template <class Number>
  void operator()(const char* name, Number& number) {
    if (here(name)) set(number);
  }
  template <std::size_t N>
  void operator()(const char* name, FixedString<N>& text) {
    if (here(name))
      choose(text, Choices<std::string>{{"empty", ""},
                                        {"longest", std::string(N, 'x')},
                                        {"another", "rogue"},
                                        {"unprintable", "\x1b[31m\n\"<img src=x onerror=alert(1)>,\xff"}});
  }
  template <class T>
  void operator()(const char* name, std::vector<T>& sequence, std::size_t bound) {
    if (!here(name)) return;
    const std::size_t size = sequence.size();
    const Choices<std::size_t> sizes = {{"empty", 0},
                                        {"one-less", size - (size > 0)},
                                        {"one-more", size + 1},
                                        {"longest", bound},
                                        {"too-long", bound + 1}};
    if (const auto at = static_cast<std::size_t>(which_); at < sizes.size()) {
      value = sizes[at].first;
      sequence.resize(sizes[at].second);
    } else if (size > 0) {
      which_ -= static_cast<int>(sizes.size());
      set(sequence[size / 2]);
    }
  }
  template <class Enum>
  void enumerator(const char* name, Enum& number, Enum last) {
    if (here(name))
      choose(number, Choices<Enum>{{"first", Enum{}},
                                   {"last", last},
                                   {"unknown", static_cast<Enum>(last + 1u)},
                                   {"largest", static_cast<Enum>(~0u)}});
  }
  void protocol(const char* name, std::uint32_t& number) { (*this)(name, number); }
  template <class Message>
  void nested(const char* name, Message& message) {
    prefix_ = std::string(name) + ".";
    visit(message, *this);
    prefix_.clear();
  }

 private:
  bool here(const char* name) {
    if (fields_left_-- != 0) return false;
    field = prefix_ + name;
    return true;
  }
  template <class Value>
  using Choices = std::vector<std::pair<const char*, Value>>;
  template <class Value, class Other>
  void choose(Value& to, const Choices<Other>& values) {
    if (static_cast<std::size_t>(which_) >= values.size()) return;
    value = values[static_cast<std::size_t>(which_)].first;
    to = values[static_cast<std::size_t>(which_)].second;
  }
  void set(bool& flag) { choose(flag, Choices<bool>{{"the-other", !flag}}); }
  template <class Number>
  void set(Number& number) {
    using Limits = std::numeric_limits<Number>;
    Choices<Number> values = {{"0", Number{}},
                              {"1", Number{1}},
                              {"largest", Limits::max()},
                              {"smallest", Limits::lowest()},
                              {"one-more", static_cast<Number>(number + 1)},
                              {"one-less", static_cast<Number>(number - 1)}};
    if constexpr (std::is_floating_point_v<Number>) {
      values.emplace_back("NaN", Limits::quiet_NaN());
      values.emplace_back("infinite", Limits::infinity());
    }
    choose(number, values);
  }

  int fields_left_, which_;
  std::string prefix_;
};

/// Gives a message that nobody sends here the addresses and names of this run.
struct Address {
  std::map<std::string, std::string> texts;
  std::map<std::string, std::uint64_t> numbers;

  void operator()(const char* name, auto& value, auto...) {
    using Value = std::remove_reference_t<decltype(value)>;
    if constexpr (std::is_arithmetic_v<Value>) {
      if (const auto known = numbers.find(name); known != numbers.end()) value = static_cast<Value>(known->second);
    } else if constexpr (std::is_assignable_v<Value&, std::string>) {
      if (const auto known = texts.find(name); known != texts.end()) value = known->second;
    }
  }
  void enumerator(const char*, auto&, auto) {}
  void protocol(const char*, std::uint32_t&) {}
  void nested(const char*, auto& message) { visit(message, *this); }
};

/// The bytes of a message, whatever its fields are.
template <class Message>
Bytes bytes_of(const Message& message) {
  Bytes bytes;
  CdrWriter writer(bytes);
  visit(message, writer);
  return bytes;
}

/// Hears all that others send, and sends bytes of every topic.
class Rogue {
 public:
  explicit Rogue(const MiddlewareOptions& options) : middleware_(create_middleware(options)), topics_(*middleware_) {}

  std::map<std::string, msg::ServiceStatus> status;  ///< by id, since it was cleared

  bool until(const std::function<bool()>& condition, milliseconds patience) {
    return eventually([this] { listen(milliseconds(20)); }, condition, patience);
  }
  /// Returns the newest message of a type, or nothing.
  template <class Message>
  std::optional<Message> newest() const {
    const auto heard = heard_.find(topic_of<Message>().name);
    if (heard == heard_.end()) return std::nullopt;
    Message message;
    decode(std::span<const std::byte>(heard->second), message);
    return message;
  }
  void listen(milliseconds time) {
    const Clock::time_point deadline = Clock::now() + time;
    do {
      topics_.take([this](const Topic& topic, const Bytes& bytes) {
        if (!sent_.contains(hash(bytes))) hear(topic, bytes);
      });
      middleware_->wait(deadline);
    } while (Clock::now() < deadline);
  }
  /// Returns false for what the middleware does not send: more than the topic's largest.
  bool send(const std::vector<Topic>& to, const Bytes& bytes) {
    if (bytes.size() > to.front().largest) return false;
    sent_.insert(hash(bytes));
    for (const Topic& one : to) topics_.send(one, bytes);
    listen(kPace);
    return true;
  }

 private:
  static std::size_t hash(const Bytes& bytes) {
    return std::hash<std::string_view>()({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  void hear(const Topic& topic, const Bytes& bytes) {
    heard_[topic.name] = bytes;
    if (topic.name != topic_of<msg::ServiceStatus>().name) return;
    const auto heard = newest<msg::ServiceStatus>();
    status[heard->header().sender().c_str()] = *heard;
  }

  std::unique_ptr<Middleware> middleware_;
  EveryTopic topics_;
  std::map<std::string, Bytes> heard_;  // by topic of all
  std::set<std::size_t> sent_;
};

/// If the parameter is true, a learner and an actor take part instead of one policy_service.
class Training : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    services_["env-summer"] = trial_.env("summer");
    services_["env-winter"] = trial_.env("winter");
    services_["dashboard"] = trial_.start_recorder(store());
    services_["encoder"] = trial_.encoder({"--encoder", "hog"});
    Arguments options = split(
        "--agent place_filter --learner relabel --relabel-learning-rate 0.0003 --steps 1000000000 "
        "--checkpoint-every 20 --tasks 100 --evaluate summer,winter",
        ' ');
    options.insert(options.end(), {"--output", out(), "--time-limit", std::to_string(kSeconds * kSlowness)});
    if (GetParam()) {
      options.insert(options.end(), {"--role", "learner"});
      services_["actor"] = trial_.policy({"--role", "actor", "--id", "actor"});
    }
    services_["policy"] = trial_.policy(options);
    ASSERT_TRUE(rogue_.until([&] { return rogue_.status.size() == services_.size() && updates() >= 3; }, kLongWait))
        << services_["policy"]->output();
    ASSERT_TRUE(rogue_.until([&] { return rogue_.newest<msg::TraversalInfo>().has_value(); }, kLongWait));
  }

  std::string store() const { return trial_.folder() / "dashboard.sqlite"; }
  std::string out() const { return trial_.folder() / "out"; }
  std::size_t updates() const {
    return std::filesystem::exists(out() + "/metrics.csv") ? csv_rows(out() + "/metrics.csv").size() : 0;
  }

  /// A message of this type to forge: the newest that was heard, else one made up.
  template <class Message>
  Message example() {
    if (auto heard = rogue_.newest<Message>()) {
      // A forged episode that comes before the real one stands in its place (decision 14).
      if constexpr (std::is_same_v<Message, msg::EpisodeStat>) rogue_.listen(milliseconds(10));
      heard->header().message() += 1;
      return *heard;
    }
    Message message = sample_of<Message>(Size::kTypical);
    const auto info = *rogue_.newest<msg::TraversalInfo>();
    Address address;
    address.texts = {{"environment", info.header().sender().c_str()},
                     {"traversal", info.traversal().c_str()},
                     {"learner", "policy"},
                     {"policy", "policy"},
                     {"actor", "actor"},
                     {"server", info.header().sender().c_str()},
                     {"writer", info.header().sender().c_str()},
                     {"receiver", "policy"}};
    address.numbers = {{"hash", info.hash()},
                       {"traversal_hash", info.hash()},
                       {"environment_incarnation", info.header().incarnation()},
                       {"writer_incarnation", info.header().incarnation()}};
    visit(message, address);
    message.header() = info.header();
    return message;
  }
  void forge(int identity, msg::Header& header) const {
    if (identity == 1) header.incarnation() += 1;
    if (identity == 2) header.sender() = "rogue", header.incarnation() = 77;
    if (identity == 3) {
      const msg::Header& other = services_met_.at(header.sender() == "policy" ? "env-summer" : "policy").header();
      header.sender() = other.sender();
      header.incarnation() = other.incarnation();
    }
    if (identity == 4) header.sender() = "", header.incarnation() = 0;
  }

  /// Sends a type in all its forms. Then the training goes on and every service is well.
  template <class Message>
  void attack() {
    static constexpr const char* kIdentities[] = {"as-heard", "another-process", "its-own", "another-service",
                                                  "nobody"};
    const Topic& topic = topic_of<Message>();
    const std::string type = topic.name.substr(topic.name.find('/') + 1);
    const bool heard = rogue_.newest<Message>().has_value();
    const auto before = services_met_;
    int fields = 0, cases = 0, unsent = 0;
    for (bool more = true; more; fields += more) {
      for (int extreme = 0;; ++extreme) {
        std::string name;
        for (int identity = 0; identity < 5; ++identity) {
          Message message = example<Message>();
          const std::vector<Topic> to = topics_of(topic, bytes_of(message));  // where it is heard
          forge(identity, message.header());
          Extreme change(fields, extreme);
          visit(message, change);
          more = !change.field.empty();
          name = change.value;
          if (name.empty()) break;
          const Bytes bytes = bytes_of(message);
          if (const char* corpus = std::getenv("CITYLEARN_ROGUE_CORPUS"))
            make_file(std::string(corpus) + "/message_" + type + "/" + change.field + "-" + name + "-" +
                          kIdentities[identity],
                      {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
          rogue_.send(to, bytes) ? ++cases : ++unsent;
        }
        if (name.empty()) break;
      }
    }
    const Clock::time_point since = Clock::now();
    const std::size_t learned = updates();
    rogue_.status.clear();
    EXPECT_TRUE(rogue_.until([&] { return updates() >= learned + 2; }, kShortWait))
        << "after " << type << ": it stands still";
    const double stood = seconds_since(since);
    EXPECT_TRUE(rogue_.until([&] { return all_well(); }, kShortWait)) << "after " << type;
    std::uint64_t rejected = 0, repeated = 0, foreign = 0;
    for (const auto& [id, service] : services_) {
      rejected += services_met_[id].rejected() - before.at(id).rejected();
      repeated += services_met_[id].repeated() - before.at(id).repeated();
      foreign += services_met_[id].foreign() - before.at(id).foreign();
      EXPECT_FALSE(service->wait(milliseconds(0)).has_value()) << "after " << type << ": " << id << " ended\n"
                                                               << service->output();
    }
    const std::string row = fmt::format(
        "{} ({}): {} fields, {} cases, {} too large to send; {} rejected, {} repeated, {} foreign; {:.1f} s to go on",
        type, heard ? "heard" : "made up", fields, cases, unsent, rejected, repeated, foreign, stood);
    RecordProperty(type, row);
    std::printf("%s\n", row.c_str());
    std::fflush(stdout);
  }
  bool all_well() {
    for (const auto& [id, service] : services_) {
      const auto heard = rogue_.status.find(id);
      if (heard == rogue_.status.end() || heard->second.service_state() == msg::FAILED) return false;
      services_met_[id] = heard->second;
    }
    return true;
  }

  static constexpr int kSeconds = 65;  // of training: the rogue needs 50
  Trial trial_{"simulated"};
  std::map<std::string, std::unique_ptr<Service>> services_;  // by id
  std::map<std::string, msg::ServiceStatus> services_met_;
  Rogue rogue_{trial_.middleware()};
};

TEST_P(Training, GoesOnBesideARogue) {
  ASSERT_TRUE(rogue_.until([&] { return all_well(); }, kShortWait));
  for_each_message([&]<class Message>() {
    if (!HasFailure()) attack<Message>();
  });
  if (HasFailure())
    for (const auto& [id, service] : services_) ADD_FAILURE() << "== " << id << "\n" << service->output();
  ASSERT_FALSE(HasFailure());
  Service& policy = *services_["policy"];
  ASSERT_TRUE(rogue_.until([&] { return policy.wait(milliseconds(0)).has_value(); }, kLongWait)) << policy.output();
  EXPECT_EQ(policy.wait(kShortWait), 0) << policy.output();
  if (GetParam()) {
    EXPECT_EQ(services_["actor"]->wait(kShortWait), 0) << services_["actor"]->output();
  }
  const auto scores = nlohmann::json::parse(contents(out() + "/summary.json"))["evaluate"];
  for (const char* traversal : {"summer", "winter"}) EXPECT_GE(scores[traversal]["spl"], 0.9) << traversal;
  Ledger counted;
  for (const char* id : {"env-summer", "env-winter"}) {
    ASSERT_EQ(services_[id]->end(SIGTERM, kShortWait), 0) << services_[id]->output();
    const std::string said = services_[id]->output();
    const auto count = std::stoull(said.substr(said.find("stops: ") + 7));
    for (std::uint64_t episode = 1; episode <= count; ++episode)
      counted[{id, services_met_[id].header().incarnation()}].insert(episode);
  }
  for (const char* id : {"dashboard", "encoder"})
    EXPECT_EQ(services_[id]->end(SIGTERM, kShortWait), 0) << services_[id]->output();
  const Ledger recorded = in_store(store()), learned = in_csv(out() + "/episodes.csv");
  for (const auto& [source, episodes] : counted) {
    const auto& stored = recorded.at(source);
    EXPECT_TRUE(std::includes(stored.begin(), stored.end(), episodes.begin(), episodes.end())) << source.id;
    EXPECT_EQ(learned.at(source), episodes) << source.id;
    std::printf("%s: %zu episodes, %zu in the store, %zu in episodes.csv\n", source.id.c_str(), episodes.size(),
                stored.size(), learned.at(source).size());
  }
}

INSTANTIATE_TEST_SUITE_P(, Training, ::testing::Bool(),
                         [](const auto& roles) { return roles.param ? "Roles" : "Both"; });

}  // namespace
}  // namespace citylearn::testing
