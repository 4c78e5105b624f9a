// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/event_log.h"

#include <google/protobuf/unknown_field_set.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <string_view>
#include <vector>

#include "core/files/files.h"
#include "core/files/tf_records.h"
#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "core/util/machine.h"
#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

constexpr std::string_view kPrefix = "events.out.tfevents.";

// Field numbers of event.proto and summary.proto.
enum Event { kWallTime = 1, kStep = 2, kFileVersion = 3, kSummary = 5, kSessionLog = 7 };
enum SessionLog { kStatus = 1, kStart = 1 };  // readers drop what they know of this step and later ones
enum Summary { kValue = 1 };
enum Value { kTag = 1, kSimpleValue = 2 };

/// A protobuf message: its fields, in the order in which they are written.
class Message {
 public:
  Message& number(int field, std::uint64_t value) {
    fields_.AddVarint(field, value);
    return *this;
  }
  Message& real(int field, double value) {
    fields_.AddFixed64(field, std::bit_cast<std::uint64_t>(value));
    return *this;
  }
  Message& real(int field, float value) {
    fields_.AddFixed32(field, std::bit_cast<std::uint32_t>(value));
    return *this;
  }
  Message& text(int field, const std::string& value) {
    fields_.AddLengthDelimited(field, value);
    return *this;
  }
  std::string bytes() const {
    std::string bytes;
    fields_.SerializeToString(&bytes);
    return bytes;
  }

 private:
  google::protobuf::UnknownFieldSet fields_;
};

/// Returns the step of an event; nothing where it is not such a message. Events without one are of step 0.
std::optional<std::uint64_t> step_of(std::string_view event) {
  google::protobuf::UnknownFieldSet fields;
  if (!fields.ParseFromArray(event.data(), static_cast<int>(event.size()))) return std::nullopt;
  std::uint64_t step = 0;
  for (int i = 0; i < fields.field_count(); ++i)
    if (const auto& field = fields.field(i);
        field.number() == kStep && field.type() == google::protobuf::UnknownField::TYPE_VARINT)
      step = field.varint();
  return step;
}

/// Returns the bytes up to the first record that is past `steps`, damaged or cut short.
std::size_t kept_bytes(std::string_view bytes, std::uint64_t steps) {
  return read_tf_records(bytes, [steps](std::string_view event) {
    const auto step = step_of(event);
    return step && *step <= steps;
  });
}

/// Seconds in an event file's name; none when it is not one.
std::optional<std::uint64_t> seconds_of(const std::string& name) {
  if (!name.starts_with(kPrefix)) return std::nullopt;
  std::uint64_t seconds = 0;
  const char* begin = name.data() + kPrefix.size();
  if (std::from_chars(begin, name.data() + name.size(), seconds).ec != std::errc()) return std::nullopt;
  return seconds;
}

}  // namespace

EventLog::EventLog(const std::string& folder, std::uint64_t after_steps) {
  create_folder(folder, "choose another --output");
  // Readers take the files in the order of their names: the new one's must be the last, whatever the clock says.
  std::uint64_t seconds = static_cast<std::uint64_t>(seconds_since_epoch());
  std::vector<std::filesystem::path> older;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (const auto found = seconds_of(entry.path().filename())) {
      older.push_back(entry.path());
      seconds = std::max(seconds, *found + 1);
    }
  for (const std::filesystem::path& path : older) {
    if (after_steps == 0) {
      std::filesystem::remove(path);
      continue;
    }
    const std::string bytes = read_file(path);
    const std::size_t kept = kept_bytes(bytes, after_steps);
    if (kept < bytes.size()) write_file(path, std::string_view(bytes).substr(0, kept));
  }
  path_ = folder + "/" + std::string(kPrefix) + std::to_string(seconds) + "." + host_name() + "." +
          std::to_string(process_number());
  file_.emplace(path_, false);
  record(Message().real(kWallTime, seconds_since_epoch()).text(kFileVersion, "brain.Event:2").bytes());
  if (after_steps > 0)  // for readers that have seen the points that are gone
    record(Message()
               .real(kWallTime, seconds_since_epoch())
               .number(kStep, after_steps + 1)
               .text(kSessionLog, Message().number(kStatus, kStart).bytes())
               .bytes());
  if (!file_->flush()) throw Error(file_->problem());
}

void EventLog::finished(const msg::EpisodeStat& episode) {
  ++episodes_;
  episode_steps_ += episode.steps();
}

void EventLog::write(const msg::TrainingStat& s) {
  const float length =
      episodes_ > 0 ? static_cast<float>(episode_steps_) / static_cast<float>(episodes_) : std::nanf("");
  episodes_ = episode_steps_ = 0;
  Message summary;
  const auto add = [&summary](const char* tag, float value) {
    if (*tag && !std::isnan(value)) summary.text(kValue, Message().text(kTag, tag).real(kSimpleValue, value).bytes());
  };
  for (const TrainingFigure& figure : training_figures()) add(figure.tag, static_cast<float>(figure.value(s)));
  add("Environment/Episode Length", length);
  record(Message()
             .real(kWallTime, seconds_since_epoch())
             .number(kStep, s.steps())
             .text(kSummary, summary.bytes())
             .bytes());
  file_->flush();
}

void EventLog::record(const std::string& event) { file_->add(tf_record(event)); }

}  // namespace citylearn
