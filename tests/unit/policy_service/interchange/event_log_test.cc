// SPDX-License-Identifier: Apache-2.0
// Event files, read by protobuf's own parser from TensorFlow's message definitions. The checksums are computed by the
// processor's CRC32C instruction, which knows nothing of our table.
#include "policy_service/interchange/event_log.h"

#include <google/protobuf/descriptor.pb.h>
#include <google/protobuf/dynamic_message.h>
#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>
#include <nmmintrin.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>

#include "core/files/files.h"
#include "core/files/tf_records.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace pb = google::protobuf;

/// The messages that a reader needs of tensorflow/core/util/event.proto and tensorflow/core/framework/summary.proto: a
/// FileDescriptorProto as text.
constexpr const char* kDefinitions = R"(
  name: "event.proto" syntax: "proto3"
  message_type {
    name: "Summary"
    nested_type {
      name: "Value"
      field { name: "tag" number: 1 type: TYPE_STRING label: LABEL_OPTIONAL }
      field { name: "simple_value" number: 2 type: TYPE_FLOAT label: LABEL_OPTIONAL oneof_index: 0 }
      oneof_decl { name: "value" }
    }
    field { name: "value" number: 1 type: TYPE_MESSAGE type_name: ".Summary.Value" label: LABEL_REPEATED }
  }
  message_type {
    name: "SessionLog"
    enum_type {
      name: "SessionStatus"
      value { name: "STATUS_UNSPECIFIED" number: 0 }
      value { name: "START" number: 1 }
    }
    field { name: "status" number: 1 type: TYPE_ENUM type_name: ".SessionLog.SessionStatus" label: LABEL_OPTIONAL }
  }
  message_type {
    name: "Event"
    field { name: "wall_time" number: 1 type: TYPE_DOUBLE label: LABEL_OPTIONAL }
    field { name: "step" number: 2 type: TYPE_INT64 label: LABEL_OPTIONAL }
    field { name: "file_version" number: 3 type: TYPE_STRING label: LABEL_OPTIONAL oneof_index: 0 }
    field { name: "summary" number: 5 type: TYPE_MESSAGE type_name: ".Summary" label: LABEL_OPTIONAL oneof_index: 0 }
    field { name: "session_log" number: 7 type: TYPE_MESSAGE type_name: ".SessionLog" label: LABEL_OPTIONAL oneof_index: 0 }
    oneof_decl { name: "what" }
  })";

std::uint32_t masked_crc(const std::string& bytes) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char byte : bytes) crc = _mm_crc32_u8(crc, static_cast<unsigned char>(byte));
  crc = ~crc;
  return (crc >> 15 | crc << 17) + 0xA282EAD8u;
}

template <class T>
T at(const std::string& bytes, std::size_t where) {
  T value;
  std::memcpy(&value, bytes.data() + where, sizeof value);
  return value;
}

struct Point {
  std::int64_t step;
  double wall;
  std::map<std::string, float> values;
};

struct Read {
  std::string version;
  std::vector<std::int64_t> restarts;
  std::vector<Point> points;
};

/// Fails the test where the file breaks a rule.
Read read_events(const std::string& path) {
  static const pb::DescriptorPool* const pool = [] {
    pb::FileDescriptorProto file;
    EXPECT_TRUE(pb::TextFormat::ParseFromString(kDefinitions, &file));
    static pb::DescriptorPool built;
    EXPECT_NE(built.BuildFile(file), nullptr);
    return &built;
  }();
  static pb::DynamicMessageFactory factory(pool);
  const pb::Descriptor* type = pool->FindMessageTypeByName("Event");
  const auto field = [](const pb::Message& message, const char* name) {
    return message.GetDescriptor()->FindFieldByName(name);
  };

  Read read;
  const std::string bytes = read_file(path);
  for (std::size_t begin = 0; begin < bytes.size();) {
    if (bytes.size() - begin < 16) {
      ADD_FAILURE() << path << " ends within a record";
      break;
    }
    const auto length = at<std::uint64_t>(bytes, begin);
    EXPECT_EQ(at<std::uint32_t>(bytes, begin + 8), masked_crc(bytes.substr(begin, 8)));
    if (length > bytes.size() - begin - 16) {
      ADD_FAILURE() << path << " ends within a record";
      break;
    }
    const std::string payload = bytes.substr(begin + 12, length);
    EXPECT_EQ(at<std::uint32_t>(bytes, begin + 12 + length), masked_crc(payload));
    begin += 16 + length;

    const std::unique_ptr<pb::Message> event(factory.GetPrototype(type)->New());
    EXPECT_TRUE(event->ParseFromString(payload));
    const pb::Reflection& look = *event->GetReflection();
    EXPECT_TRUE(look.GetUnknownFields(*event).empty());
    Point point{look.GetInt64(*event, field(*event, "step")), look.GetDouble(*event, field(*event, "wall_time")), {}};
    if (look.HasField(*event, field(*event, "file_version")))
      read.version = look.GetString(*event, field(*event, "file_version"));
    if (look.HasField(*event, field(*event, "session_log"))) {
      const pb::Message& session = look.GetMessage(*event, field(*event, "session_log"));
      EXPECT_EQ(session.GetReflection()->GetEnumValue(session, field(session, "status")), 1);
      read.restarts.push_back(point.step);
    }
    if (!look.HasField(*event, field(*event, "summary"))) continue;
    const pb::Message& summary = look.GetMessage(*event, field(*event, "summary"));
    const pb::FieldDescriptor* values = field(summary, "value");
    for (int i = 0; i < summary.GetReflection()->FieldSize(summary, values); ++i) {
      const pb::Message& value = summary.GetReflection()->GetRepeatedMessage(summary, values, i);
      EXPECT_TRUE(value.GetReflection()->GetUnknownFields(value).empty());
      const std::string tag = value.GetReflection()->GetString(value, field(value, "tag"));
      const float number = value.GetReflection()->GetFloat(value, field(value, "simple_value"));
      EXPECT_TRUE(point.values.emplace(tag, number).second) << "twice: " << tag;
    }
    read.points.push_back(point);
  }
  return read;
}

std::vector<std::string> event_files(const std::string& folder) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

msg::TrainingStat stat(std::uint64_t update) {
  msg::TrainingStat one;
  one.update() = update;
  one.steps() = 1000 * update;
  one.episodes() = 10 * update;
  one.lesson() = 2;
  one.steps_per_second() = 5000;
  one.reward() = 0.5f + 0.01f * static_cast<float>(update);
  one.spl() = 0.25f;
  one.policy_loss() = -0.125f;
  one.value_loss() = 0.75f;
  one.entropy() = 1.0625f;
  one.approx_kl() = 0.01f;
  one.clip_fraction() = 0.1f;
  one.gradient_norm() = 0.3f;
  one.learning_rate() = 0.001f;
  return one;
}

TEST(Crc32c, HasTheValuesOfItsStandard) {  // RFC 3720, B.4
  const std::string zeros(32, '\0'), ones(32, '\xFF');
  EXPECT_EQ(crc32c(zeros.data(), 32), 0x8A9136AAu);
  EXPECT_EQ(crc32c(ones.data(), 32), 0x62A8AB43u);
  EXPECT_EQ(crc32c("123456789", 9), 0xE3069283u);
  EXPECT_EQ(crc32c("", 0), 0u);
}

TEST(EventLog, ProtobufReadsWhatWeWrite) {
  Folder folder;
  EventLog log(folder / "tensorboard", 0);
  msg::EpisodeStat episode;
  for (const std::uint32_t steps : {40, 61}) {
    episode.steps() = steps;
    log.finished(episode);
  }
  msg::TrainingStat first = stat(1);
  log.write(first);
  first = stat(2);
  first.reward() = first.spl() = std::numeric_limits<float>::quiet_NaN();
  log.write(first);  // no destructor before it is read: each point is there at once
  const Read read = read_events(log.path());
  EXPECT_EQ(read.version, "brain.Event:2");
  EXPECT_TRUE(read.restarts.empty());
  ASSERT_EQ(read.points.size(), 2u);
  EXPECT_EQ(read.points[0].step, 1000);
  EXPECT_GT(read.points[0].wall, 1.6e9) << "seconds since 1970";
  EXPECT_GE(read.points[1].wall, read.points[0].wall);
  const std::map<std::string, float> expected = {{"Environment/Cumulative Reward", 0.51f},
                                                 {"Environment/Episode Length", 50.5f},
                                                 {"Environment/Episodes", 10.0f},
                                                 {"Environment/Lesson", 2.0f},
                                                 {"Environment/SPL", 0.25f},
                                                 {"Losses/Policy Loss", -0.125f},
                                                 {"Losses/Value Loss", 0.75f},
                                                 {"Performance/Steps per Second", 5000.0f},
                                                 {"Policy/Clip Fraction", 0.1f},
                                                 {"Policy/Approximate KL", 0.01f},
                                                 {"Policy/Entropy", 1.0625f},
                                                 {"Policy/Gradient Norm", 0.3f},
                                                 {"Policy/Learning Rate", 0.001f}};
  EXPECT_EQ(read.points[0].values, expected);
  EXPECT_EQ(read.points[1].step, 2000);
  EXPECT_EQ(read.points[1].values.size(), expected.size() - 3) << "no figures yet, no points";
  EXPECT_FALSE(read.points[1].values.contains("Environment/Episode Length"));
}

TEST(EventLog, ARunThatGoesOnHasEachPointOnce) {
  Folder folder;
  const std::string runs = folder / "tensorboard";
  {
    EventLog log(runs, 0);
    for (std::uint64_t update = 1; update <= 5; ++update) log.write(stat(update));
  }
  std::string cut = read_file(event_files(runs)[0]);
  cut.resize(cut.size() - 7);  // killed while it wrote
  make_file(event_files(runs)[0], cut);
  {
    EventLog log(runs, 3000);  // its last checkpoint was update 3
    for (std::uint64_t update = 4; update <= 8; ++update) log.write(stat(update));
  }
  {
    EventLog log(runs, 6000);
    for (std::uint64_t update = 7; update <= 9; ++update) log.write(stat(update));
  }
  const std::vector<std::string> files = event_files(runs);
  ASSERT_EQ(files.size(), 3u);
  std::vector<std::int64_t> steps, restarts;
  for (const std::string& file : files) {
    EXPECT_TRUE(contains(file, "/events.out.tfevents."));
    const Read read = read_events(file);
    EXPECT_EQ(read.version, "brain.Event:2");
    for (const Point& point : read.points) steps.push_back(point.step);
    restarts.insert(restarts.end(), read.restarts.begin(), read.restarts.end());
  }
  EXPECT_EQ(steps, (std::vector<std::int64_t>{1000, 2000, 3000, 4000, 5000, 6000, 7000, 8000, 9000}));
  EXPECT_EQ(restarts, (std::vector<std::int64_t>{3001, 6001})) << "for readers that have seen what is gone";
}

TEST(EventLog, ANewRunBeginsAnew) {
  Folder folder;
  const std::string runs = folder / "tensorboard";
  std::filesystem::create_directories(runs);
  make_file(runs + "/notes.txt", "mine");
  EventLog(runs, 0).write(stat(1));
  EventLog(runs, 0).write(stat(2));
  const std::vector<std::string> files = event_files(runs);
  ASSERT_EQ(files.size(), 2u);
  EXPECT_EQ(read_file(runs + "/notes.txt"), "mine");
  EXPECT_EQ(read_events(files[0]).points.at(0).step, 2000);
}

/// The folder may have any contents when a run continues.
TEST(EventLog, DamagedFilesAreKeptAsFarAsTheyAreWhole) {
  Folder folder;
  const std::string runs = folder / "tensorboard";
  {
    EventLog log(runs, 0);
    for (std::uint64_t update = 1; update <= 3; ++update) log.write(stat(update));
  }
  const std::string path = event_files(runs)[0], whole = read_file(path);
  std::size_t longest = 0;
  for (std::size_t where = 0; where < whole.size(); where += 41) {
    std::string bytes = whole;
    bytes[where] = static_cast<char>(bytes[where] ^ 0x10);
    std::ofstream(path, std::ios::binary) << bytes;
    std::string mine;
    {
      EventLog log(runs, 3000);
      mine = log.path();
    }
    const std::string kept = read_file(path);
    ASSERT_LE(kept.size(), where) << "a record that holds the damage stayed";
    ASSERT_TRUE(whole.starts_with(kept)) << where;
    longest = std::max(longest, kept.size());
    std::filesystem::remove(mine);
  }
  EXPECT_GT(longest, whole.size() / 2) << "whole records before the damage stay";
  EXPECT_THROW(EventLog("/dev/null/x", 0), Error);
}

}  // namespace
}  // namespace citylearn::testing
