// SPDX-License-Identifier: Apache-2.0
// Files of TensorBoard and of Weights & Biases become logged runs.
#include <google/protobuf/unknown_field_set.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <bit>
#include <cmath>
#include <map>

#include "core/files/tf_records.h"
#include "core/util/error.h"
#include "tests/support/files.h"
#include "tests/support/text.h"
#include "tools/import/event_files.h"
#include "tools/import/wandb_file.h"

namespace citylearn::testing {
namespace {

/// A protobuf message, written by the library.
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
  Message& real32(int field, float value) {
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
  operator std::string() const { return bytes(); }

 private:
  google::protobuf::UnknownFieldSet fields_;
};

/// What came of an import, as LoggedRuns would keep it.
struct Kept {
  std::map<std::string, std::vector<std::tuple<double, double, double>>> curves;  ///< step, time, value
  std::vector<std::string> config, summary;
  std::optional<LogBeginning> beginning;
  std::optional<bool> ended;
  std::uint64_t next = 1;

  LogSink sink() {
    return [this](const std::string&, const LogBatch& batch) {
      EXPECT_EQ(batch.first(), next) << "records follow each other";
      next = batch.end_record();
      for (const LoggedPoint& point : batch.points())
        curves[batch.metrics()[point.metric]].emplace_back(point.step, point.time, point.value);
      config.insert(config.end(), batch.config().begin(), batch.config().end());
      summary.insert(summary.end(), batch.summary().begin(), batch.summary().end());
      if (batch.beginning()) beginning = batch.beginning();
      if (batch.ended) ended = batch.ended;
      return LoggedRuns::Outcome{next - 1, false};
    };
  }
};

using Points = std::vector<std::tuple<double, double, double>>;

std::string event(double time, std::uint64_t step, const std::string& value) {
  return tf_record(Message().real(1, time).number(2, step).text(5, Message().text(1, value)).bytes());
}
std::string scalar(const std::string& tag, float value) { return Message().text(1, tag).real32(2, value); }

TEST(ImportEventFiles, ReadsScalarsOfBothKinds) {
  Folder folder;
  const std::string version = tf_record(Message().real(1, 100).text(3, "brain.Event:2").bytes());
  const float four = 4;
  const std::string content(reinterpret_cast<const char*>(&four), sizeof four);
  const std::string as_floats = Message().text(1, "acc").text(8, Message().number(1, 1).text(2, "").text(5, content));
  const std::string as_content = Message().text(1, "acc").text(8, Message().number(1, 1).text(4, content));
  const std::string picture = Message().text(1, "picture").text(4, Message().number(1, 5));
  const std::string vector =
      Message().text(1, "histogram").text(8, Message().number(1, 1).text(2, Message().text(2, "")).text(4, content));
  make_file(folder / "events.out.tfevents.1.host", version + event(101, 0, scalar("loss", 0.5f)) +
                                                       event(102, 1, as_floats) + event(103, 2, as_content) +
                                                       event(104, 2, picture) + event(104, 2, vector));
  make_file(folder / "events.out.tfevents.2.host", event(105, 3, scalar("loss", std::nanf(""))));
  Kept kept;
  const ImportedRun run = import_event_files(
      {folder / "events.out.tfevents.1.host", folder / "events.out.tfevents.2.host"}, "tb/a", kept.sink());
  EXPECT_EQ(run.problem, "");
  EXPECT_EQ(run.points, 4u);
  EXPECT_EQ(kept.curves["acc"], (Points{{1, 102, 4}, {2, 103, 4}}));
  ASSERT_EQ(kept.curves["loss"].size(), 2u);
  EXPECT_EQ(kept.curves["loss"][0], (std::tuple{0.0, 101.0, 0.5}));
  EXPECT_TRUE(std::isnan(std::get<2>(kept.curves["loss"][1])));
  EXPECT_EQ(kept.curves.size(), 2u);
  EXPECT_EQ(kept.beginning.value().started, 100);
  EXPECT_EQ(kept.ended, true);
}

TEST(ImportEventFiles, ReadsHyperparameters) {
  Folder folder;
  const auto entry = [](const std::string& key, const std::string& value) {
    return std::string(Message().text(1, key).text(2, value));
  };
  const std::string start = Message()
                                .text(1, entry("rate", Message().real(2, 0.25)))
                                .text(1, entry("net", Message().text(3, "lstm")))
                                .text(1, entry("dropout", Message().number(4, 1)));
  const std::string metadata = Message().text(1, Message().text(1, "hparams").text(2, Message().text(3, start)));
  const std::string value = Message().text(1, "_hparams_/session_start_info").text(9, metadata);
  make_file(folder / "events.out.tfevents.1", event(1, 0, value));
  Kept kept;
  import_event_files({folder / "events.out.tfevents.1"}, "tb/a", kept.sink());
  EXPECT_EQ(kept.config, std::vector<std::string>{R"({"dropout":true,"net":"lstm","rate":0.25})"});
}

TEST(ImportEventFiles, SaysWhereAFileIsDamaged) {
  Folder folder;
  const std::string first = event(1, 0, scalar("loss", 1)), second = event(2, 1, scalar("loss", 2));
  std::string bytes = first + second;
  bytes[first.size() + 20] ^= 1;
  make_file(folder / "events.out.tfevents.1", bytes);
  Kept kept;
  const ImportedRun run = import_event_files({folder / "events.out.tfevents.1"}, "tb/a", kept.sink());
  EXPECT_EQ(run.points, 1u);
  EXPECT_TRUE(contains(run.problem, "at byte " + std::to_string(first.size())));
  make_file(folder / "events.out.tfevents.1", "");
  EXPECT_EQ(import_event_files({folder / "events.out.tfevents.1"}, "tb/b", Kept().sink()).points, 0u);
  EXPECT_THROW(import_event_files({folder / "missing"}, "tb/c", Kept().sink()), Error);
}

/// Writes records as Weights & Biases does: blocks of 32 KiB, divided records, padding.
std::string wandb_log(const std::vector<std::string>& records) {
  constexpr std::size_t kBlock = 32768, kHead = 7;
  std::string bytes(":W&B\xE1\xBE\0", 7);
  for (std::string rest : records) {
    for (bool first = true, more = true; more; first = false) {
      std::size_t left = kBlock - bytes.size() % kBlock;
      if (left < kHead) {
        bytes.append(left, '\0');
        left = kBlock;
      }
      const std::string data = rest.substr(0, left - kHead);
      rest.erase(0, data.size());
      more = !rest.empty();
      const char type = static_cast<char>(first ? (more ? 2 : 1) : (more ? 3 : 4));
      const std::string sealed = type + data;
      const auto crc =
          static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(sealed.data()), sealed.size()));
      const auto length = static_cast<std::uint16_t>(data.size());
      bytes.append(reinterpret_cast<const char*>(&crc), 4);
      bytes.append(reinterpret_cast<const char*>(&length), 2);
      bytes += sealed;
    }
  }
  return bytes;
}

std::string item(const std::string& key, const std::string& json) { return Message().text(1, key).text(16, json); }

std::vector<std::string> wandb_records() {
  const std::string config = Message()
                                 .text(1, item("rate", "0.1"))
                                 .text(1, item("_wandb", "{}"))
                                 .text(1, item("note", "\"" + std::string(70'000, 'x') + "\""));
  const std::string run = Message()
                              .text(1, "abc123")
                              .text(3, "walks")
                              .text(4, config)
                              .text(8, "brave-cat-1")
                              .text(10, "night")
                              .text(17, Message().number(1, 1000).number(2, 500'000'000));
  std::vector<std::string> records = {Message().number(1, 1).text(17, run)};
  for (int step = 0; step < 2000; ++step)
    records.push_back(Message().text(2, Message()
                                            .text(1, item("loss", std::to_string(step)))
                                            .text(1, Message().text(2, "a").text(2, "b").text(16, "2"))
                                            .text(1, item("text", "\"no number\""))
                                            .text(1, item("picture", R"({"_type": "image-file", "size": 3})"))
                                            .text(1, item("_timestamp", std::to_string(1000 + step)))
                                            .text(2, Message().number(1, static_cast<std::uint64_t>(10 * step)))));
  records.push_back(Message().text(3, Message().text(1, item("best", "0.5")).text(1, item("_runtime", "9"))));
  records.push_back(Message().text(18, Message().number(1, 0)));
  return records;
}

TEST(ImportWandb, ReadsHistoryConfigurationAndSummary) {
  Folder folder;
  make_file(folder / "run-abc123.wandb", wandb_log(wandb_records()));
  Kept kept;
  const ImportedRun run = import_wandb_file(folder / "run-abc123.wandb", "", kept.sink());
  EXPECT_EQ(run.problem, "");
  EXPECT_EQ(run.id, "walks/abc123");
  EXPECT_EQ(run.points, 4000u);
  ASSERT_EQ(kept.curves["loss"].size(), 2000u);
  EXPECT_EQ(kept.curves["loss"][1999], (std::tuple{19990.0, 2999.0, 1999.0}));
  EXPECT_EQ(kept.curves["a.b"].size(), 2000u);
  EXPECT_EQ(kept.curves.size(), 2u);
  ASSERT_EQ(kept.config.size(), 1u);
  EXPECT_TRUE(contains(kept.config[0], R"("rate":0.1)"));
  EXPECT_FALSE(contains(kept.config[0], "_wandb"));
  EXPECT_EQ(kept.summary, std::vector<std::string>{R"({"best":0.5})"});
  EXPECT_EQ(kept.beginning.value().title, "brave-cat-1");
  EXPECT_EQ(kept.beginning.value().tags, std::vector<std::string>{"night"});
  EXPECT_EQ(kept.beginning.value().started, 1000.5);
  EXPECT_EQ(import_wandb_file(folder / "run-abc123.wandb", "mine", Kept().sink()).id, "mine/abc123");
}

TEST(ImportWandb, KeepsWhatIsWholeOfADamagedFile) {
  Folder folder;
  const std::string whole = wandb_log(wandb_records());
  make_file(folder / "run-a.wandb", whole.substr(0, whole.size() / 2));  // of a program that was killed
  Kept kept;
  const ImportedRun run = import_wandb_file(folder / "run-a.wandb", "", kept.sink());
  EXPECT_TRUE(contains(run.problem, "cut short"));
  EXPECT_GT(run.points, 1000u);
  EXPECT_LT(run.points, 4000u);
  make_file(folder / "run-b.wandb", "something else");
  EXPECT_THROW(import_wandb_file(folder / "run-b.wandb", "", Kept().sink()), Error);
}

}  // namespace
}  // namespace citylearn::testing
