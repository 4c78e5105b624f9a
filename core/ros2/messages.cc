// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/messages.h"

#include <fastcdr/exceptions/Exception.h>

#include <array>
#include <type_traits>
#include <vector>

#include "core/wire/cdr.h"
#include "ros2/ros2_fields.h"

namespace citylearn {
namespace {

/// Reads fields. fastcdr itself allocates whatever length the bytes claim, so lengths are checked first.
class Reader {
 public:
  Reader(eprosima::fastcdr::Cdr& cdr, std::size_t size) : cdr_(cdr), size_(size) {}

  template <class Field>
  void operator()(Field& field) {
    if constexpr (std::is_arithmetic_v<Field>)
      cdr_ >> field;
    else
      visit(field, *this);
  }
  void operator()(std::string& text) {
    const std::uint32_t length = read_length();  // with a zero at its end
    text.resize(length);
    if (length > 0) cdr_.deserializeArray(text.data(), length);
    text.resize(length > 0 ? length - 1 : 0);
  }
  void operator()(std::vector<std::uint8_t>& octets) {
    octets.resize(read_length());
    if (!octets.empty()) cdr_.deserializeArray(octets.data(), octets.size());
  }
  template <class Number, std::size_t N>
  void operator()(std::array<Number, N>& numbers) {
    cdr_.deserializeArray(numbers.data(), N);
  }

 private:
  std::uint32_t read_length() {
    std::uint32_t length = 0;
    cdr_ >> length;
    if (length > size_ - cdr_.getSerializedDataLength())
      throw eprosima::fastcdr::exception::NotEnoughMemoryException("a length beyond the message");
    return length;
  }

  eprosima::fastcdr::Cdr& cdr_;
  const std::size_t size_;
};

}  // namespace

template <class Message>
void encode_ros2(const Message& message, Bytes& bytes) {
  write_cdr(message, bytes);
}

template <class Message>
bool decode_ros2(std::span<const std::byte> bytes, Message& message) {
  // 0 and 1 are plain CDR; fastcdr also reads parameter lists, which no node of ROS 2 sends.
  if (bytes.size() < kEncapsulation || bytes[0] != std::byte{0} || std::to_integer<int>(bytes[1]) > 1) return false;
  char* const data = const_cast<char*>(reinterpret_cast<const char*>(bytes.data()));  // NOLINT: it is only read
  eprosima::fastcdr::FastBuffer buffer(data, bytes.size());
  eprosima::fastcdr::Cdr cdr(buffer, eprosima::fastcdr::Cdr::LITTLE_ENDIANNESS, eprosima::fastcdr::Cdr::DDS_CDR);
  Reader reader(cdr, bytes.size());
  try {
    cdr.read_encapsulation();
    reader(message);
    return true;
  } catch (const eprosima::fastcdr::exception::Exception&) {
    return false;
  }
}

#define CITYLEARN_ROS2_TYPE(PACKAGE, TYPE, SCHEMA)                                                  \
  template <>                                                                                       \
  const Ros2Type& ros2_type_of<PACKAGE::msg::dds_::TYPE##_>() {                                     \
    static const Ros2Type type{#PACKAGE "/msg/" #TYPE, #PACKAGE "::msg::dds_::" #TYPE "_", SCHEMA}; \
    return type;                                                                                    \
  }                                                                                                 \
  template void encode_ros2(const PACKAGE::msg::dds_::TYPE##_& message, Bytes& bytes);              \
  template bool decode_ros2(std::span<const std::byte> bytes, PACKAGE::msg::dds_::TYPE##_& message);
#include "ros2/ros2_types.inc"

}  // namespace citylearn
