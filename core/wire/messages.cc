// SPDX-License-Identifier: Apache-2.0
#include "core/wire/messages.h"

#include <fastcdr/Cdr.h>
#include <fastcdr/exceptions/Exception.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "core/wire/transfer.h"

// The generated code gives structs and their CDR encoding, but knows no bounds: it would write a sequence over its
// bound, and reading one it allocates whatever length the bytes claim. So each message's fields are named once more
// here, in the order of the wire, for a Writer that checks bounds and a Reader that checks lengths before it allocates.
// A unit test decodes what the generated code encodes, for every message.

namespace citylearn {
namespace {

using namespace msg;  // NOLINT: every message type and limit below is from idl/

constexpr std::size_t kEncapsulation = 4;

template <std::size_t N>
using Text = eprosima::fastrtps::fixed_string<N>;  // what fastddsgen makes of string<N>; cuts what is longer

template <class Given, class Wanted>
concept Of = std::same_as<std::remove_const_t<Given>, Wanted>;

template <Of<SettingsId> M, class Visitor>
void visit(M& m, Visitor& v) {
  v("incarnation", m.incarnation());
  v("version", m.version());
}

template <Of<Header> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.protocol(m.protocol());
  v("run", m.run());
  v("sender", m.sender());
  v("incarnation", m.incarnation());
  v("message", m.message());
}

template <Of<Observation> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v.nested("settings", m.settings());
  v("step", m.step());
  v("traversal", m.traversal());
  v("traversal_hash", m.traversal_hash());
  v("by_reference", m.by_reference());
  v("feature_dimension", m.feature_dimension());
  v("encoder_incarnation", m.encoder_incarnation());
  v("frame", m.frame(), MAX_AGENTS);
  v("position", m.position(), MAX_AGENTS);
  v("goal", m.goal(), MAX_AGENTS);
  v("previous_action", m.previous_action(), MAX_AGENTS);
  v("allowed", m.allowed(), MAX_AGENTS);
  v("flags", m.flags(), MAX_AGENTS);
  v("reward", m.reward(), MAX_AGENTS);
  v("features", m.features(), MAX_FEATURES);
}

template <Of<Action> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v("environment_incarnation", m.environment_incarnation());
  v.nested("settings", m.settings());
  v("step", m.step());
  v("choice", m.choice(), MAX_AGENTS);
}

template <Of<EpisodeStat> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v.nested("settings", m.settings());
  v("episode", m.episode());
  v("acknowledged", m.acknowledged());
  v("agent", m.agent());
  v("evaluation", m.evaluation());
  v("task", m.task());
  v("traversal", m.traversal());
  v("start", m.start());
  v("goal", m.goal());
  v("steps", m.steps());
  v("shortest", m.shortest());
  v("reward", m.reward());
  v("completed", m.completed());
  v("shuffled", m.shuffled());
  v("policy", m.policy());
  v("update", m.update());
  v("job", m.job());
  v("path", m.path(), MAX_PATH);
}

template <Of<EpisodeAcknowledgement> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v("environment_incarnation", m.environment_incarnation());
  v("episode", m.episode());
  v("leaving", m.leaving());
}

template <Of<ServiceStatus> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("service", m.service());
  v("host", m.host());
  v("middleware", m.middleware());
  v("process", m.process());
  v.enumerator("service_state", m.service_state(), FAILED);
  v("activity", m.activity());
  v("uptime", m.uptime());
  v("rate", m.rate());
  v("received", m.received());
  v("repeated", m.repeated());
  v("resent", m.resent());
  v("rejected", m.rejected());
  v("foreign", m.foreign());
  v("alarm", m.alarm());
}

template <Of<TaskSettings> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v.nested("settings", m.settings());
  v.enumerator("task_mode", m.task_mode(), EVALUATE);
  v("lesson", m.lesson());
  v("first_frame", m.first_frame());
  v("frames", m.frames());
  v("max_steps", m.max_steps());
  v("seed", m.seed());
  v("tasks", m.tasks());
  v("shuffle", m.shuffle());
  v("policy", m.policy());
  v("update", m.update());
  v("job", m.job());
  v("by_reference", m.by_reference());
}

template <Of<TrainingStat> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("job", m.job());
  v("update", m.update());
  v("steps", m.steps());
  v("episodes", m.episodes());
  v("lesson", m.lesson());
  v("wall", m.wall());
  v("steps_per_second", m.steps_per_second());
  v("reward", m.reward());
  v("spl", m.spl());
  v("policy_loss", m.policy_loss());
  v("value_loss", m.value_loss());
  v("entropy", m.entropy());
  v("divergence", m.divergence());
  v("clipped", m.clipped());
  v("gradient_norm", m.gradient_norm());
  v("learning_rate", m.learning_rate());
  v("lag", m.lag());
}

template <Of<RunInfo> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("agent", m.agent());
  v("learner", m.learner());
  v("seed", m.seed());
  v("job", m.job());
  v("updates", m.updates());
  v("ended", m.ended());
  v("manifest", m.manifest(), MAX_CHUNK);
}

template <Of<TrainingStatRequest> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("policy", m.policy());
  v("policy_incarnation", m.policy_incarnation());
  v("job", m.job());
  v("first", m.first());
  v("last", m.last());
}

template <Of<Scene> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v.nested("settings", m.settings());
  v.enumerator("task_mode", m.task_mode(), EVALUATE);
  v("policy", m.policy());
  v("traversal", m.traversal());
  v("traversal_hash", m.traversal_hash());
  v("first_frame", m.first_frame());
  v("frames", m.frames());
  v("step", m.step());
  v("frame", m.frame(), MAX_AGENTS);
  v("position", m.position(), MAX_AGENTS);
  v("start", m.start(), MAX_AGENTS);
  v("goal", m.goal(), MAX_AGENTS);
  v("steps", m.steps(), MAX_AGENTS);
  v("flags", m.flags(), MAX_AGENTS);
}

template <Of<MapRequest> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v("hash", m.hash());
  v("first", m.first());
}

template <Of<MapChunk> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("hash", m.hash());
  v("frames", m.frames());
  v("first", m.first());
  v("position", m.position(), MAX_PLACES);
  v("latitude", m.latitude(), MAX_PLACES);
  v("longitude", m.longitude(), MAX_PLACES);
}

template <Of<PolicyParameters> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("version", m.version());
  v("agent", m.agent());
  v("total_bytes", m.total_bytes());
  v("hash", m.hash());
  v("chunk", m.chunk());
  v("chunks", m.chunks());
  v("data", m.data(), MAX_CHUNK);
}

template <Of<LearnerInfo> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("training", m.training());
  v("traversal", m.traversal());
  v("traversal_hash", m.traversal_hash());
  v("feature_dimension", m.feature_dimension());
  v("first_frame", m.first_frame());
  v("frames", m.frames());
  v("lesson", m.lesson());
  v("lesson_frames", m.lesson_frames());
  v("max_steps", m.max_steps());
  v("agent", m.agent());
  v("network", m.network());
  v("seed", m.seed());
  v("job", m.job());
  v("steps", m.steps());
  v("window", m.window());
  v("noise_frame", m.noise_frame());
  v("noise_place", m.noise_place());
  v("noise_episode", m.noise_episode());
  v("version", m.version());
  v("total_bytes", m.total_bytes());
  v("hash", m.hash());
  v("chunks", m.chunks());
}

template <Of<ActorStatus> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("learner", m.learner());
  v("learner_incarnation", m.learner_incarnation());
  v("version", m.version());
  v("environments", m.environments(), MAX_SERVED);
  v("unacknowledged", m.unacknowledged());
  v("waiting", m.waiting());
  v("waited", m.waited());
}

template <Of<Trajectory> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("learner", m.learner());
  v("learner_incarnation", m.learner_incarnation());
  v("number", m.number());
  v("environment", m.environment());
  v("agent", m.agent());
  v.nested("settings", m.settings());
  v("step", m.step());
  v("lesson", m.lesson());
  v("version", m.version());
  v("feature_dimension", m.feature_dimension());
  v("state", m.state(), MAX_STATE);
  v("shown", m.shown(), MAX_STEPS_AND_ONE);
  v("position", m.position(), MAX_STEPS_AND_ONE);
  v("goal", m.goal(), MAX_STEPS_AND_ONE);
  v("previous_action", m.previous_action(), MAX_STEPS_AND_ONE);
  v("allowed", m.allowed(), MAX_STEPS_AND_ONE);
  v("first", m.first(), MAX_STEPS_AND_ONE);
  v("value", m.value(), MAX_STEPS_AND_ONE);
  v("features", m.features(), MAX_TRAJECTORY);
  v("action", m.action(), MAX_STEPS);
  v("log_probability", m.log_probability(), MAX_STEPS);
  v("reward", m.reward(), MAX_STEPS);
  v("ended", m.ended(), MAX_STEPS);
  v("final_value", m.final_value(), MAX_STEPS);
}

template <Of<TrajectoryAcknowledgement> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("actor", m.actor());
  v("actor_incarnation", m.actor_incarnation());
  v("number", m.number());
  v("limit", m.limit());
}

template <Of<ParametersRequest> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("learner", m.learner());
  v("version", m.version());
  v("chunks", m.chunks(), MAX_PARTS_ASKED);
}

template <Of<TraversalInfo> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v.nested("settings", m.settings());
  v("dataset", m.dataset());
  v("traversal", m.traversal());
  v("condition", m.condition());
  v("hash", m.hash());
  v("frames", m.frames());
  v("feature_dimension", m.feature_dimension());
  v("agents", m.agents());
  v("chunks", m.chunks());
  v("by_reference", m.by_reference());
  v("images", m.images());
  v("encoder", m.encoder());
  v("encoder_service", m.encoder_service());
  v("encoder_incarnation", m.encoder_incarnation());
}

template <Of<TraversalRequest> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v("hash", m.hash());
  v("feature_dimension", m.feature_dimension());
  v("chunks", m.chunks(), MAX_CHUNKS_ASKED);
}

template <Of<TraversalChunk> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("hash", m.hash());
  v("frames", m.frames());
  v("feature_dimension", m.feature_dimension());
  v("chunk", m.chunk());
  v("data", m.data(), MAX_CHUNK);
}

template <Of<ImageRequest> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("environment", m.environment());
  v("hash", m.hash());
  v("frames", m.frames(), MAX_FRAMES_ASKED);
  v("first_chunk", m.first_chunk());
}

template <Of<ImageChunk> M, class Visitor>
void visit(M& m, Visitor& v) {
  v.nested("header", m.header());
  v("hash", m.hash());
  v("frame", m.frame());
  v("total_bytes", m.total_bytes());
  v("chunk", m.chunk());
  v("name", m.name());
  v("data", m.data(), MAX_CHUNK);
}

/// Where a Reader or Writer stands, for its errors. `Type.field: what`: the part before the colon is the kind of fault.
class Place {
 public:
  explicit Place(const std::string& type) : type_(type) {}

  [[noreturn]] void fail(const std::string& what) const { throw Error(what, type_ + "." + prefix_ + field_); }

 protected:
  void require_at_most(std::size_t count, std::size_t bound, const char* unit) const {
    if (count > bound) fail(std::to_string(count) + " " + unit + ", at most " + std::to_string(bound) + " are allowed");
  }
  template <class Self, class Message>
  static void descend(Self& self, const char* name, Message& message) {
    self.prefix_ = std::string(name) + ".";
    visit(message, self);
    self.prefix_.clear();
  }

  const std::string& type_;
  std::string prefix_;
  const char* field_ = "";
};

/// Checks the bounds of what is about to be written.
class Checker : public Place {
 public:
  using Place::Place;

  template <class Number>
  void operator()(const char*, const Number&) {}
  template <class T>
  void operator()(const char* name, const std::vector<T>& sequence, std::size_t bound) {
    field_ = name;
    require_at_most(sequence.size(), bound, "entries");
  }
  template <class Enum>
  void enumerator(const char* name, Enum value, Enum last) {
    field_ = name;
    if (value > last) fail("unknown value " + std::to_string(static_cast<std::uint32_t>(value)));
  }
  void protocol(std::uint32_t) {}
  template <class Message>
  void nested(const char* name, const Message& message) {
    descend(*this, name, message);
  }
};

/// Reads field by field, so that an error can say which one, and asks what is left before it allocates.
class Reader : public Place {
 public:
  Reader(const std::string& type, eprosima::fastcdr::Cdr& cdr, std::size_t size)
      : Place(type), cdr_(cdr), size_(size) {}

  template <class Number>
  void operator()(const char* name, Number& number) {
    field_ = name;
    cdr_ >> number;
  }
  template <std::size_t N>
  void operator()(const char* name, Text<N>& text) {
    field_ = name;
    const std::size_t length = read_length();  // with its terminating zero
    require_at_most(length, N + 1, "characters with the zero");
    if (length > left()) fail("cut short");
    char buffer[N + 1];
    cdr_.deserializeArray(buffer, length);
    if (length == 0 || std::memchr(buffer, 0, length) != buffer + length - 1)
      fail("not a string that ends at its first zero");
    text = buffer;
  }
  template <class T>
  void operator()(const char* name, std::vector<T>& sequence, std::size_t bound) {
    field_ = name;
    const std::size_t length = read_length();
    require_at_most(length, bound, "entries");
    if (length * sizeof(T) > left()) fail("cut short");
    sequence.resize(length);
    if (length > 0) cdr_.deserializeArray(sequence.data(), length);
  }
  template <class Enum>
  void enumerator(const char* name, Enum& value, Enum last) {
    field_ = name;
    std::uint32_t number = 0;
    cdr_ >> number;
    if (number > static_cast<std::uint32_t>(last)) fail("unknown value " + std::to_string(number));
    value = static_cast<Enum>(number);
  }
  void protocol(std::uint32_t& number) {
    field_ = "protocol";
    cdr_ >> number;
    // At once: what follows in another protocol may be anything.
    if (number != PROTOCOL)
      fail("the sender speaks protocol " + std::to_string(number) + ", this program " + std::to_string(PROTOCOL));
  }
  template <class Message>
  void nested(const char* name, Message& message) {
    descend(*this, name, message);
  }
  std::size_t left() const { return size_ - cdr_.getSerializedDataLength(); }

 private:
  std::size_t read_length() {
    std::uint32_t length = 0;
    cdr_ >> length;
    return length;
  }

  eprosima::fastcdr::Cdr& cdr_;
  std::size_t size_;
};

// What the types alone do not say.

[[noreturn]] void refuse(const std::string& type, const std::string& field, const std::string& what) {
  throw Error(what, type + "." + field);
}

std::string counts(std::size_t is, std::size_t should) {
  return std::to_string(is) + " entries, should be " + std::to_string(should);
}

/// Neither NaN nor infinite: all of it is read, without a branch a number.
bool finite(const std::vector<float>& numbers) {
  constexpr std::uint32_t kExponent = 0x7F800000;
  bool wrong = false;
  for (const float number : numbers) wrong |= (std::bit_cast<std::uint32_t>(number) & kExponent) == kExponent;
  return !wrong;
}

void require_finite(bool finite, const std::string& type, const char* field) {
  if (!finite) refuse(type, field, "not finite");
}

template <class Message>
void check(const Message&, const std::string&) {}

void check(const ServiceStatus& m, const std::string& type) {
  require_finite(std::isfinite(m.uptime()), type, "uptime");
  require_finite(std::isfinite(m.rate()), type, "rate");
}

void check(const ActorStatus& m, const std::string& type) { require_finite(std::isfinite(m.waited()), type, "waited"); }

void check(const Observation& m, const std::string& type) {
  const std::size_t agents = m.frame().size();
  const auto same = [&](const char* field, std::size_t size) {
    if (size != agents) refuse(type, field, counts(size, agents) + " as many as frame has");
  };
  same("position", m.position().size());
  same("goal", m.goal().size());
  same("previous_action", m.previous_action().size());
  same("allowed", m.allowed().size());
  same("flags", m.flags().size());
  same("reward", m.reward().size());
  const std::size_t features = agents * m.feature_dimension();  // 32 bits times at most 256: no overflow
  if (m.features().size() != features)
    refuse(type, "features", counts(m.features().size(), features) + ": agents x feature_dimension");
  for (std::uint8_t action : m.previous_action())
    if (action >= kActions && action != kNoAction)
      refuse(type, "previous_action", "unknown action " + std::to_string(action));
  require_finite(finite(m.reward()), type, "reward");
  require_finite(finite(m.features()), type, "features");
}

void check(const EpisodeStat& m, const std::string& type) {
  require_finite(std::isfinite(m.reward()), type, "reward");
  const std::size_t octets = (std::size_t{m.steps()} + 3) / 4;
  if (!m.path().empty() && m.path().size() != octets) refuse(type, "path", counts(m.path().size(), octets));
}

void check(const Scene& m, const std::string& type) {
  const std::size_t agents = m.frame().size();
  const auto same = [&](const char* field, std::size_t size) {
    if (size != agents) refuse(type, field, counts(size, agents) + " as many as frame has");
  };
  same("position", m.position().size());
  same("start", m.start().size());
  same("goal", m.goal().size());
  same("steps", m.steps().size());
  same("flags", m.flags().size());
}

void check(const MapChunk& m, const std::string& type) {
  const std::size_t places = m.position().size();
  if (m.frames() < 1 || m.frames() > MAX_FRAMES) refuse(type, "frames", "must be 1.." + std::to_string(MAX_FRAMES));
  if (m.first() > m.frames() || places > m.frames() - m.first()) refuse(type, "position", "goes beyond the last frame");
  if (!m.latitude().empty() && m.latitude().size() != places)
    refuse(type, "latitude", counts(m.latitude().size(), places));
  if (m.longitude().size() != m.latitude().size())
    refuse(type, "longitude", counts(m.longitude().size(), m.latitude().size()));
}

void check(const Action& m, const std::string& type) {
  for (std::uint8_t action : m.choice())
    if (action >= kActions) refuse(type, "choice", "unknown action " + std::to_string(action));
}

template <class Message>
void check_size(const Message& m, const std::string& type) {
  if (m.feature_dimension() > MAX_DIMENSION)
    refuse(type, "feature_dimension", "must be at most " + std::to_string(MAX_DIMENSION));
  if (m.frames() < 1 || m.frames() > MAX_FRAMES) refuse(type, "frames", "must be 1.." + std::to_string(MAX_FRAMES));
}

void check(const TraversalInfo& m, const std::string& type) {
  check_size(m, type);
  if (m.agents() < 1 || m.agents() > MAX_AGENTS) refuse(type, "agents", "must be 1.." + std::to_string(MAX_AGENTS));
}

void check(const TraversalChunk& m, const std::string& type) {
  check_size(m, type);
  const ChunkLayout layout(m.frames(), m.feature_dimension());
  if (m.chunk() >= layout.chunks())
    refuse(type, "chunk", "index " + std::to_string(m.chunk()) + " of " + std::to_string(layout.chunks()) + " chunks");
  if (m.data().size() != layout.bytes(m.chunk()))
    refuse(type, "data", counts(m.data().size(), layout.bytes(m.chunk())));
}

void check(const ImageChunk& m, const std::string& type) {
  if (m.total_bytes() > MAX_IMAGE) refuse(type, "total_bytes", "must be at most " + std::to_string(MAX_IMAGE));
  const std::uint64_t before = std::uint64_t{m.chunk()} * MAX_CHUNK;
  const std::uint64_t size =
      before > m.total_bytes() ? 0 : std::min<std::uint64_t>(m.total_bytes() - before, MAX_CHUNK);
  if (m.chunk() > 0 && size == 0) refuse(type, "chunk", "index " + std::to_string(m.chunk()) + " is beyond the image");
  if (m.data().size() != size) refuse(type, "data", counts(m.data().size(), size));
}

void check(const PolicyParameters& m, const std::string& type) {
  if (m.chunk() >= m.chunks())
    refuse(type, "chunk", "index " + std::to_string(m.chunk()) + " of " + std::to_string(m.chunks()) + " chunks");
  if (m.data().size() > m.total_bytes()) refuse(type, "data", "more bytes than total_bytes says");
}

void check(const Trajectory& m, const std::string& type) {
  const std::size_t steps = m.action().size(), observations = m.shown().size();
  if (observations != steps + 1) refuse(type, "shown", counts(observations, steps + 1) + ", one more than action has");
  const auto same = [&](const char* field, std::size_t size, std::size_t should) {
    if (size != should) refuse(type, field, counts(size, should));
  };
  same("position", m.position().size(), observations);
  same("goal", m.goal().size(), observations);
  same("previous_action", m.previous_action().size(), observations);
  same("allowed", m.allowed().size(), observations);
  same("first", m.first().size(), observations);
  same("value", m.value().size(), observations);
  same("log_probability", m.log_probability().size(), steps);
  same("reward", m.reward().size(), steps);
  same("ended", m.ended().size(), steps);
  same("final_value", m.final_value().size(), steps);
  same("features", m.features().size(), observations * std::size_t{m.feature_dimension()});
  for (std::uint8_t action : m.action())
    if (action >= kActions) refuse(type, "action", "unknown action " + std::to_string(action));
  for (std::uint8_t action : m.previous_action())
    if (action >= kActions && action != kNoAction)
      refuse(type, "previous_action", "unknown action " + std::to_string(action));
  for (std::uint8_t end : m.ended())
    if (end > 2) refuse(type, "ended", "unknown end " + std::to_string(end));
}

template <class Message>
struct Describe;
#define CITYLEARN_TOPIC(TYPE, NAME, PROFILE)                      \
  template <>                                                     \
  struct Describe<TYPE> {                                         \
    static constexpr const char* name = "citylearn/" NAME;        \
    static constexpr const char* type = "citylearn::msg::" #TYPE; \
    static constexpr Profile profile = Profile::PROFILE;          \
  };
CITYLEARN_TOPIC(Observation, "observation", kStream)
CITYLEARN_TOPIC(Action, "action", kStream)
CITYLEARN_TOPIC(ServiceStatus, "service_status", kState)
CITYLEARN_TOPIC(TraversalInfo, "traversal_info", kState)
CITYLEARN_TOPIC(TaskSettings, "task_settings", kCommand)
CITYLEARN_TOPIC(TraversalRequest, "traversal_request", kCommand)
CITYLEARN_TOPIC(EpisodeAcknowledgement, "episode_acknowledgement", kCommand)
CITYLEARN_TOPIC(EpisodeStat, "episode_stat", kDurable)
CITYLEARN_TOPIC(TraversalChunk, "traversal_chunk", kDurable)
CITYLEARN_TOPIC(ImageRequest, "image_request", kCommand)
CITYLEARN_TOPIC(ImageChunk, "image_chunk", kDurable)
CITYLEARN_TOPIC(TrainingStat, "training_stat", kDurable)
CITYLEARN_TOPIC(PolicyParameters, "policy_parameters", kDurable)
CITYLEARN_TOPIC(LearnerInfo, "learner_info", kState)
CITYLEARN_TOPIC(ActorStatus, "actor_status", kState)
CITYLEARN_TOPIC(Trajectory, "trajectory", kCommand)
CITYLEARN_TOPIC(TrajectoryAcknowledgement, "trajectory_acknowledgement", kCommand)
CITYLEARN_TOPIC(ParametersRequest, "parameters_request", kCommand)
CITYLEARN_TOPIC(RunInfo, "run_info", kState)
CITYLEARN_TOPIC(TrainingStatRequest, "training_stat_request", kCommand)
CITYLEARN_TOPIC(Scene, "scene", kState)
CITYLEARN_TOPIC(MapRequest, "map_request", kCommand)
CITYLEARN_TOPIC(MapChunk, "map_chunk", kCommand)
#undef CITYLEARN_TOPIC

}  // namespace

template <class Message>
const Topic& topic_of() {
  using D = Describe<Message>;
  static const Topic topic{D::name, D::type, D::profile, kEncapsulation + Message::getMaxCdrSerializedSize()};
  return topic;
}

template <class Message>
void encode(const Message& message, Bytes& bytes) {
  Checker checker(topic_of<Message>().type);
  visit(message, checker);
  bytes.resize(kEncapsulation + Message::getCdrSerializedSize(message));
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  message.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
}

template <class Message>
void decode(std::span<const std::byte> bytes, Message& message) {
  const std::string& type = topic_of<Message>().type;
  if (bytes.size() < kEncapsulation) throw Error("cut short", type);
  // fastcdr also reads parameter lists, of which nobody else here knows (core/recording/wire_header).
  const auto encapsulation = std::to_integer<unsigned>(bytes[0]) << 8 | std::to_integer<unsigned>(bytes[1]);
  if (encapsulation > 1)
    throw Error("encapsulation " + std::to_string(encapsulation) + ", should be CDR: 0 or 1", type);
  // FastBuffer wants a pointer to writable bytes; nothing is written through it here.
  char* data = const_cast<char*>(reinterpret_cast<const char*>(bytes.data()));
  eprosima::fastcdr::FastBuffer buffer(data, bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
  Reader reader(type, cdr, bytes.size());
  try {
    cdr.read_encapsulation();
    visit(message, reader);
  } catch (const eprosima::fastcdr::exception::NotEnoughMemoryException&) {
    reader.fail("cut short");
  } catch (const eprosima::fastcdr::exception::Exception& exception) {
    reader.fail(std::string("not CDR: ") + exception.what());
  }
  // Payloads are padded to multiples of 4 on the way.
  if (reader.left() > 3) throw Error(std::to_string(reader.left()) + " bytes left over at its end", type);
  check(message, type);
}

#define CITYLEARN_INSTANTIATE(TYPE)                              \
  template const Topic& topic_of<TYPE>();                        \
  template void encode<TYPE>(const TYPE& message, Bytes& bytes); \
  template void decode<TYPE>(std::span<const std::byte> bytes, TYPE & message);
CITYLEARN_INSTANTIATE(Observation)
CITYLEARN_INSTANTIATE(Action)
CITYLEARN_INSTANTIATE(ServiceStatus)
CITYLEARN_INSTANTIATE(TraversalInfo)
CITYLEARN_INSTANTIATE(TaskSettings)
CITYLEARN_INSTANTIATE(TraversalRequest)
CITYLEARN_INSTANTIATE(EpisodeAcknowledgement)
CITYLEARN_INSTANTIATE(EpisodeStat)
CITYLEARN_INSTANTIATE(TraversalChunk)
CITYLEARN_INSTANTIATE(ImageRequest)
CITYLEARN_INSTANTIATE(ImageChunk)
CITYLEARN_INSTANTIATE(TrainingStat)
CITYLEARN_INSTANTIATE(PolicyParameters)
CITYLEARN_INSTANTIATE(LearnerInfo)
CITYLEARN_INSTANTIATE(ActorStatus)
CITYLEARN_INSTANTIATE(Trajectory)
CITYLEARN_INSTANTIATE(TrajectoryAcknowledgement)
CITYLEARN_INSTANTIATE(ParametersRequest)
CITYLEARN_INSTANTIATE(RunInfo)
CITYLEARN_INSTANTIATE(TrainingStatRequest)
CITYLEARN_INSTANTIATE(Scene)
CITYLEARN_INSTANTIATE(MapRequest)
CITYLEARN_INSTANTIATE(MapChunk)
#undef CITYLEARN_INSTANTIATE

std::vector<Topic> all_topics() {
  return {topic_of<Observation>(),
          topic_of<Action>(),
          topic_of<ServiceStatus>(),
          topic_of<TraversalInfo>(),
          topic_of<TaskSettings>(),
          topic_of<TraversalRequest>(),
          topic_of<EpisodeAcknowledgement>(),
          topic_of<EpisodeStat>(),
          topic_of<TraversalChunk>(),
          topic_of<ImageRequest>(),
          topic_of<ImageChunk>(),
          topic_of<TrainingStat>(),
          topic_of<PolicyParameters>(),
          topic_of<LearnerInfo>(),
          topic_of<ActorStatus>(),
          topic_of<Trajectory>(),
          topic_of<TrajectoryAcknowledgement>(),
          topic_of<ParametersRequest>(),
          topic_of<RunInfo>(),
          topic_of<TrainingStatRequest>(),
          topic_of<Scene>(),
          topic_of<MapRequest>(),
          topic_of<MapChunk>()};
}

}  // namespace citylearn
