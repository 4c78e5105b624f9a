// SPDX-License-Identifier: Apache-2.0
#include "core/recording/wire_header.h"

#include "core/wire/cdr.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxNameBytes = 64;  // characters of a name

std::string read_name(CdrReader& cdr) {
  const std::uint32_t length = cdr.read_length();  // with the NUL at its end
  if (length == 0 || length > kMaxNameBytes + 1) throw CdrError{"not a name"};
  std::string name(length, 0);
  cdr.read(name.data(), length);
  name.pop_back();
  return name;
}

/// A header and the places of two of its fields.
struct Found {
  WireHeader header;
  std::size_t session = 0, incarnation = 0;
};

/// Reads the fields of a Header in CDR of either byte order.
std::optional<Found> find_header(std::span<const std::byte> message) try {
  CdrReader cdr(message);
  Found found;
  found.header.protocol = cdr.read_length();
  found.session = message.size() - cdr.left();
  found.header.session = read_name(cdr);
  found.header.sender = read_name(cdr);
  cdr.read(&found.header.incarnation, 1);
  found.incarnation = message.size() - cdr.left() - sizeof found.header.incarnation;
  cdr.read(&found.header.message, 1);
  return found;
} catch (const CdrError&) {
  return std::nullopt;
}

void pad(Bytes& to, std::size_t size) { to.resize(to.size() + cdr_padding(to.size() - kEncapsulation, size)); }

void append(Bytes& to, const std::string& name, bool little) {
  pad(to, sizeof(std::uint32_t));
  const auto length = static_cast<std::uint32_t>(name.size() + 1);
  for (int i = 0; i < 4; ++i) to.push_back(static_cast<std::byte>(length >> 8 * (little ? i : 3 - i)));
  const auto* text = reinterpret_cast<const std::byte*>(name.c_str());
  to.insert(to.end(), text, text + length);
}

}  // namespace

std::optional<WireHeader> header_of(std::span<const std::byte> message) {
  const auto found = find_header(message);
  return found ? std::optional(found->header) : std::nullopt;
}

bool with_session(std::span<const std::byte> message, const std::string& session, Bytes& to) {
  const auto found = find_header(message);
  if (!found || session.size() > kMaxNameBytes) return false;
  const bool little = message[1] == std::byte{1};
  to.assign(message.begin(), message.begin() + static_cast<std::ptrdiff_t>(found->session));
  append(to, session, little);
  append(to, found->header.sender, little);
  // The incarnation lies on a multiple of 8, the widest alignment there is, before and after: so does all behind it.
  pad(to, sizeof(std::uint64_t));
  to.insert(to.end(), message.begin() + static_cast<std::ptrdiff_t>(found->incarnation), message.end());
  return true;
}

}  // namespace citylearn
