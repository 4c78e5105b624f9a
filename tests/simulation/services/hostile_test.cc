// SPDX-License-Identifier: Apache-2.0
// Messages that are not to be believed: each is dropped and counted, and training goes on.
#include <gtest/gtest.h>

#include <limits>
#include <optional>

#include "tests/support/processes/every_topic.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr seconds kTrainingWait{60};
constexpr int kTimes = 5;  // each message, at least
const float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinite = std::numeric_limits<float>::infinity();

/// A process that sends any message, in the name of any service.
class Stranger {
 public:
  explicit Stranger(const MiddlewareOptions& middleware)
      : node({middleware, "stranger", "stranger", "default"}), raw_(create_middleware([&] {
          MiddlewareOptions raw = middleware;
          raw.participant = "raw";
          return raw;
        }())) {}

  Node node;

  /// The next message of that kind for which `wanted` is true, from any service to any other.
  template <class Message>
  Message hear(const std::function<bool(const Message&)>& wanted = [](const Message&) { return true; }) {
    std::optional<Message> found;
    const auto heard = [&] {
      topics_.take([&](const Topic& topic, const Bytes& bytes) {
        if (found || base_topic(topic.name) != topic_of<Message>().name) return;
        Message message;
        decode(std::span<const std::byte>(bytes), message);
        if (wanted(message)) found = message;
      });
      return found.has_value();
    };
    EXPECT_TRUE(eventually([this] { raw_->wait(Clock::now() + milliseconds(20)); }, heard, kTrainingWait))
        << "nothing of " << topic_of<Message>().type << " was heard";
    return found.value_or(Message());
  }
  /// Forgets what has come.
  void forget() {
    topics_.take([](const Topic&, const Bytes&) {});
  }
  /// Publishes a message as it is, header included, where messages of this run are heard.
  template <class Message>
  void say(const Message& message) {
    say<Message>(message, [](Bytes&) {});
  }
  /// Publishes its bytes as `change` leaves them.
  template <class Message>
  void say(const Message& message, const std::function<void(Bytes&)>& change) {
    Message of_run = message;
    of_run.header().session() = node.options().session.c_str();
    Bytes bytes;
    encode(message, bytes);
    change(bytes);
    const Topic& all = topic_of<Message>();
    for (const auto& [session, id] : addresses_of(of_run))
      topics_.send(id.empty() ? all : topic_at(all, session, id), bytes);
  }

 private:
  std::unique_ptr<Middleware> raw_;
  EveryTopic topics_{*raw_};
};

/// Puts an unknown value where two messages that differ in an enumerator alone differ.
template <class Message>
std::function<void(Bytes&)> unknown_enumerator(const Message& one, const Message& other) {
  Bytes a, b;
  encode(one, a);
  encode(other, b);
  for (std::size_t at = 0; at < a.size(); ++at)
    if (a[at] != b[at]) return [at](Bytes& bytes) { bytes[at] = std::byte{200}; };
  ADD_FAILURE() << "they are the same";
  return [](Bytes&) {};
}

class Hostile : public ::testing::Test {
 protected:
  using Count = std::uint64_t (*)(const msg::ServiceStatus&);
  static std::uint64_t rejected(const msg::ServiceStatus& status) { return status.rejected(); }
  static std::uint64_t repeated(const msg::ServiceStatus& status) { return status.repeated(); }
  static std::uint64_t foreign(const msg::ServiceStatus& status) { return status.foreign(); }

  /// Service `id` counts the message that `attack` sends, each time anew.
  void expect_counted(const std::string& what, const std::string& id, Count count,
                      const std::function<void()>& attack) {
    ASSERT_TRUE(witness_.until([&] { return witness_.status.contains(id); }, kTrainingWait));
    const std::uint64_t before = count(witness_.status[id]);
    Clock::time_point next{};
    EXPECT_TRUE(witness_.until(
        [&] {
          if (Clock::now() >= next) attack(), next = Clock::now() + milliseconds(20);
          return count(witness_.status[id]) >= before + kTimes;
        },
        kShortWait))
        << what << ": " << count(witness_.status[id]) - before << " counted by " << id;
  }
  void expect_training_goes_on() {
    const std::uint64_t updates = witness_.updates;
    EXPECT_TRUE(witness_.until([&] { return witness_.updates > updates + 3; }, kShortWait));
  }

  Trial trial_{"simulated"};
  Witness witness_{"simulated", trial_.domain()};
  Stranger stranger_{trial_.middleware()};
};

TEST_F(Hostile, APolicyServiceBelievesEnvServicesAlone) {
  const auto env = trial_.env("summer");
  const auto policy = trial_.train(10'000'000, "out", {"--middleware", "lossy,drop=0.1,seed=2:simulated"});
  ASSERT_TRUE(witness_.until([&] { return witness_.updates >= 3; }, kTrainingWait)) << policy->output();
  const auto observation = stranger_.hear<msg::Observation>();
  const auto info = stranger_.hear<msg::TraversalInfo>();
  const auto episode = stranger_.hear<msg::EpisodeStat>();
  const auto status = stranger_.hear<msg::ServiceStatus>([](const auto& m) { return m.service() == "env_service"; });

  auto nan = observation;
  nan.features()[1] = kNan;
  expect_counted("NaN in features", "policy", rejected, [&] { stranger_.say(nan); });
  nan = observation;
  nan.reward()[0] = kInfinite;
  expect_counted("infinite reward", "policy", rejected, [&] { stranger_.say(nan); });
  auto forged = observation;
  ++forged.header().incarnation();
  expect_counted("another process's observation", "policy", rejected, [&] { stranger_.say(forged); });
  forged.header().incarnation() -= 2;
  expect_counted("an older process's observation", "policy", rejected, [&] { stranger_.say(forged); });
  forged = observation;
  forged.header().session() = "another";
  expect_counted("a foreign run", "policy", foreign, [&] { stranger_.say(forged); });
  expect_counted("an old observation", "policy", repeated, [&] { stranger_.say(observation); });
  auto other = info;
  other.agents() = 3;
  expect_counted("another number of agents", "policy", rejected, [&] { stranger_.say(other); });
  auto ended = episode;
  ended.reward() = kInfinite;
  expect_counted("an infinite episode", "policy", rejected, [&] { stranger_.say(ended); });
  ended = episode;
  ++ended.header().incarnation();
  expect_counted("another process's episode", "policy", rejected, [&] { stranger_.say(ended); });
  auto beat = status;
  beat.rate() = kNan;
  expect_counted("a rate that is no number", "policy", rejected, [&] { stranger_.say(beat); });
  beat = status;
  beat.service_state() = status.service_state() == msg::RUNNING ? msg::WAITING : msg::RUNNING;
  expect_counted("an unknown state", "policy", rejected,
                 [&] { stranger_.say(status, unknown_enumerator(status, beat)); });
  expect_training_goes_on();
  for (const std::string kind : {"Observation.features: not finite", "Observation.reward: not finite",
                                 "a message of another process", "an announcement that differs", "ServiceStatus.rate"})
    EXPECT_TRUE(contains(policy->output(), kind));
  const std::string said = policy->output();
  const std::size_t once = said.find("a message of another process");
  EXPECT_EQ(said.find("a message of another process", once + 1), std::string::npos) << "logged once";
}

TEST_F(Hostile, ALiarAmongTheEnvServicesIsLeftBehind) {
  const auto env = trial_.env("summer");
  const auto policy = trial_.train(10'000'000, "out");
  ASSERT_TRUE(witness_.until([&] { return witness_.updates >= 3; }, kTrainingWait)) << policy->output();
  // It introduces itself as the env_services do, is told what to do, and shows places that are beside the route.
  auto info = stranger_.hear<msg::TraversalInfo>();
  auto observation = stranger_.hear<msg::Observation>();
  const auto introduce = [&] { stranger_.node.publish(info); };
  stranger_.node.create_reader<msg::TaskSettings>();
  introduce();
  Clock::time_point again = Clock::now();
  msg::TaskSettings settings;
  ASSERT_TRUE(witness_.until(
      [&] {
        if (Clock::now() >= again) introduce(), again = Clock::now() + milliseconds(200);
        while (stranger_.node.take(settings))
          if (settings.environment() == "stranger") return true;
        return false;
      },
      kTrainingWait));
  observation.settings() = settings.settings();
  observation.step() = 0;
  observation.position()[0] = settings.first_frame() + settings.frames();
  expect_counted("a position beside the route", "policy", rejected, [&] { stranger_.node.publish(observation); });
  expect_training_goes_on();
  EXPECT_TRUE(contains(policy->output(), "with a position beside the route"));
}

TEST_F(Hostile, AnEnvServiceObeysWhoIsInCharge) {
  const auto env = trial_.env("summer");
  const auto policy = trial_.train(10'000'000, "out");
  ASSERT_TRUE(witness_.until([&] { return witness_.updates >= 3; }, kTrainingWait)) << policy->output();
  const auto settings = stranger_.hear<msg::TaskSettings>();
  const auto genuine = stranger_.hear<msg::Action>();
  const std::string id = "env-summer";

  // While the policy_service sleeps, the env_service waits for the action that it now gets from somebody else.
  policy->send(SIGSTOP);
  ASSERT_TRUE(witness_.until([&] { return witness_.status[id].service_state() == msg::WAITING; }, kShortWait));
  stranger_.forget();
  const auto observation = stranger_.hear<msg::Observation>();
  msg::Action action = genuine;
  action.settings() = observation.settings();
  action.step() = observation.step();
  expect_counted("an action of a service that is not in charge", id, rejected, [&] { stranger_.node.publish(action); });
  action.header() = genuine.header();
  ++action.header().incarnation();
  expect_counted("an action of another process", id, rejected, [&] { stranger_.say(action); });
  action.header() = genuine.header();
  action.choice()[0] = 7;
  expect_counted("an unknown action", id, rejected, [&] { stranger_.say(action); });
  policy->send(SIGCONT);

  expect_counted("an old action", id, repeated, [&] { stranger_.say(genuine); });
  auto foreign_action = genuine;
  foreign_action.header().session() = "another";
  expect_counted("a foreign run", id, foreign, [&] { stranger_.say(foreign_action); });
  auto other = settings;
  other.settings().version() = 0;
  expect_counted("settings without a version", id, rejected, [&] { stranger_.say(other); });
  other = settings;
  other.settings().incarnation() = std::numeric_limits<std::uint64_t>::max();
  expect_counted("settings in the name of another process", id, rejected, [&] { stranger_.say(other); });
  other.header().incarnation() = other.settings().incarnation();
  expect_counted("settings of another policy_service", id, rejected, [&] { stranger_.say(other); });
  expect_counted("settings of before", id, repeated, [&] { stranger_.say(settings); });
  other = settings;
  other.task_mode() = settings.task_mode() == msg::TRAIN ? msg::EVALUATE : msg::TRAIN;
  expect_counted("an unknown mode", id, rejected,
                 [&] { stranger_.say(settings, unknown_enumerator(settings, other)); });
  msg::EpisodeAcknowledgement acknowledgement;
  acknowledgement.writer() = id;
  acknowledgement.writer_incarnation() = witness_.incarnation(id);
  acknowledgement.number() = 1'000'000'000;
  expect_counted("episodes that do not exist", id, rejected, [&] { stranger_.node.publish(acknowledgement); });
  expect_training_goes_on();
  for (const std::string kind : {"an action of a service that is not in charge", "Action.choice: unknown action 7",
                                 "settings without a version", "settings while another policy_service is in charge",
                                 "TaskSettings.task_mode", "an acknowledgement of episodes that do not exist"})
    EXPECT_TRUE(contains(env->output(), kind)) << kind << "\n" << env->output();
}

TEST_F(Hostile, LearnerAndActorBelieveEachOtherAlone) {
  const auto env = trial_.env("summer");
  const auto learner = trial_.train(10'000'000, "out", {"--role", "learner"});
  const auto actor = trial_.policy({"--role", "actor", "--id", "actor"});
  ASSERT_TRUE(witness_.until([&] { return witness_.updates >= 3; }, kTrainingWait))
      << learner->output() << actor->output();
  const auto trajectory = stranger_.hear<msg::Trajectory>();
  const auto info = stranger_.hear<msg::LearnerInfo>();
  const auto parameters = stranger_.hear<msg::ParametersChunk>();
  const auto acknowledgement = stranger_.hear<msg::TrajectoryAcknowledgement>();

  // As another actor, which the learner would believe.
  auto wrong = trajectory;
  wrong.log().number() = wrong.log().first() = 1;
  const auto as_actor = [&] { stranger_.node.publish(wrong); };
  wrong.features()[3] = kNan;
  expect_counted("NaN in a trajectory", "policy", rejected, as_actor);
  wrong.features() = trajectory.features();
  wrong.reward()[0] = kInfinite;
  expect_counted("an infinite reward", "policy", rejected, as_actor);
  wrong.reward() = trajectory.reward();
  wrong.position()[1] = 1'000'000;
  expect_counted("a position beside the route", "policy", rejected, as_actor);
  wrong.position() = trajectory.position();
  wrong.version() = 1'000'000'000;
  expect_counted("of parameters to come", "policy", rejected, as_actor);
  wrong.version() = trajectory.version();
  wrong.log().stream() -= 1;
  expect_counted("for a dead learner", "policy", repeated, as_actor);
  auto foreign_one = trajectory;
  foreign_one.header().session() = "another";
  expect_counted("of a foreign run", "policy", foreign, [&] { stranger_.say(foreign_one); });

  auto noisy = info;
  noisy.noise_place() = kNan;
  expect_counted("a noise that is no number", "actor", rejected, [&] { stranger_.say(noisy); });
  auto usurper = info;
  usurper.header().sender() = "usurper";
  expect_counted("a learner in another's name", "actor", rejected, [&] { stranger_.say(usurper); });
  auto forged = parameters;
  forged.header().sender() = "usurper";
  expect_counted("parameters from another service than the learner", "actor", rejected, [&] { stranger_.say(forged); });
  forged = parameters;
  --forged.header().incarnation();
  expect_counted("parameters of an older learner", "actor", rejected, [&] { stranger_.say(forged); });
  forged = parameters;
  forged.item() += 1'000'000;
  expect_counted("parameters that were not announced", "actor", repeated, [&] { stranger_.say(forged); });
  auto taken = acknowledgement;
  taken.number() = 1'000'000'000;
  expect_counted("trajectories that were never sent", "actor", rejected, [&] { stranger_.say(taken); });
  taken = acknowledgement;
  taken.header().sender() = "usurper";
  expect_counted("an acknowledgement of another", "actor", rejected, [&] { stranger_.say(taken); });
  expect_training_goes_on();
  for (const std::string kind :
       {"a learner with an invalid noise", "an announcement from another service than the learner",
        "parameters from another service than the learner", "an acknowledgement of trajectories that were never sent"})
    EXPECT_TRUE(contains(actor->output(), kind)) << kind << "\n" << actor->output();
}

}  // namespace
}  // namespace citylearn::testing
