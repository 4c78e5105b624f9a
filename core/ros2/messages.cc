// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/messages.h"

#include <array>
#include <vector>

#include "core/wire/cdr.h"
#include "ros2/ros2_fields.h"

namespace citylearn {
namespace {

/// Reads fields. Lengths are checked before anything is allocated.
class Reader {
 public:
  explicit Reader(CdrReader& cdr) : cdr_(cdr) {}

  template <class Number>
  void operator()(const char*, Number& number) {
    cdr_.read(&number, 1);
  }
  void operator()(const char*, std::string& text) {
    text.resize(length_that_fits());  // with a zero at its end
    cdr_.read(text.data(), text.size());
    if (!text.empty()) text.pop_back();
  }
  void operator()(const char*, std::vector<std::uint8_t>& octets) {
    octets.resize(length_that_fits());
    cdr_.read(octets.data(), octets.size());
  }
  template <class Number, std::size_t N>
  void operator()(const char*, std::array<Number, N>& numbers) {
    cdr_.read(numbers.data(), N);
  }
  template <class Message>
  void nested(const char*, Message& message) {
    visit(message, *this);
  }
  template <class Message>
  void sequence(const char*, std::vector<Message>& messages) {
    messages.clear();
    for (std::uint32_t left = length_that_fits(); left > 0; --left) visit(messages.emplace_back(), *this);
  }

 private:
  std::uint32_t length_that_fits() {
    const std::uint32_t length = cdr_.read_length();
    if (length > cdr_.left()) throw CdrError{"cut short"};
    return length;
  }

  CdrReader& cdr_;
};

class Writer : public CdrWriter {
 public:
  using CdrWriter::CdrWriter;

  template <class Message>
  void nested(const char*, const Message& message) {
    visit(message, *this);
  }
  template <class Message>
  void sequence(const char*, const std::vector<Message>& messages) {
    (*this)("", static_cast<std::uint32_t>(messages.size()));
    for (const Message& message : messages) visit(message, *this);
  }
};

}  // namespace

template <class Message>
void encode_ros2(const Message& message, Bytes& bytes) {
  Writer writer(bytes);
  visit(message, writer);
}

template <class Message>
bool decode_ros2(std::span<const std::byte> bytes, Message& message) {
  try {
    CdrReader cdr(bytes);
    Reader reader(cdr);
    visit(message, reader);
    return true;
  } catch (const CdrError&) {
    return false;
  }
}

#define CITYLEARN_ROS2_TYPE(PACKAGE, KIND, TYPE, HASH, SERVICE_HASH, SCHEMA)                                         \
  template <>                                                                                                        \
  const Ros2Type& ros2_type_of<PACKAGE::KIND::dds_::TYPE##_>() {                                                     \
    static const Ros2Type type{#PACKAGE "/" #KIND "/" #TYPE, #PACKAGE "::" #KIND "::dds_::" #TYPE "_", HASH, SCHEMA, \
                               SERVICE_HASH};                                                                        \
    return type;                                                                                                     \
  }                                                                                                                  \
  template void encode_ros2(const PACKAGE::KIND::dds_::TYPE##_& message, Bytes& bytes);                              \
  template bool decode_ros2(std::span<const std::byte> bytes, PACKAGE::KIND::dds_::TYPE##_& message);
#include "ros2/ros2_types.inc"
#undef CITYLEARN_ROS2_TYPE

const Ros2Type* ros2_type(const std::string& name) {
#define CITYLEARN_ROS2_TYPE(PACKAGE, KIND, TYPE, HASH, SERVICE_HASH, SCHEMA) \
  if (name == #PACKAGE "/" #KIND "/" #TYPE) return &ros2_type_of<PACKAGE::KIND::dds_::TYPE##_>();
#include "ros2/ros2_types.inc"
  return nullptr;
}

}  // namespace citylearn
