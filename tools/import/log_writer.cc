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

void LogWriter::flush() {
  if (batch_.end_record() == batch_.first() && !batch_.ended) return;
  if (sink_(options_.id, batch_).other_log)
    throw Error("another log has this run's name", options_.id, "give another --project");
  points_ += batch_.points().size();
  batch_ = next_batch();
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
}

std::string logged_id(const std::string& project, const std::string& name) {
  return run_id(project) + "/" + run_id(name);
}

}  // namespace citylearn
