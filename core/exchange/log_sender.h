// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/exchange/incumbent.h"
#include "core/exchange/message_order.h"
#include "core/exchange/timing.h"
#include "idl/forward.h"

namespace citylearn {

/// How a LogSender sends and what it keeps.
struct LogOptions {
  std::size_t capacity = 1'000'000;  ///< records kept
  std::size_t max_readers = 64;      ///< known at a time; bounded because any process may say that it reads
  std::uint64_t resend_window = 64;  ///< records that a silent reader is sent again at a time
  std::uint64_t send_window = 1024;  ///< likewise a reader that acknowledges
  /// 0: new records go out at once. Else there is one reader, which says up to which record it has room. At most so
  /// many records are on their way to it, and it has twice the time that its last acknowledgement took.
  std::uint64_t credit_window = 0;
  bool keeps_all = false;           ///< nothing is ever dropped, so that a reader that comes late gets all
  const char* records = "records";  ///< what problem() calls them
  const char* reader = "reader";    ///< likewise
};

/// Decides when to send which record of a log, until every reader has acknowledged it. It knows the records' numbers
/// alone, and has no wire and no clock. Used by one thread.
///
/// Each record is sent once, and again to a reader that lacks it: as fast as the reader acknowledges, or, when it does
/// not, less and less often.
class LogSender {
 public:
  /// `required` names readers that are known before they are heard of. The first record has the number `first`. Beyond
  /// the capacity, the reader that is furthest behind is dropped; without readers, the oldest records are lost.
  /// problem() reports either.
  explicit LogSender(const LogOptions& options, const std::vector<std::string>& required = {}, std::uint64_t first = 1);

  /// Appends a record and returns its number.
  std::uint64_t add();

  enum class Acknowledged {
    kYes,
    kRepeated,    ///< it says nothing new, was overtaken, or is of a process that does not speak for its id
    kImpossible,  ///< it is of records that do not exist
    kTooMany,     ///< there are max_readers, of which none has left and is silent
  };
  /// Takes an acknowledgement; its sender becomes a reader. The caller checks that it is for this log.
  Acknowledged acknowledge(const msg::LogAcknowledgement& acknowledgement, Clock::time_point now);
  /// Makes the process of this header speak for its id at once (Incumbent).
  void force_successor(const msg::Header& header, Clock::time_point now);

  struct Sending {
    std::uint64_t number = 0;
    bool again = false;  ///< it was sent before
  };
  /// Returns the next record to send now, if any.
  std::optional<Sending> next(Clock::time_point now);
  /// Returns the LogPosition of a record that goes out now.
  msg::LogPosition position(std::uint64_t number, std::uint64_t stream = 0) const;
  /// Returns when next() will have something if nothing else happens before. The clock's epoch means now.
  Clock::time_point due() const;
  /// Resends at once what is not acknowledged, then at intervals that begin short, because the sender ends.
  void hurry(Clock::time_point now);

  std::uint64_t last() const { return last_; }               ///< number of the last record
  std::uint64_t sent() const { return sent_; }               ///< number of the last record that was sent
  std::uint64_t acknowledged() const { return discarded_; }  ///< owners drop their records up to this one
  std::size_t kept() const { return static_cast<std::size_t>(last_ - discarded_); }
  std::uint64_t limit() const { return limit_; }  ///< of the last acknowledgement (LogAcknowledgement)
  /// Returns whether a reader lacks records and is alive as far as is known.
  bool reader_expected(Clock::time_point now) const;
  std::vector<std::string> readers() const;
  /// Returns the readers that lack records, as far as is known, in quotes.
  std::vector<std::string> lacking() const;
  /// Says what was given up because too much was kept; empty while nothing was.
  const std::string& problem() const { return problem_; }

 private:
  struct Reader {
    bool registered = false;  ///< it has not left
    MessageOrder order;       ///< of its acknowledgements
    bool fresh = true;        ///< its present process has not acknowledged yet
    std::uint64_t acknowledged = 0;
    std::uint64_t sent = 0;   ///< records after `acknowledged` up to this one are on their way to it
    std::uint64_t limit = 0;  ///< records up to this one may be sent again
    Clock::duration interval = kLogResend;
    Clock::time_point waits_since{}, again{};  ///< from `again` on, all that is on its way counts as lost
    Incumbent presence;
    bool stopping = false;

    /// Returns false for a message of a process that does not speak for the reader's id.
    bool hear(const msg::Header& header, Clock::time_point now);
  };
  bool has_room(const std::string& name, Clock::time_point now);
  bool gives_credit() const { return options_.credit_window > 0; }
  std::uint64_t sendable() const;
  void begin_wait(Reader& reader, Clock::time_point now) const;
  void open_window(Reader& reader, std::uint64_t window, Clock::time_point now) const;
  void unregister(Reader& reader);
  void discard_acknowledged();
  void discard(std::uint64_t up_to);
  void enforce_capacity();
  template <class Log, class Visit>
  static void each_reader(Log& log, Visit visit);

  LogOptions options_;
  std::uint64_t last_ = 0, discarded_ = 0, sent_ = 0, limit_ = 0;
  std::map<std::string, Reader> readers_;  ///< with those that left, so that late messages do not bring them back
  std::size_t registered_ = 0;             ///< readers that have not left
  Reader anonymous_reader_;                ///< stands for all while no reader is registered
  Clock::duration answer_time_{};          ///< that the last acknowledgement took; only with a credit window
  std::string problem_;
};

}  // namespace citylearn
