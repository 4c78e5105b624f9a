// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

// How log lines are written. Texts name services and topics of other processes, so nothing in them may begin another
// line or command a terminal.

/// Makes all lines those for people from now on: "12:30:01.123 I [env_service] text", control characters of the text
/// written as "\x1b". On a terminal a line first clears what stands there, as a progress bar does not end its line. In
/// the journal, which notes the time, lines have none.
void use_text_log(bool terminal = false);

/// The service that lines of JSON name. It is set anew as more of it is known.
struct LogIdentity {
  std::string session, service, id;
};
void set_log_identity(const LogIdentity& identity);

/// Makes all lines JSON from now on: an object with time (UTC), level, session, service, id and message, in ASCII. What
/// is not UTF-8 is replaced.
void use_json_log();
bool is_json_log();

/// Writes a line to standard error that is not of the log, such as progress, as it is or, with use_json_log(), as one
/// of the log.
void print_line(const std::string& line);

/// Prints the last line of a process that ends. It takes no memory and no lock.
void print_last_line(const char* program, const char* what, const char* more = "") noexcept;

}  // namespace citylearn
