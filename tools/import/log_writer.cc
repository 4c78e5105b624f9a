// SPDX-License-Identifier: Apache-2.0
#include "tools/import/log_writer.h"

#include <utility>

#include "core/util/error.h"
#include "dashboard/store/store.h"

namespace citylearn {

LogWriter::LogWriter(LogSink sink, Options options) : sink_(std::move(sink)), options_(std::move(options)) {
  if (const auto fault = fault_of_logged_id(options_.id)) throw Error(*fault, options_.id, "give another --project");
  batch_ = next_batch();
}

LogBatch LogWriter::next_batch() const {
  LogBatch next(batch_.end_record());
  next.source = options_.source;
  next.log = options_.log;
  return next;
}

void LogWriter::settle() {
  if (!taken_.valid()) return;
  if (taken_.get().other_log) throw Error("another log has this run's name", options_.id, "give another --project");
  points_ += std::exchange(under_way_, 0);
}

void LogWriter::flush() {
  if (batch_.end_record() == batch_.first() && !batch_.ended) return;
  settle();
  LogBatch next = next_batch();
  under_way_ = batch_.points().size();
  taken_ = std::async(std::launch::async,
                      [this, batch = std::exchange(batch_, std::move(next))] { return sink_(options_.id, batch); });
}

void LogWriter::begin(LogBeginning beginning) {
  flush();
  batch_.begin(std::move(beginning));
  flush();
}

void LogWriter::configure(std::string members) {
  flush();
  batch_.configure(std::move(members));
  flush();
}

void LogWriter::summarise(std::string members) {
  flush();
  batch_.summarise(std::move(members));
  flush();
}

void LogWriter::points_done() {
  batch_.points_done();
  if (batch_.points().size() >= options_.points) flush();
}

void LogWriter::finish(bool ended) {
  flush();
  batch_.ended = ended;
  flush();
  settle();
}

std::string logged_id(const std::string& project, const std::string& name) {
  return run_id(project) + "/" + run_id(name);
}

}  // namespace citylearn
