// SPDX-License-Identifier: Apache-2.0
// One example of every message, its fields and its bytes, in tests/golden/messages.txt: what a program with other
// generated types has to write and read (docs/how-to/write-a-peer.md). A changed line is another protocol.
#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>

#include <concepts>
#include <set>
#include <string>

#include "tests/support/golden.h"
#include "tests/support/records/fast_cdr.h"
#include "tests/support/records/samples.h"

namespace citylearn::testing {
namespace {

/// Gives each number its place in the message and each text its name, so that fields that change places are seen.
class Example {
 public:
  template <class Number>
  void operator()(const char* field, Number& number) {
    ++count_;
    number = static_cast<Number>(std::string(field) == "incarnation" ? 1'700'000'000'000'000 + count_ : count_);
    if constexpr (std::is_floating_point_v<Number>) number += Number{0.5};
  }
  void operator()(const char*, bool& flag) { flag = true; }
  template <std::size_t N>
  void operator()(const char* field, FixedString<N>& text) {
    ++count_;
    text = std::string(field) == "session" ? "default" : std::string(field) == "sender" ? "env-summer" : field;
  }
  template <class T>
  void operator()(const char*, std::vector<T>& sequence, std::size_t) {
    sequence = {T{1}, T{0}, T{2}};
  }
  template <class Enum>
  void enumerator(const char*, Enum& value, Enum last) {
    value = last;
  }
  void protocol(const char*, std::uint32_t& number) { number = msg::PROTOCOL; }
  template <class Message>
  void nested(const char*, Message& message) {
    visit(message, *this);
  }

 private:
  int count_ = 0;
};

// What makes the fields of an example agree, where they must.
template <class Message>
void agree(Message&) {}
void agree(msg::Observation& m) {
  m.feature_dimension() = 2;
  m.features() = {0.5f, -1.0f, 1.5f, -2.0f, 2.5f, -3.0f};
}
void agree(msg::Belief& belief) {
  for (std::uint32_t place = 1; place < msg::LIKELY_PLACES; ++place)
    for (std::uint32_t agent = 0; agent < 3; ++agent) {
      belief.likely().push_back(place * 3 + agent);
      belief.probability().push_back(0.5f / static_cast<float>(1 << place));
    }
}
void agree(msg::Action& m) { agree(m.belief()); }
void agree(msg::Scene& m) { agree(m.belief()); }
void agree(msg::LogPosition& log) { log.number() = log.first() + 1; }
void agree(msg::EpisodeStat& m) {
  agree(m.log());
  m.steps() = 10;
}
void agree(msg::TrainingStat& m) { agree(m.log()); }
template <std::derived_from<msg::ObjectChunk> Chunk>
void agree(Chunk& m) {
  m.chunk() = 0;
  m.total_bytes() = 3;
}
void agree(msg::Trajectory& m) {
  agree(m.log());
  for (auto* one_more : {&m.position(), &m.goal()}) one_more->push_back(3);
  for (auto* one_more : {&m.previous_action(), &m.allowed(), &m.first()}) one_more->push_back(1);
  m.shown().push_back(-1);
  m.value().push_back(0.25f);
  m.feature_dimension() = 1;
  m.features() = {0.5f, -1.0f, 1.5f, -2.0f};
}
void agree(msg::DescriptorStatus& m) {
  m.frames() = 3 * msg::FRAMES_PER_BLOCK;
  m.dimension() = 2;
}
/// Writes "  header.sender = "env-summer"" for each field, in the order of the wire.
class Writer {
 public:
  std::string text;

  template <class Number>
  void operator()(const char* field, const Number& number) {
    line(field, fmt::format("{}", number));
  }
  template <std::size_t N>
  void operator()(const char* field, const FixedString<N>& value) {
    line(field, fmt::format("\"{}\"", value.c_str()));
  }
  template <class T>
  void operator()(const char* field, const std::vector<T>& sequence, std::size_t) {
    std::string all;
    for (const T& entry : sequence) all += fmt::format("{}{}", all.empty() ? "" : ", ", entry);
    line(field, "[" + all + "]");
  }
  template <class Enum>
  void enumerator(const char* field, Enum value, Enum) {
    line(field, std::to_string(static_cast<std::uint32_t>(value)));
  }
  void protocol(const char* field, std::uint32_t number) { line(field, std::to_string(number)); }
  template <class Message>
  void nested(const char* field, const Message& message) {
    prefix_ = std::string(field) + ".";
    visit(message, *this);
    prefix_.clear();
  }

 private:
  void line(const char* field, const std::string& value) { text += "  " + prefix_ + field + " = " + value + "\n"; }
  std::string prefix_;
};

std::string hex(const Bytes& bytes) {
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); ++i)
    text += fmt::format("{}{:02x}",
                        i == 0        ? ""
                        : i % 32 == 0 ? "\n"
                        : i % 4 == 0  ? " "
                                      : "",
                        static_cast<unsigned>(bytes[i]));
  return text + "\n";
}

/// Encoded where another message was before, as a service does.
TEST(GoldenBytes, OfEachMessage) {
  std::string all;
  std::set<std::string> types;
  for_each_message([&]<class Message>() {
    Message message;
    Example example;
    visit(message, example);
    agree(message);
    Bytes bytes(65536, std::byte{0xAA});
    encode(message, bytes);
    Message received;
    ASSERT_NO_THROW(decode(std::span<const std::byte>(bytes), received)) << topic_of<Message>().type;
    EXPECT_TRUE(encoded(received) == bytes) << topic_of<Message>().type;
    EXPECT_TRUE(fast_cdr(message) == bytes) << topic_of<Message>().type;
    Writer writer;
    visit(message, writer);
    const std::string type = topic_of<Message>().type;
    if (!types.insert(type).second) return;  // kinds of objects share it
    all += type.substr(type.rfind(':') + 1) + "\n" + writer.text + "bytes " + std::to_string(bytes.size()) + "\n" +
           hex(bytes) + "\n";
  });
  expect_golden("messages.txt", all);
}

}  // namespace
}  // namespace citylearn::testing
