// SPDX-License-Identifier: Apache-2.0
#include <zlib.h>

#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "core/files/json.h"
#include "core/files/tf_records.h"
#include "dashboard/api/log_frame.h"
#include "tests/fuzz/targets.h"
#include "tests/support/files.h"
#include "tools/import/event_files.h"
#include "tools/import/wandb_file.h"

namespace citylearn::fuzz {
namespace {

/// Returns a run of W&B that has one record, with its checksum.
std::string sealed_wandb(std::string record) {
  record = record.substr(0, 32768 - 14);  // what the first block has room for
  const std::string type_and_record = '\x01' + record;
  const auto* bytes = reinterpret_cast<const Bytef*>(type_and_record.data());
  const auto crc = static_cast<std::uint32_t>(::crc32_z(0, bytes, type_and_record.size()));
  const auto length = static_cast<std::uint16_t>(record.size());
  std::string file(":W&B\xE1\xBE\0", 7);
  file.append(reinterpret_cast<const char*>(&crc), 4);
  file.append(reinterpret_cast<const char*>(&length), 2);
  return file + type_and_record;
}

/// Reads points that are sent as numbers.
bool log_frame_of(const std::string& frame) {
  return accepted([&] {
    const LogBatch batch = parse_log_frame(frame);
    require(batch.end_record() > batch.first() && !batch.points().empty(), "a frame has points");
    for (const LoggedPoint& point : batch.points()) {
      require(point.record >= batch.first() && point.record < batch.end_record(), "a point is in its batch");
      require(point.metric < batch.metrics().size(), "a point has a metric");
    }
    const LogBatch again = parse_log_frame(log_frame(batch, 0, batch.points().size(), true));
    require(again.end_record() == batch.end_record() && again.ended == batch.ended, "what is read can be sent");
  });
}

}  // namespace

bool logged_run(Input input) {
  if (input.empty()) return false;
  const bool frame = (static_cast<int>(input[0]) & 4) != 0;
  if (frame) return log_frame_of({reinterpret_cast<const char*>(input.data()) + 1, input.size() - 1});
  static const testing::Folder folder;
  const int kind = static_cast<int>(input[0]) & 3;
  std::string text(reinterpret_cast<const char*>(input.data()) + 1, input.size() - 1);
  if (kind == 1) text = tf_record(text);
  if (kind == 3) text = sealed_wandb(text);
  const bool wandb = kind >= 2;
  const std::string path = folder / (wandb ? "run-a.wandb" : "events.out.tfevents.1");
  {
    std::ofstream file(path, std::ios::binary | std::ios::trunc);
    file.write(text.data(), static_cast<std::streamsize>(text.size()));
  }
  std::uint64_t next = 1, points = 0;
  const LogSink sink = [&](const std::string& id, const LogBatch& batch) {
    require(!fault_of_logged_id(id), "a run has a right ID");
    require(batch.first() == next, "records follow each other");
    next = batch.end_record();
    for (const LoggedPoint& point : batch.points()) {
      require(point.record >= batch.first() && point.record < next, "a point is in its batch");
      require(batch.metrics().at(point.metric).size() <= kLongestMetric, "names are bounded");
      ++points;
    }
    for (const std::string& members : batch.config())
      require(parse_json_or_null(members).is_object(), "options are an object");
    return LoggedRuns::Outcome{next - 1, false};
  };
  ImportedRun run;
  const bool good = accepted([&] {
    run = wandb ? import_wandb_file(path, "", sink) : import_event_files({path}, "tensorboard/a", sink);
    require(run.points == points, "points are counted");
  });
  return good && points > 0 && run.problem.empty();
}

}  // namespace citylearn::fuzz
