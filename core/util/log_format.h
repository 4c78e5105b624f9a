// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

namespace spdlog {
class formatter;
}

namespace citylearn {

// How log lines are written. Texts name services and topics of other processes, so nothing in them may begin another
// line or command a terminal.

/// Returns the format for people: "12:30:01.123 I [env_service] text", control characters of the text written as
/// "\x1b". On a terminal a line first clears what stands there, as a progress bar does not end its line.
std::unique_ptr<spdlog::formatter> text_log_format(bool terminal = false);

/// Returns the format for programs: a line is a JSON object with time, level, session, service and text, in ASCII. What
/// is not UTF-8 is replaced.
std::unique_ptr<spdlog::formatter> json_log_format(const std::string& session, const std::string& service);

}  // namespace citylearn
