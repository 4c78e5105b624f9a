// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <concepts>
#include <limits>
#include <string_view>

#include "core/task/action.h"
#include "core/wire/messages.h"
#include "idl/message_fields.h"

namespace citylearn::testing {

/// The fill of a message: everything empty or zero, something of everything, or sequences and strings at their bounds.
enum class Size { kMin, kTypical, kMax };

/// Gives each field a value of its own, so that two fields that change places are noticed.
class Filler {
 public:
  explicit Filler(Size size) : size_(size) {}

  template <class Number>
  void operator()(const char*, Number& number) {
    ++count_;
    const int value = count_ * 7 + 1;
    if (size_ == Size::kMin)
      number = Number{};
    else if (size_ == Size::kTypical)
      number = static_cast<Number>(value);
    else if constexpr (std::is_floating_point_v<Number>)
      number = static_cast<Number>(-1e30 - count_ * 1e28);
    else
      number = static_cast<Number>(std::numeric_limits<Number>::max() - static_cast<Number>(count_));
  }
  void operator()(const char*, bool& flag) { flag = size_ != Size::kMin; }
  template <std::size_t N>
  void operator()(const char* field, FixedString<N>& text) {
    ++count_;
    const bool required = std::string_view("sender receiver environment writer").find(field) != std::string_view::npos;
    const std::size_t length = size_ == Size::kMin ? required : size_ == Size::kTypical ? N / 3 : N;
    std::string filled(length, static_cast<char>('a' + count_ % 26));
    if (length > 1 && N > 64) filled.replace(0, 2, "\xC3\xA9");  // two bytes, one letter; the shorter ones are names
    text = filled;
  }
  template <class T>
  void operator()(const char*, std::vector<T>& sequence, std::size_t bound) {
    resize(sequence, 16, bound);
  }
  template <class Enum>
  void enumerator(const char*, Enum& value, Enum last) {
    value = size_ == Size::kMin ? Enum{} : size_ == Size::kTypical ? static_cast<Enum>(last / 2) : last;
  }
  void protocol(const char*, std::uint32_t& number) { number = msg::PROTOCOL; }
  template <class Message>
  void nested(const char*, Message& message) {
    visit(message, *this);
  }

  /// Gives a sequence no, `typical` or `bound` entries, each with a value of its own.
  template <class T>
  void resize(std::vector<T>& sequence, std::size_t typical, std::size_t bound) {
    ++count_;
    sequence.resize(least() ? 0 : most() ? bound : typical);
    for (std::size_t i = 0; i < sequence.size(); ++i) sequence[i] = static_cast<T>((i + 1) * (count_ + 2));
  }
  bool most() const { return size_ == Size::kMax; }
  bool least() const { return size_ == Size::kMin; }

 private:
  Size size_;
  int count_ = 0;
};

/// Makes octets actions, or ends of episodes; `instead` replaces what is neither.
inline void make_actions(std::vector<std::uint8_t>& octets, std::uint8_t instead = kStay) {
  for (std::uint8_t& octet : octets) octet = static_cast<std::uint8_t>(octet % 4 == 3 ? instead : octet % 4);
}

// What makes the fields of a message agree with each other, where they must.
template <class Message>
void agree(Filler&, Message&) {}

inline void agree(Filler& f, msg::Observation& m) {
  make_actions(m.previous_action(), kNoAction);
  f.resize(m.features(), 16 * 64, msg::MAX_FEATURES);
  m.feature_dimension(m.frame().empty() ? 0 : static_cast<std::uint32_t>(m.features().size() / m.frame().size()));
}

inline void agree(Filler& f, msg::Belief& belief) {
  f.resize(belief.likely(), 16 * msg::LIKELY_PLACES, msg::MAX_LIKELY);
  f.resize(belief.probability(), 16 * msg::LIKELY_PLACES, msg::MAX_LIKELY);
}

inline void agree(Filler& f, msg::Action& m) {
  make_actions(m.choice());
  agree(f, m.belief());
}

inline void agree(Filler& f, msg::Scene& m) { agree(f, m.belief()); }

inline void agree(Filler&, msg::LogPosition& log) {
  log.first() = std::max<std::uint64_t>(1, log.number() / 2);
  log.number() = std::max(log.number(), log.first());
}

inline void agree(Filler& f, msg::EpisodeStat& m) {
  agree(f, m.log());
  m.steps(static_cast<std::uint32_t>(m.path().size() * 4));
}

inline void agree(Filler& f, msg::TrainingStat& m) {
  agree(f, m.log());
  m.reward(std::numeric_limits<float>::quiet_NaN());
  m.gradient_norm(std::numeric_limits<float>::infinity());
}

inline void agree(Filler& f, msg::Trajectory& m) {
  agree(f, m.log());
  const std::size_t steps = f.least() ? 0 : f.most() ? msg::MAX_STEPS : 32;
  const auto fill = [&](std::size_t size, auto&... sequences) { (f.resize(sequences, size, size), ...); };
  fill(steps, m.action(), m.log_probability(), m.reward(), m.ended(), m.final_value());
  fill(steps + 1, m.shown(), m.position(), m.goal(), m.previous_action(), m.allowed(), m.first(), m.value());
  if (f.least()) {  // no step is one observation
    const auto one = [](auto&... sequences) { (sequences.resize(1), ...); };
    one(m.shown(), m.position(), m.goal(), m.previous_action(), m.allowed(), m.first(), m.value());
  }
  make_actions(m.action());
  make_actions(m.ended());
  make_actions(m.previous_action(), kNoAction);
  m.feature_dimension(f.least() ? 0 : f.most() ? msg::MAX_TRAJECTORY / msg::MAX_STEPS_AND_ONE : 64);
  m.features(std::vector<float>(m.shown().size() * m.feature_dimension(), 0.25f));
}

inline void agree(Filler& f, msg::TraversalInfo& m) {
  m.frames(f.least() ? 1 : f.most() ? msg::MAX_FRAMES : 500);
  m.feature_dimension(f.least() ? 0 : f.most() ? msg::MAX_DIMENSION : 64);
  m.agents(f.least() ? 1 : f.most() ? msg::MAX_AGENTS : 16);
}

template <std::derived_from<msg::ObjectChunk> Chunk>
void agree(Filler& f, Chunk& m) {
  f.resize(m.data(), 5000, msg::MAX_CHUNK);
  m.chunk(f.least() ? 0 : 2);
  m.total_bytes(f.least() ? 0 : static_cast<std::uint32_t>(2 * msg::MAX_CHUNK + m.data().size()));
}

inline void agree(Filler& f, msg::DescriptorStatus& m) {
  m.frames(f.least() ? 1 : f.most() ? msg::MAX_FRAMES : 16 * msg::FRAMES_PER_BLOCK - 5);
  m.dimension(f.least() ? 0 : f.most() ? msg::MAX_DESCRIPTOR : 128);
  for (std::uint32_t& block : m.encoding()) block %= static_cast<std::uint32_t>(m.present().size());
}

template <class Message>
Message sample_of(Size size) {
  Filler filler(size);
  Message message;
  visit(message, filler);
  agree(filler, message);
  return message;
}

template <class Message>
Bytes encoded(const Message& message) {
  Bytes bytes;
  encode(message, bytes);
  return bytes;
}

/// Equal in every field, NaN included: the same bytes.
template <class Message>
bool equal(const Message& a, const Message& b) {
  return encoded(a) == encoded(b);
}

/// Calls `each.template operator()<Message>()` for every message type.
template <class Each>
void for_each_message(Each each) {
#define CITYLEARN_EACH(TYPE, NAME, PROFILE, ADDRESSING) each.template operator()<msg::TYPE>();
  CITYLEARN_MESSAGES(CITYLEARN_EACH)
#undef CITYLEARN_EACH
}

}  // namespace citylearn::testing
