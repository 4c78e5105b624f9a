// SPDX-License-Identifier: Apache-2.0
#include "tools/import/event_files.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "core/files/tf_records.h"
#include "core/util/sha256.h"
#include "dashboard/http/answer.h"
#include "tools/import/mapped_file.h"
#include "tools/import/wire_fields.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

// Field numbers of event.proto, summary.proto, tensor.proto and the plug-in hparams' plugin_data.proto.
enum Event { kWallTime = 1, kStep = 2, kSummary = 5 };
enum Summary { kValue = 1 };
enum Value { kTag = 1, kSimpleValue = 2, kTensor = 8, kMetadata = 9 };
enum Tensor { kType = 1, kShape = 2, kContent = 4, kFloats = 5, kDoubles = 6, kInts = 7, kInt64s = 10 };
enum Shape { kDimension = 2 };
enum Types { kFloat = 1, kDouble = 2, kInt32 = 3, kInt64 = 9 };
enum Metadata { kPluginData = 1, kPluginName = 1, kPluginContent = 2 };
enum Hparams { kStartInfo = 3, kValues = 1, kKey = 1, kMapValue = 2 };
enum AnyValue { kNumber = 2, kText = 3, kFlag = 4 };

constexpr std::string_view kSessionStart = "_hparams_/session_start_info";

template <class Number>
std::optional<double> first_number(std::string_view bytes) {
  Number number;
  if (bytes.size() < sizeof number) return std::nullopt;
  std::memcpy(&number, bytes.data(), sizeof number);
  return static_cast<double>(number);
}

/// Returns the number of a tensor without dimensions; nothing for others.
std::optional<double> scalar_of(std::string_view tensor) {
  std::uint64_t type = 0;
  bool dimensions = false;
  std::optional<double> number;
  std::string_view content;
  each_field(tensor, [&](const WireField& field) {
    switch (field.number) {
      case kType:
        type = field.value;
        break;
      case kShape:
        each_field(field.bytes, [&](const WireField& inner) { dimensions |= inner.number == kDimension; });
        break;
      case kContent:
        content = field.bytes;
        break;
      case kFloats:  // packed, or one field a number
        number = field.bytes.empty() ? field.real32() : first_number<float>(field.bytes);
        break;
      case kDoubles:
        number = field.bytes.empty() ? field.real() : first_number<double>(field.bytes);
        break;
      case kInts:
      case kInt64s:
        if (field.bytes.empty()) number = static_cast<double>(static_cast<std::int64_t>(field.value));
        break;
      default:
        break;
    }
  });
  if (dimensions) return std::nullopt;
  if (content.empty()) return number;
  switch (type) {
    case kFloat:
      return first_number<float>(content);
    case kDouble:
      return first_number<double>(content);
    case kInt32:
      return first_number<std::int32_t>(content);
    case kInt64:
      return first_number<std::int64_t>(content);
    default:
      return std::nullopt;
  }
}

/// Returns the hyperparameters in a summary's metadata, as a JSON object.
Json hyperparameters_of(std::string_view metadata) {
  Json all = Json::object();
  const auto read_value = [&](std::string_view entry) {
    std::string key;
    Json value;
    each_field(entry, [&](const WireField& field) {
      if (field.number == kKey) key = field.bytes;
      if (field.number != kMapValue) return;
      each_field(field.bytes, [&](const WireField& any) {
        if (any.number == kNumber) value = any.real();
        if (any.number == kText) value = std::string(any.bytes);
        if (any.number == kFlag) value = any.value != 0;
      });
    });
    all[key] = value;
  };
  const auto inside = [](std::string_view message, int number, const auto& use) {
    each_field(message, [&](const WireField& field) {
      if (field.number == number) use(field.bytes);
    });
  };
  inside(metadata, kPluginData, [&](std::string_view plugin) {
    inside(plugin, kPluginContent, [&](std::string_view content) {
      inside(content, kStartInfo, [&](std::string_view start) { inside(start, kValues, read_value); });
    });
  });
  return all;
}

/// Adds the scalars of events to a log.
class EventImport {
 public:
  explicit EventImport(LogWriter& writer) : writer_(writer) {}

  void add(std::string_view event) {
    double time = 0;
    std::int64_t step = 0;
    summaries_.clear();
    each_field(event, [&](const WireField& field) {
      if (field.number == kWallTime) time = field.real();
      if (field.number == kStep) step = static_cast<std::int64_t>(field.value);
      if (field.number == kSummary) summaries_.push_back(field.bytes);
    });
    if (!begun_) {
      begun_ = true;
      writer_.begin({time, "", {}, ""});
    }
    bool any = false;
    for (const std::string_view summary : summaries_)
      each_field(summary, [&](const WireField& field) {
        if (field.number == kValue) any |= add_value(field.bytes, static_cast<double>(step), time);
      });
    if (any) writer_.points_done();
    if (!options_.empty()) writer_.configure(std::exchange(options_, ""));
  }

 private:
  bool add_value(std::string_view value, double step, double time) {
    std::string_view tag, metadata;
    std::optional<double> number;
    each_field(value, [&](const WireField& field) {
      if (field.number == kTag) tag = field.bytes;
      if (field.number == kSimpleValue) number = field.real32();
      if (field.number == kTensor) number = scalar_of(field.bytes);
      if (field.number == kMetadata) metadata = field.bytes;
    });
    if (tag == kSessionStart) {
      const Json options = hyperparameters_of(metadata);
      if (!options.empty()) options_ = text_of(options);
      return false;
    }
    if (!number || tag.empty() || tag.size() > kLongestMetric) return false;
    writer_.add(tag, step, time, *number);
    return true;
  }

  LogWriter& writer_;
  bool begun_ = false;
  std::string options_;                      // of this event
  std::vector<std::string_view> summaries_;  // of one event
};

}  // namespace

bool is_event_file(const std::string& name) { return name.find("tfevents") != name.npos; }

ImportedRun import_event_files(const std::vector<std::string>& files, const std::string& id, const LogSink& sink) {
  ImportedRun run{id, 0, ""};
  std::optional<LogWriter> writer;
  std::optional<EventImport> import;
  for (const std::string& path : files) {
    const MappedFile file(path);
    const std::size_t used = read_tf_records(file.bytes(), [&](std::string_view event) {
      if (!writer) {
        const std::string name = std::filesystem::path(path).filename();
        writer.emplace(sink, LogWriter::Options{id, "tensorboard", sha256(name + std::string(event)).substr(0, 16),
                                                kPointsOfBatch});
        import.emplace(*writer);
      }
      import->add(event);
      return true;
    });
    if (used < file.bytes().size())
      run.problem = path + ": damaged or cut short at byte " + std::to_string(used) + ": the rest of it is left out";
  }
  if (writer) {
    writer->finish(true);
    run.points = writer->points();
  }
  return run;
}

}  // namespace citylearn
