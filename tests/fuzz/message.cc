// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>

#include "core/recording/wire_header.h"
#include "core/wire/messages.h"
#include "tests/fuzz/messages.h"
#include "tests/support/records/fast_cdr.h"
#include "tests/support/records/samples.h"

// The sanitizers' own; absent where there is none. What decode() may allocate is then left to messages_test.
// NOLINTNEXTLINE: their name
extern "C" __attribute__((weak)) int __sanitizer_install_malloc_and_free_hooks(void (*allocated)(const volatile void*,
                                                                                                 std::size_t),
                                                                               void (*freed)(const volatile void*));

namespace citylearn::fuzz {
namespace {

using testing::Size;

constexpr std::size_t kError = 4096;  // bytes that an Error and its texts may need

thread_local std::size_t allocated_bytes = 0;  // ever, by this thread
void count_bytes(const volatile void*, std::size_t size) { allocated_bytes += size; }
void count_nothing(const volatile void*) {}

/// decode(), held to its promises about errors and memory. True when the bytes were taken.
template <class Message>
bool decoded(Input bytes, Message& message) {
  static const std::string& type = topic_of<Message>().type;
  const std::size_t before = allocated_bytes;
  const bool taken = accepted([&] {
    try {
      decode(bytes, message);
    } catch (const Error& error) {
      require(std::string_view(error.what()).starts_with(type), "an Error names the type");
      throw;
    }
  });
  require(allocated_bytes - before <= bytes.size() + kError, "no more is allocated than the bytes can hold");
  return taken;
}

template <class Message>
bool run(Input input) {
  Message message;
  const auto header = header_of(input);
  if (!decoded(input, message)) return false;

  // Bytes are compared, not numbers: where NaN is let through, its bits stay as they came.
  const Bytes bytes = testing::encoded(message);
  require(bytes.size() <= topic_of<Message>().largest, "what was taken can be sent");
  require(bytes.size() <= input.size() && input.size() - bytes.size() <= 3, "nothing but padding is left out");
  Message again = testing::sample_of<Message>(Size::kTypical);  // nothing of it may shine through
  require(decoded(bytes, again), "what was written is taken");
  require(testing::encoded(again) == bytes, "a second time round changes nothing");

  // What recorders do without knowing the type.
  require(header && header->protocol == message.header().protocol() &&
              header->session == message.header().session().c_str() &&
              header->sender == message.header().sender().c_str() &&
              header->incarnation == message.header().incarnation() && header->message == message.header().message(),
          "the header is found without the type");
  Bytes renamed;
  require(with_session(input, "another", renamed) && decoded(renamed, again), "another run");
  require(std::string_view(again.header().session().c_str()) == "another", "has its name");
  again.header().session(header->session);
  require(testing::encoded(again) == bytes, "and all else as before");
  return true;
}

void agree(msg::RouteMap& m) { m.position().resize(std::max<std::size_t>(1, m.position().size())); }
void agree(msg::Descriptor& m) { m.dimension() = 3; }
template <class Object>
void agree(Object&) {}

/// The bytes of an object of this kind.
template <class Object>
Bytes object_of(Size size) {
  testing::Filler filler(size);
  Object object;
  visit(object, filler);
  agree(object);
  return encode_object(object);
}

/// decode_object(), held to the same promises.
template <class Object>
bool run_object(Input input) {
  const std::size_t before = allocated_bytes;
  Object object;
  if (!accepted([&] { object = decode_object<Object>(input); })) return false;
  require(allocated_bytes - before <= input.size() + kError, "no more is allocated than the bytes can hold");
  const Bytes bytes = encode_object(object);
  require(bytes.size() <= input.size() && input.size() - bytes.size() <= 3, "nothing but padding is left out");
  require(encode_object(decode_object<Object>(bytes)) == bytes, "a second time round changes nothing");
  return true;
}

}  // namespace

const std::map<std::string, MessageTarget>& message_targets() {
  static const auto targets = [] {
    if (__sanitizer_install_malloc_and_free_hooks)
      __sanitizer_install_malloc_and_free_hooks(count_bytes, count_nothing);
    std::map<std::string, MessageTarget> all;
    testing::for_each_message([&]<class Message>() {
      const std::string& topic = topic_of<Message>().name;
      MessageTarget& target = all[topic.substr(topic.find('/') + 1)];
      const auto least = testing::sample_of<Message>(Size::kMin), typical = testing::sample_of<Message>(Size::kTypical);
      target.seeds = {{"least", testing::encoded(least)},
                      {"typical", testing::encoded(typical)},
                      {"big-endian", testing::fast_cdr(typical, true)}};
      target.run = run<Message>;
    });
#define CITYLEARN_FUZZ_OBJECT(TYPE)                                                 \
  all["object_" #TYPE].seeds = {{"least", object_of<msg::TYPE>(Size::kMin)},        \
                                {"typical", object_of<msg::TYPE>(Size::kTypical)}}; \
  all["object_" #TYPE].run = run_object<msg::TYPE>;
    CITYLEARN_OBJECTS(CITYLEARN_FUZZ_OBJECT)
    require(!__sanitizer_install_malloc_and_free_hooks || allocated_bytes > 0, "memory is counted");
    return all;
  }();
  return targets;
}

bool message(Input input) {
  static const MessageTarget& target = [&]() -> const MessageTarget& {
    const char* name = std::getenv("CITYLEARN_FUZZ_MESSAGE");
    const auto found = message_targets().find(name ? name : "");
    require(found != message_targets().end(), "CITYLEARN_FUZZ_MESSAGE names a type, as 'observation'");
    return found->second;
  }();
  return target.run(input);
}

}  // namespace citylearn::fuzz
