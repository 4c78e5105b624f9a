// SPDX-License-Identifier: Apache-2.0
#include "tools/import/wandb_file.h"

#include <zlib.h>

#include <cstring>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "core/files/json.h"
#include "core/util/error.h"
#include "dashboard/http/answer.h"
#include "tools/import/mapped_file.h"
#include "tools/import/wire_fields.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kBlock = 32768, kHead = 7;  // of a record: CRC-32, length, type
constexpr std::string_view kFileHead{":W&B\xE1\xBE\0", 7};
enum RecordType { kFull = 1, kFirst = 2, kMiddle = 3, kLast = 4 };

// Field numbers of wandb_internal.proto.
enum Record { kHistory = 2, kSummary = 3, kConfig = 5, kRun = 17 };
enum History { kItem = 1, kStep = 2 };
enum Item { kKey = 1, kNestedKey = 2, kJson = 16 };
enum Update { kUpdate = 1, kRemove = 2 };
enum RunField {
  kRunId = 1,
  kProject = 3,
  kRunConfig = 4,
  kRunSummary = 5,
  kName = 8,
  kNotes = 9,
  kTags = 10,
  kStart = 17
};

/// Calls `use` with each whole record of a log. Returns the bytes up to the first one that is damaged or cut short.
std::size_t read_records(std::string_view bytes, const std::function<void(std::string_view)>& use) {
  std::string whole;
  std::size_t at = kFileHead.size(), good = at;
  while (at < bytes.size()) {
    const std::size_t left = kBlock - at % kBlock;
    if (left < kHead) {  // padding
      at += left;
      continue;
    }
    if (bytes.size() - at < kHead) break;
    std::uint32_t crc;
    std::uint16_t length;
    std::memcpy(&crc, bytes.data() + at, 4);
    std::memcpy(&length, bytes.data() + at + 4, 2);
    const auto* type_and_data = reinterpret_cast<const Bytef*>(bytes.data() + at + 6);
    if (length > left - kHead || length > bytes.size() - at - kHead ||
        crc != ::crc32_z(0, type_and_data, std::size_t{1} + length))
      break;
    const int type = *type_and_data;
    const std::string_view data = bytes.substr(at + kHead, length);
    at += kHead + length;
    if (type == kFull || type == kFirst) whole.clear();
    if (type != kFull) whole += data;
    if (type == kFull || type == kLast) {
      use(type == kFull ? data : std::string_view(whole));
      good = at;
    }
  }
  return at >= bytes.size() ? bytes.size() : good;
}

/// A key with its value, of a history, a configuration or a summary.
struct KeyValue {
  std::string key;
  Json value;
};

KeyValue item_of(std::string_view message) {
  KeyValue item;
  std::string nested;
  each_field(message, [&](const WireField& field) {
    if (field.number == kKey) item.key = field.bytes;
    if (field.number == kNestedKey) nested += (nested.empty() ? "" : ".") + std::string(field.bytes);
    if (field.number == kJson) {
      // Python's JSON has NaN and Infinity.
      item.value = parse_json_or_null(field.bytes);
    }
  });
  if (item.key.empty()) item.key = nested;
  return item;
}

class WandbImport {
 public:
  WandbImport(std::string path, std::string project, LogSink sink)
      : path_(std::move(path)), project_(std::move(project)), sink_(std::move(sink)) {}

  void add(std::string_view record) {
    each_field(record, [&](const WireField& field) {
      switch (field.number) {
        case kRun:
          begin(field.bytes);
          break;
        case kHistory:
          add_history(field.bytes);
          break;
        case kConfig:
          writer().configure(text_of(updates_of(field.bytes)));
          break;
        case kSummary:
          // It grows with the history: what was last written counts.
          summary_.update(updates_of(field.bytes));
          break;
        default:
          break;
      }
    });
  }

  ImportedRun finish() {
    LogWriter& to = writer();
    if (!summary_.empty()) to.summarise(text_of(summary_));
    to.finish(true);
    return {id_, to.points(), ""};
  }

 private:
  /// Without what W&B adds for itself.
  static Json updates_of(std::string_view message) {
    Json all = Json::object();
    each_field(message, [&](const WireField& field) {
      if (field.number != kUpdate) return;
      KeyValue item = item_of(field.bytes);
      if (!item.key.empty() && item.key.front() != '_') all[item.key] = std::move(item.value);
    });
    return all;
  }

  void begin(std::string_view run) {
    if (writer_) return;
    std::string id, project, config, summary;
    LogBeginning beginning;
    each_field(run, [&](const WireField& field) {
      const std::string text(field.bytes);
      switch (field.number) {
        case kRunId:
          id = text;
          break;
        case kProject:
          project = text;
          break;
        case kName:
          beginning.title = text;
          break;
        case kNotes:
          beginning.note = text;
          break;
        case kTags:
          beginning.tags.push_back(text);
          break;
        case kRunConfig:
          config = text;
          break;
        case kStart:  // google.protobuf.Timestamp
          each_field(field.bytes, [&](const WireField& time) {
            beginning.started += static_cast<double>(time.value) * (time.number == 1 ? 1 : 1e-9);
          });
          break;
        default:
          break;
      }
    });
    started_ = beginning.started;
    open(project, id);
    writer_->begin(std::move(beginning));
    if (!config.empty()) writer_->configure(text_of(updates_of(config)));
  }

  void open(const std::string& project, const std::string& id) {
    const std::string stem = std::filesystem::path(path_).stem();  // run-ID
    const std::string name = !id.empty() ? id : stem.substr(stem.find('-') + 1);
    id_ = logged_id(!project_.empty() ? project_ : !project.empty() ? project : "wandb", name);
    writer_.emplace(sink_, LogWriter::Options{id_, "wandb", name.substr(0, 64), kPointsOfBatch});
  }

  LogWriter& writer() {
    if (!writer_) {
      open("", "");
      writer_->begin({seconds_since_epoch(), "", {}, ""});
    }
    return *writer_;
  }

  void add_history(std::string_view history) {
    LogWriter& to = writer();
    double step = static_cast<double>(next_step_), time = started_;
    std::vector<KeyValue> items;
    each_field(history, [&](const WireField& field) {
      if (field.number == kItem) items.push_back(item_of(field.bytes));
      if (field.number == kStep)
        each_field(field.bytes, [&](const WireField& number) { step = static_cast<double>(number.value); });
    });
    for (const KeyValue& item : items) {
      if (item.key == "_step" && item.value.is_number()) step = item.value.get<double>();
      if (item.key == "_timestamp" && item.value.is_number()) time = item.value.get<double>();
    }
    next_step_ = static_cast<std::uint64_t>(step) + 1;
    bool any = false;
    for (const KeyValue& item : items)
      if (!item.key.empty() && item.key.front() != '_') any |= add_numbers(to, item.key, item.value, step, time);
    if (any) to.points_done();
  }

  static bool add_numbers(LogWriter& to, const std::string& key, const Json& value, double step, double time) {
    if (value.is_object() && !value.contains("_type")) {  // not a picture or the like
      bool any = false;
      for (const auto& [inner, one] : value.items()) any |= add_numbers(to, key + "/" + inner, one, step, time);
      return any;
    }
    if (!value.is_number() || key.size() > kLongestMetric) return false;
    to.add(key, step, time, value.get<double>());
    return true;
  }

  const std::string path_, project_;
  const LogSink sink_;
  std::optional<LogWriter> writer_;
  std::string id_;
  Json summary_ = Json::object();
  double started_ = 0;
  std::uint64_t next_step_ = 0;
};

}  // namespace

bool is_wandb_file(const std::string& name) { return name.starts_with("run-") && name.ends_with(".wandb"); }

ImportedRun import_wandb_file(const std::string& path, const std::string& project, const LogSink& sink) {
  const MappedFile file(path);
  if (!file.bytes().starts_with(kFileHead)) throw Error("is not a run that Weights & Biases recorded", path);
  WandbImport import(path, project, sink);
  const std::size_t used = read_records(file.bytes(), [&](std::string_view record) { import.add(record); });
  ImportedRun run = import.finish();
  if (used < file.bytes().size())
    run.problem = path + ": damaged or cut short at byte " + std::to_string(used) + ": the rest of it is left out";
  return run;
}

}  // namespace citylearn
