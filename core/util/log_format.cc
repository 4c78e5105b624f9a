// SPDX-License-Identifier: Apache-2.0
#include "core/util/log_format.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <iostream>
#include <iterator>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>

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

void set_format(MessageFlag::Written written, spdlog::pattern_time_type time, const std::string& pattern) {
  auto formatter = std::make_unique<spdlog::pattern_formatter>(time);
  formatter->add_flag<MessageFlag>('*', written).set_pattern(pattern);
  spdlog::set_formatter(std::move(formatter));
}

/// Kept until the very end, as threads of libraries still log when globals are gone already.
struct Shared {
  std::mutex mutex;
  LogIdentity identity;
  std::atomic<bool> json{false};
};
Shared& shared() {
  static Shared& kept = *new Shared;
  return kept;
}

/// Returns the members of a line of JSON that follow its level.
std::string json_members(std::string_view message) {
  const std::lock_guard lock(shared().mutex);
  const LogIdentity& of = shared().identity;
  return fmt::format(R"("session":{},"service":{},"id":{},"message":{})", json_string(of.session),
                     json_string(of.service), json_string(of.id), json_string(message));
}

/// Returns whether standard error goes to systemd's journal.
bool is_journal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat error {};
  return stream && fstat(STDERR_FILENO, &error) == 0 && fmt::format("{}:{}", error.st_dev, error.st_ino) == stream;
}

}  // namespace

void use_text_log(bool terminal) {
  shared().json = false;
  set_format(without_controls, spdlog::pattern_time_type::local,
             std::string(terminal ? "\r\033[K" : "") + (is_journal() ? "" : "%H:%M:%S.%e ") + "%^%L%$ [%n] %*");
}

void set_log_identity(const LogIdentity& identity) {
  const std::lock_guard lock(shared().mutex);
  shared().identity = identity;
}

void use_json_log() {
  shared().json = true;
  set_format(json_members, spdlog::pattern_time_type::utc, R"({"time":"%Y-%m-%dT%H:%M:%S.%eZ","level":"%l",%*})");
}

bool is_json_log() { return shared().json; }

void print_line(const std::string& line) {
  if (is_json_log())
    spdlog::info("{}", line);
  else
    std::cerr << line << std::endl;
}

void print_last_line(const char* program, const char* what, const char* more) noexcept {
  char text[1024];
  std::size_t size = 0;
  const auto add = [&](const char* part, bool escape) {
    for (; *part && size + (escape ? 8 : 1) < sizeof text; ++part) {  // there is always room for the end
      const char c = *part;
      text[size++] = escape && (c < ' ' || c == '"' || c == '\\' || c == 0x7F) ? '?' : c;
    }
  };
  const bool json = is_json_log();
  if (json) add(R"({"level":"critical","service":")", false);
  add(program, json);
  add(json ? R"(","message":")" : ": ", false);
  add(what, json);
  add(more, json);
  add(json ? "\"}" : "", false);
  text[size++] = '\n';
  if (write(STDERR_FILENO, text, size) < 0) return;  // no other way to report is left
}

}  // namespace citylearn
