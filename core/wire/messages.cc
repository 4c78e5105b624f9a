// SPDX-License-Identifier: Apache-2.0
#include "core/wire/messages.h"

#include <bit>
#include <cmath>
#include <cstring>

#include "core/exchange/blob.h"
#include "core/task/path.h"
#include "core/util/name.h"
#include "core/util/sha256.h"
#include "core/wire/cdr.h"
#include "idl/message_fields.h"

// idl/generate.py makes visit(), which names a message's fields in the order of the wire, for a Checker of bounds, a
// CdrWriter, and a Reader that checks lengths before it allocates, and check_fields(), for what idl/ says about the
// fields. A unit test compares the bytes with those that Fast CDR and Cyclone DDS write, for every message.

namespace citylearn {
namespace {

using namespace msg;  // NOLINT: every message type and limit below is from idl/

constexpr std::string_view kPrefix = "citylearn/";  // of every topic

/// The place of a Reader or Writer in a message, for errors: `Type.field: what`. Before the colon is the kind of fault.
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
  void protocol(const char*, std::uint32_t) {}
  template <class Message>
  void nested(const char* name, const Message& message) {
    descend(*this, name, message);
  }
};

/// Reads field by field, so that an error can say which one, and asks what is left before it allocates.
class Reader : public Place {
 public:
  Reader(const std::string& type, CdrReader& cdr) : Place(type), cdr_(cdr) {}

  template <class Number>
  void operator()(const char* name, Number& number) {
    field_ = name;
    cdr_.read(&number, 1);
  }
  template <std::size_t N>
  void operator()(const char* name, FixedString<N>& text) {
    field_ = name;
    const std::size_t length = cdr_.read_length();  // with its terminating zero
    require_at_most(length, N + 1, "characters with the zero");
    char buffer[N + 1];
    cdr_.read(buffer, length);
    if (length == 0 || std::memchr(buffer, 0, length) != buffer + length - 1)
      fail("not a string that ends at its first zero");
    text = buffer;
  }
  template <class T>
  void operator()(const char* name, std::vector<T>& sequence, std::size_t bound) {
    field_ = name;
    const std::size_t length = cdr_.read_length();
    require_at_most(length, bound, "entries");
    if (length * sizeof(T) > cdr_.left()) fail("cut short");
    sequence.resize(length);
    cdr_.read(sequence.data(), length);
  }
  template <class Enum>
  void enumerator(const char* name, Enum& value, Enum last) {
    field_ = name;
    const std::uint32_t number = cdr_.read_length();
    if (number > static_cast<std::uint32_t>(last)) fail("unknown value " + std::to_string(number));
    value = static_cast<Enum>(number);
  }
  void protocol(const char* name, std::uint32_t& number) {
    field_ = name;
    cdr_.read(&number, 1);
    // At once: what follows in another protocol may be anything.
    if (number != PROTOCOL)
      fail("the sender speaks protocol " + std::to_string(number) + ", this program " + std::to_string(PROTOCOL));
  }
  template <class Message>
  void nested(const char* name, Message& message) {
    descend(*this, name, message);
  }

 private:
  CdrReader& cdr_;
};

[[noreturn]] void refuse(const std::string& type, const std::string& field, const std::string& what) {
  throw Error(what, type + "." + field);
}

std::string counts(std::size_t is, std::size_t should) {
  return std::to_string(is) + " entries, should be " + std::to_string(should);
}

/// Checks what annotations in idl/ say about fields that were read.
struct FieldCheck {
  const std::string& type;

  void length(const char* field, std::size_t is, const char* other, std::size_t others, std::size_t more) {
    if (is == others + more) return;
    refuse(type, field, counts(is, others + more) + (more ? ", one more than " : " as many as ") + other + " has");
  }
  template <std::size_t N>
  void name(const char* field, const FixedString<N>& text, bool optional) {
    if (optional && text.size() == 0) return;
    if (!is_name({text.c_str(), text.size()})) refuse(type, field, name_problem(text.c_str()));
  }
  void finite(const char* field, double number) {
    if (!std::isfinite(number)) refuse(type, field, "not finite");
  }
  void finite(const char* field, const std::vector<float>& numbers) {
    constexpr std::uint32_t kExponent = 0x7F800000;  // all ones in NaN and infinities
    bool wrong = false;                              // reads them all, without a branch a number
    for (const float number : numbers) wrong |= (std::bit_cast<std::uint32_t>(number) & kExponent) == kExponent;
    if (wrong) refuse(type, field, "not finite");
  }
};

// What idl/ cannot say.

void require_actions(const std::vector<std::uint8_t>& actions, bool none, const std::string& type, const char* field) {
  for (const std::uint8_t action : actions)
    if (action >= kActions && !(none && action == kNoAction))
      refuse(type, field, "unknown action " + std::to_string(action));
}

template <class Message>
void check(const Message&, const std::string&) {}

template <std::derived_from<ObjectChunk> Message>
void check(const Message& m, const std::string& type) {
  if (m.total_bytes() > MAX_OBJECT) refuse(type, "total_bytes", "must be at most " + std::to_string(MAX_OBJECT));
  const std::size_t size = chunk_size(m.chunk(), m.total_bytes());
  if (m.chunk() > 0 && size == 0) refuse(type, "chunk", "index " + std::to_string(m.chunk()) + " is beyond the object");
  if (m.data().size() != size) refuse(type, "data", counts(m.data().size(), size));
}

void check(const Belief& belief, std::size_t agents, const std::string& type) {
  const std::size_t lost = belief.lost().size(), likely = lost * LIKELY_PLACES;
  if (lost != 0 && lost != agents) refuse(type, "belief.lost", counts(lost, agents));
  if (belief.likely().size() != likely) refuse(type, "belief.likely", counts(belief.likely().size(), likely));
}

void check(const Observation& m, const std::string& type) {
  const std::size_t features = m.frame().size() * m.feature_dimension();  // 32 bits times at most 256: no overflow
  if (m.features().size() != features)
    refuse(type, "features", counts(m.features().size(), features) + ": agents x feature_dimension");
  require_actions(m.previous_action(), true, type, "previous_action");
}

void check(const LogPosition& log, const std::string& type) {
  if (log.number() == 0) refuse(type, "log.number", "is 0, they count from 1");
  if (log.first() < 1 || log.first() > log.number())
    refuse(type, "log.first", "is " + std::to_string(log.first()) + ", must be 1.." + std::to_string(log.number()));
}

void check(const TrainingStat& m, const std::string& type) { check(m.log(), type); }

void check(const EpisodeStat& m, const std::string& type) {
  check(m.log(), type);
  const std::size_t octets = path_octets(m.steps());
  if (!m.path().empty() && m.path().size() != octets) refuse(type, "path", counts(m.path().size(), octets));
}

void check_frames(std::uint32_t frames, const std::string& type) {
  if (frames < 1 || frames > MAX_FRAMES) refuse(type, "frames", "must be 1.." + std::to_string(MAX_FRAMES));
}

void check(const RouteMap& m, const std::string& type) {
  const std::size_t places = m.position().size();
  check_frames(static_cast<std::uint32_t>(places), type);
  if (!m.latitude().empty() && m.latitude().size() != places)
    refuse(type, "latitude", counts(m.latitude().size(), places));
}

void check(const Action& m, const std::string& type) {
  require_actions(m.choice(), true, type, "choice");
  check(m.belief(), m.choice().size(), type);
}

void check(const Scene& m, const std::string& type) { check(m.belief(), m.frame().size(), type); }

void check(const TraversalInfo& m, const std::string& type) {
  if (m.feature_dimension() > MAX_DIMENSION)
    refuse(type, "feature_dimension", "must be at most " + std::to_string(MAX_DIMENSION));
  check_frames(m.frames(), type);
  if (m.agents() < 1 || m.agents() > MAX_AGENTS) refuse(type, "agents", "must be 1.." + std::to_string(MAX_AGENTS));
}

void check(const DescriptorStatus& m, const std::string& type) {
  check_frames(m.frames(), type);
  if (m.dimension() > MAX_DESCRIPTOR) refuse(type, "dimension", "must be at most " + std::to_string(MAX_DESCRIPTOR));
  const std::size_t blocks = (m.frames() + FRAMES_PER_BLOCK - 1) / FRAMES_PER_BLOCK;
  if (!m.present().empty() && m.present().size() != blocks) refuse(type, "present", counts(m.present().size(), blocks));
  for (const std::uint32_t block : m.encoding())
    if (block >= blocks) refuse(type, "encoding", "block " + std::to_string(block) + " of " + std::to_string(blocks));
}

void check(const Descriptor& m, const std::string& type) {
  if (m.dimension() < 1 || m.dimension() > MAX_DESCRIPTOR)
    refuse(type, "dimension", "must be 1.." + std::to_string(MAX_DESCRIPTOR));
}

void check(const Trajectory& m, const std::string& type) {
  check(m.log(), type);
  const std::size_t features = m.shown().size() * std::size_t{m.feature_dimension()};
  if (m.features().size() != features) refuse(type, "features", counts(m.features().size(), features));
  require_actions(m.action(), false, type, "action");
  require_actions(m.previous_action(), true, type, "previous_action");
  for (std::uint8_t end : m.ended())
    if (end > 2) refuse(type, "ended", "unknown end " + std::to_string(end));
}

template <class Message>
struct Describe;
#define CITYLEARN_DESCRIBE(TYPE, NAME, PROFILE, ADDRESSING)                   \
  template <>                                                                 \
  struct Describe<TYPE> {                                                     \
    static constexpr const char* name = NAME;                                 \
    static constexpr const char* type = type_of(static_cast<TYPE*>(nullptr)); \
    static constexpr Profile profile = Profile::PROFILE;                      \
    static constexpr Addressing addressing = Addressing::ADDRESSING;          \
  };
CITYLEARN_MESSAGES(CITYLEARN_DESCRIBE)

}  // namespace

template <class Message>
const Topic& topic_of() {
  using D = Describe<Message>;
  static const Topic topic{D::name, D::type, D::profile, kEncapsulation + max_size_of(static_cast<Message*>(nullptr)),
                           D::addressing == Addressing::kSenderAndAll};
  return topic;
}

template <class Message>
Addressing addressing_of() {
  return Describe<Message>::addressing;
}

template <class Message>
std::vector<Address> addresses_of(const Message& message) {
  const Header& header = message.header();
  const Address sender{header.session().c_str(), header.sender().c_str()};
  switch (addressing_of<Message>()) {
    case Addressing::kSharedTopic:
      break;
    case Addressing::kReceiver:
      if (std::string receiver = receiver_of(message); !receiver.empty()) return {{sender.session, receiver}};
      break;
    case Addressing::kSender:
      return {sender};
    case Addressing::kSenderAndAll:
      return {{}, sender};
  }
  return {{}};
}

namespace {

/// Returns a name as part of a topic's name, where both have at most 255 characters. Different names stay different.
std::string escaped(const std::string& name) {
  constexpr std::size_t kMaxLength = 108, kKeptLength = 90;
  std::string text;
  for (const char c : name)
    if (c == '-')
      text += "_m";
    else if (c == '.')
      text += "_d";
    else if (c == '_')
      text += "_u";
    else
      text += c;
  if (text.size() <= kMaxLength) return text;
  return text.substr(0, kKeptLength) + "_x" + sha256(name).substr(0, 16);
}

}  // namespace

Topic topic_at(const Topic& topic, const std::string& session, const std::string& id) {
  Topic one = topic;
  one.name.insert(kPrefix.size(), (session.empty() ? "" : escaped(session) + "/") + escaped(id) + "/");
  return one;
}

std::string base_topic(const std::string& name) {
  const std::size_t slash = name.rfind('/');
  return slash == name.npos ? name : std::string(kPrefix) + name.substr(slash + 1);
}

namespace {

template <class Message>
void write_checked(const std::string& type, const Message& message, Bytes& bytes) {
  Checker checker(type);
  visit(message, checker);
  CdrWriter writer(bytes);
  visit(message, writer);
}

template <class Message>
void read_checked(const std::string& type, std::span<const std::byte> bytes, Message& message) {
  if (bytes.size() < kEncapsulation) throw Error("cut short", type);
  const auto encapsulation = std::to_integer<unsigned>(bytes[0]) << 8 | std::to_integer<unsigned>(bytes[1]);
  if (encapsulation > 1)
    throw Error("encapsulation " + std::to_string(encapsulation) + ", should be CDR: 0 or 1", type);
  CdrReader cdr(bytes);
  Reader reader(type, cdr);
  try {
    visit(message, reader);
  } catch (const CdrError& error) {
    reader.fail(error.what);
  }
  // Payloads are padded to multiples of 4 on the way.
  if (cdr.left() > 3) throw Error(std::to_string(cdr.left()) + " bytes left over at its end", type);
  FieldCheck fields{type};
  check_fields(message, fields);
  check(message, type);
}

}  // namespace

template <class Message>
void encode(const Message& message, Bytes& bytes) {
  write_checked(topic_of<Message>().type, message, bytes);
}

template <class Message>
void decode(std::span<const std::byte> bytes, Message& message) {
  read_checked(topic_of<Message>().type, bytes, message);
}

template <class Object>
Bytes encode_object(const Object& object) {
  Bytes bytes;
  write_checked(type_of(&object), object, bytes);
  return bytes;
}

template <class Object>
Object decode_object(std::span<const std::byte> bytes) {
  Object object;
  read_checked(type_of(&object), bytes, object);
  return object;
}

// NOLINTBEGIN(bugprone-macro-parentheses): TYPE is a type
#define CITYLEARN_INSTANTIATE(TYPE, NAME, PROFILE, ADDRESSING)   \
  template const Topic& topic_of<TYPE>();                        \
  template Addressing addressing_of<TYPE>();                     \
  template std::vector<Address> addresses_of<TYPE>(const TYPE&); \
  template void encode<TYPE>(const TYPE& message, Bytes& bytes); \
  template void decode<TYPE>(std::span<const std::byte> bytes, TYPE & message);
#define CITYLEARN_INSTANTIATE_OBJECT(TYPE)         \
  template Bytes encode_object<TYPE>(const TYPE&); \
  template TYPE decode_object<TYPE>(std::span<const std::byte>);
// NOLINTEND(bugprone-macro-parentheses)
CITYLEARN_MESSAGES(CITYLEARN_INSTANTIATE)
CITYLEARN_OBJECTS(CITYLEARN_INSTANTIATE_OBJECT)

std::vector<Topic> all_topics() {
#define CITYLEARN_TOPIC(TYPE, NAME, PROFILE, ADDRESSING) topic_of<TYPE>(),
  return {CITYLEARN_MESSAGES(CITYLEARN_TOPIC)};
}

namespace {

template <class Message>
std::vector<Topic> topics_of_message(std::span<const std::byte> bytes) {
  Message message;
  decode(bytes, message);
  const Topic& all = topic_of<Message>();
  std::vector<Topic> topics;
  for (const auto& [session, id] : addresses_of(message))
    topics.push_back(id.empty() ? all : topic_at(all, session, id));
  return topics;
}

}  // namespace

Addressing addressing_of(const Topic& topic) {
  const std::string name = base_topic(topic.name);
#define CITYLEARN_ADDRESSING(TYPE, NAME, PROFILE, ADDRESSING) \
  if (name == topic_of<TYPE>().name) return Addressing::ADDRESSING;
  CITYLEARN_MESSAGES(CITYLEARN_ADDRESSING)
  throw Error("unknown topic", topic.name);
}

std::vector<Topic> topics_of(const Topic& topic, std::span<const std::byte> bytes) {
  const std::string name = base_topic(topic.name);
#define CITYLEARN_TOPICS_OF(TYPE, NAME, PROFILE, ADDRESSING) \
  if (name == topic_of<TYPE>().name) return topics_of_message<TYPE>(bytes);
  CITYLEARN_MESSAGES(CITYLEARN_TOPICS_OF)
  throw Error("unknown topic", topic.name);
}

}  // namespace citylearn
