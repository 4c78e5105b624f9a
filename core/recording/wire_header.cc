// SPDX-License-Identifier: Apache-2.0
#include "core/recording/wire_header.h"

#include <algorithm>
#include <cstring>

namespace citylearn {
namespace {

constexpr std::size_t kEncapsulation = 4;  // alignment counts from behind it
constexpr std::size_t kMaxNameBytes = 64;  // characters of a name

/// Goes over the fields of a Header in CDR of either byte order.
class Walk {
 public:
  explicit Walk(std::span<const std::byte> message) : bytes_(message) {
    const auto at = [&](std::size_t i) { return i < message.size() ? std::to_integer<int>(message[i]) : -1; };
    good_ = at(0) == 0 && (at(1) == 0 || at(1) == 1) && message.size() >= kEncapsulation;  // CDR_BE, CDR_LE
    little_ = at(1) == 1;
  }
  template <class Number>
  Number number() {
    align(sizeof(Number));
    Number value = 0;
    if (!has(sizeof value)) return value;
    for (std::size_t i = 0; i < sizeof value; ++i) {
      const std::size_t place = little_ ? sizeof value - 1 - i : i;
      value = static_cast<Number>(value << 8 | std::to_integer<Number>(bytes_[at_ + place]));
    }
    at_ += sizeof value;
    return value;
  }
  std::string text() {
    const auto length = number<std::uint32_t>();  // with the NUL at its end
    if (length == 0 || length > kMaxNameBytes + 1) good_ = false;
    if (!has(length)) return {};
    std::string value(reinterpret_cast<const char*>(bytes_.data()) + at_, length - 1);
    at_ += length;
    return value;
  }
  void align(std::size_t size) { at_ += (size - (at_ - kEncapsulation) % size) % size; }
  bool good() const { return good_; }
  bool little() const { return little_; }
  std::size_t at() const { return at_; }

 private:
  bool has(std::size_t size) { return good_ = good_ && at_ <= bytes_.size() && size <= bytes_.size() - at_; }

  std::span<const std::byte> bytes_;
  std::size_t at_ = kEncapsulation;
  bool good_ = false, little_ = true;
};

void append(Bytes& to, const std::string& name, bool little) {
  to.resize(kEncapsulation + (to.size() - kEncapsulation + 3) / 4 * 4);
  const auto length = static_cast<std::uint32_t>(name.size() + 1);
  for (int i = 0; i < 4; ++i) to.push_back(static_cast<std::byte>(length >> 8 * (little ? i : 3 - i)));
  const auto* text = reinterpret_cast<const std::byte*>(name.c_str());
  to.insert(to.end(), text, text + length);
}

}  // namespace

std::optional<WireHeader> header_of(std::span<const std::byte> message) {
  Walk walk(message);
  WireHeader header;
  header.protocol = walk.number<std::uint32_t>();
  header.session = walk.text();
  header.sender = walk.text();
  header.incarnation = walk.number<std::uint64_t>();
  header.message = walk.number<std::uint64_t>();
  if (!walk.good()) return std::nullopt;
  return header;
}

bool with_session(std::span<const std::byte> message, const std::string& session, Bytes& to) {
  Walk walk(message);
  walk.number<std::uint32_t>();
  const std::size_t first = walk.at();
  walk.text();
  const std::string sender = walk.text();
  // The incarnation lies on a multiple of 8, the widest alignment there is, before and after: so does all behind it.
  walk.align(sizeof(std::uint64_t));
  const std::size_t rest = walk.at();
  walk.number<std::uint64_t>();
  walk.number<std::uint64_t>();
  if (!walk.good() || session.size() > kMaxNameBytes) return false;
  to.assign(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(first));
  append(to, session, walk.little());
  append(to, sender, walk.little());
  to.resize(kEncapsulation + (to.size() - kEncapsulation + 7) / 8 * 8);
  to.insert(to.end(), message.begin() + static_cast<std::ptrdiff_t>(rest), message.end());
  return true;
}

}  // namespace citylearn
