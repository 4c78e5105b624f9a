// SPDX-License-Identifier: Apache-2.0
#include "core/util/log_format.h"

#include <spdlog/pattern_formatter.h>

#include <iterator>
#include <nlohmann/json.hpp>
#include <string_view>

namespace citylearn {
namespace {

std::string json_string(std::string_view text) {
  return nlohmann::json(text).dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
}

/// Returns the text with its control characters, also those of 8 bits (U+0080 to U+009F), written as "\x1b".
std::string without_controls(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    auto c = static_cast<unsigned char>(text[i]);
    const auto next = static_cast<unsigned char>(i + 1 < text.size() ? text[i + 1] : 0);
    const bool wide = c == 0xC2 && next >= 0x80 && next < 0xA0;  // one of 8 bits in UTF-8
    if (wide) {
      c = next;
      ++i;
    }
    if (wide || c < ' ' || c == 0x7F)
      fmt::format_to(std::back_inserter(plain), "\\x{:02x}", c);
    else
      plain += static_cast<char>(c);
  }
  return plain;
}

/// The flag %* of a pattern: the message, as `written`.
class MessageFlag : public spdlog::custom_flag_formatter {
 public:
  using Written = std::string (*)(std::string_view);
  explicit MessageFlag(Written written) : written_(written) {}
  void format(const spdlog::details::log_msg& message, const std::tm&, spdlog::memory_buf_t& line) override {
    const std::string text = written_({message.payload.data(), message.payload.size()});
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<MessageFlag>(written_); }

 private:
  const Written written_;
};

std::unique_ptr<spdlog::formatter> with_message(MessageFlag::Written written, const std::string& pattern) {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<MessageFlag>('*', written).set_pattern(pattern);
  return formatter;
}

/// Returns a JSON string as a part of a pattern.
std::string literally(const std::string& text) {
  std::string pattern;
  for (const char c : json_string(text)) pattern += c == '%' ? "%%" : std::string(1, c);
  return pattern;
}

}  // namespace

std::unique_ptr<spdlog::formatter> text_log_format(bool terminal) {
  return with_message(without_controls, std::string(terminal ? "\r\033[K" : "") + "%H:%M:%S.%e %^%L%$ [%n] %*");
}

std::unique_ptr<spdlog::formatter> json_log_format(const std::string& session, const std::string& service) {
  return with_message(json_string, R"({"time":"%Y-%m-%dT%H:%M:%S.%e%z","level":"%l","session":)" + literally(session) +
                                       R"(,"service":)" + literally(service) + R"(,"text":%*})");
}

}  // namespace citylearn
