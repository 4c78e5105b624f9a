// SPDX-License-Identifier: Apache-2.0
// MCAP files: what is written is read, wherever the file ends and whatever is in it.
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>

#include "core/recording/mcap_writer.h"
#include "core/recording/wire_header.h"
#include "core/util/error.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/samples.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

Bytes payload(const std::string& text) {
  Bytes bytes(text.size());
  std::memcpy(bytes.data(), text.data(), text.size());
  return bytes;
}

template <class Number>
Number number_at(const std::string& text, std::size_t at) {
  Number number;
  std::memcpy(&number, text.data() + at, sizeof number);
  return number;
}

std::uint32_t crc_of(const std::string& text) {
  return static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const unsigned char*>(text.data()), text.size()));
}

const McapChannel kOne{"one", "pkg::One", "omgidl", "struct One {};", "cdr", {{"profile", "state"}}};
const McapChannel kTwo{"two", "pkg::Two", "omgidl", "struct Two {};", "cdr", {}};

class Mcap : public ::testing::Test {
 protected:
  /// Ten messages in five chunks; the second channel comes late.
  void write_small(bool close = true, const std::string& profile = "citylearn") const {
    McapWriter writer(path, {"test", {{"run", "demo"}}, 60, 1'000'000'000, profile});
    const auto one = writer.add(kOne);
    writer.write(one, 100, payload("a"));
    writer.write(one, 101, payload("bc"));
    const auto two = writer.add(kTwo);
    for (int i = 0; i < 8; ++i)
      writer.write(i % 2 ? one : two, 102 + static_cast<std::uint64_t>(i), payload("message"));
    close ? writer.close() : writer.flush();
  }

  const Folder folder;
  const std::string path = folder / "a.mcap", other = folder / "other.mcap";
};

TEST_F(Mcap, WhatIsWrittenIsRead) {
  write_small();
  McapReader reader(path);
  std::vector<std::string> heard;
  std::map<std::string, std::uint32_t> sequence;
  while (const auto message = reader.next()) {
    const McapChannel& channel = *message->channel;
    heard.push_back(channel.topic + std::to_string(message->log_time) + ":" +
                    std::string(reinterpret_cast<const char*>(message->data.data()), message->data.size()));
    EXPECT_EQ(message->sequence, ++sequence[channel.topic]);
    const McapChannel& wanted = channel.topic == "one" ? kOne : kTwo;
    EXPECT_EQ(channel.type, wanted.type);
    EXPECT_EQ(channel.schema, wanted.schema);
    EXPECT_EQ(channel.schema_encoding, "omgidl");
    EXPECT_EQ(channel.encoding, "cdr");
    EXPECT_EQ(channel.metadata, wanted.metadata);
  }
  EXPECT_EQ(heard, (std::vector<std::string>{"one100:a", "one101:bc", "two102:message", "one103:message",
                                             "two104:message", "one105:message", "two106:message", "one107:message",
                                             "two108:message", "one109:message"}));
  EXPECT_EQ(reader.missing(), "");
  EXPECT_EQ(reader.metadata().at("recording").at("run"), "demo");
}

class McapProfile : public Mcap, public ::testing::WithParamInterface<const char*> {};
INSTANTIATE_TEST_SUITE_P(All, McapProfile, ::testing::Values("citylearn", "ros2", "", "a longer profile"));

TEST_P(McapProfile, TheSummaryAndItsChecksumsAreRight) {
  write_small(true, GetParam());
  const std::string file = contents(path);
  const std::size_t footer = file.size() - 8 - 20 - 9;
  ASSERT_EQ(file[footer], 2);
  const auto summary = number_at<std::uint64_t>(file, footer + 9),
             offsets = number_at<std::uint64_t>(file, footer + 17);
  EXPECT_EQ(number_at<std::uint32_t>(file, footer + 25), crc_of(file.substr(summary, footer + 25 - summary)));
  const std::size_t data_end = summary - 13;
  ASSERT_EQ(file[data_end], 15);
  EXPECT_EQ(number_at<std::uint32_t>(file, data_end + 9), crc_of(file.substr(0, data_end)));
  // Each group is where its offset says; each index of a chunk points at one, and past it at its indexes.
  std::map<int, int> groups;
  for (std::size_t at = offsets; at < footer; at += 9 + number_at<std::uint64_t>(file, at + 1)) {
    ASSERT_EQ(file[at], 14);
    const auto start = number_at<std::uint64_t>(file, at + 10), length = number_at<std::uint64_t>(file, at + 18);
    for (std::size_t record = start; record < start + length;
         record += 9 + number_at<std::uint64_t>(file, record + 1)) {
      ASSERT_EQ(file[record], file[at + 9]);
      ++groups[file[record]];
      if (file[record] == 13) {
        const auto about = number_at<std::uint64_t>(file, record + 9),
                   bytes = number_at<std::uint64_t>(file, record + 17);
        EXPECT_EQ(about, 8 + 9 + number_at<std::uint64_t>(file, 9)) << "after the magic bytes and the header";
        ASSERT_EQ(file[about], 12);
        EXPECT_EQ(bytes, 9 + number_at<std::uint64_t>(file, about + 1));
      }
      if (file[record] == 11) {
        EXPECT_EQ(number_at<std::uint64_t>(file, record + 9), 10u) << "messages";
        EXPECT_EQ(number_at<std::uint32_t>(file, record + 23), 0u) << "attachments";
        EXPECT_EQ(number_at<std::uint32_t>(file, record + 27), 1u) << "metadata";
        EXPECT_EQ(number_at<std::uint32_t>(file, record + 31), 5u) << "chunks";
      }
      if (file[record] != 8) continue;
      const auto chunk = number_at<std::uint64_t>(file, record + 25),
                 size = number_at<std::uint64_t>(file, record + 33);
      EXPECT_EQ(file[chunk], 6);
      EXPECT_EQ(size, 9 + number_at<std::uint64_t>(file, chunk + 1));
      const auto entries = number_at<std::uint32_t>(file, record + 41);
      for (std::size_t entry = record + 45; entry < record + 45 + entries; entry += 10) {
        const auto index = number_at<std::uint64_t>(file, entry + 2);
        EXPECT_EQ(file[index], 7);
        EXPECT_EQ(number_at<std::uint16_t>(file, index + 9), number_at<std::uint16_t>(file, entry));
        // Its first entry points at a message in the chunk, past the 40 bytes of its other fields.
        const auto message = chunk + 9 + 40 + number_at<std::uint64_t>(file, index + 23);
        EXPECT_EQ(file[message], 5);
        EXPECT_EQ(number_at<std::uint16_t>(file, message + 9), number_at<std::uint16_t>(file, entry));
      }
    }
  }
  EXPECT_EQ(groups, (std::map<int, int>{{3, 2}, {4, 2}, {8, 5}, {11, 1}, {13, 1}})) << "and of chunks there are five";
}

TEST_F(Mcap, AFileThatEndsAnywhereIsReadUpToItsLastWholeChunk) {
  write_small();
  const std::string file = contents(path);
  const std::vector<Heard> whole = all_of(path);
  make_file(other, file);
  std::size_t least = whole.size();
  std::set<std::size_t> counts;
  for (std::size_t size = file.size() - 1; size > 0; --size) {
    SCOPED_TRACE(size);
    std::filesystem::resize_file(other, size);
    if (size < 8) {
      EXPECT_NE(error_of([&] { McapReader reader(other); }).find("is no MCAP file"), std::string::npos);
      continue;
    }
    std::string missing;
    const std::vector<Heard> read = all_of(other, &missing);
    EXPECT_TRUE(contains(missing, "cut short after " + std::to_string(size) + " bytes"));
    ASSERT_LE(read.size(), least) << "fewer bytes are no more messages";
    for (std::size_t i = 0; i < read.size(); ++i) EXPECT_EQ(read[i].bytes, whole[i].bytes);
    least = read.size();
    counts.insert(least);
  }
  EXPECT_EQ(counts, (std::set<std::size_t>{0, 2, 4, 6, 8, 10})) << "chunk by chunk";
}

TEST_F(Mcap, WhatWasFlushedIsThereWithoutAnEnd) {
  write_small(false);
  std::string missing;
  EXPECT_EQ(all_of(path, &missing).size(), 10u);
  EXPECT_NE(missing, "");
}

TEST_F(Mcap, AChunkIsWrittenWhenItIsFullOrOldEnough) {
  McapWriter writer(path, {"test", {}, 1000, 50});
  const auto one = writer.add(kOne);
  writer.write(one, 100, payload("early"));
  EXPECT_EQ(writer.waiting_since(), 100u);
  EXPECT_EQ(all_of(path).size(), 0u);
  writer.write(one, 150, payload("late"));
  EXPECT_EQ(writer.waiting_since(), 0u);
  EXPECT_EQ(all_of(path).size(), 2u);
  writer.write(one, 151, Bytes(2000));
  EXPECT_EQ(all_of(path).size(), 3u);
  EXPECT_EQ(writer.bytes(), contents(path).size());
}

TEST_F(Mcap, ADamagedFileIsRefusedOrReadButNeverWrong) {
  write_small();
  const std::string file = contents(path);
  const std::vector<Heard> whole = all_of(path);
  make_file(other, file);
  int refused = 0;
  for (std::size_t at = 0; at < file.size(); ++at) {
    SCOPED_TRACE(at);
    const auto put = [&](char byte) {
      std::fstream(other, std::ios::binary | std::ios::in | std::ios::out)
          .seekp(static_cast<std::streamoff>(at))
          .put(byte);
    };
    put(static_cast<char>(file[at] ^ 0x41));
    try {
      // Of messages in chunks, no byte is another one: their checksum says so.
      const std::vector<Heard> read = all_of(other);
      ASSERT_LE(read.size(), whole.size());
      for (std::size_t i = 0; i < read.size(); ++i)
        EXPECT_TRUE(
            std::any_of(whole.begin(), whole.end(), [&](const Heard& was) { return was.bytes == read[i].bytes; }));
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).rfind(other, 0), 0u) << error.what();
      ++refused;
    }
    put(file[at]);
  }
  EXPECT_GT(refused, 400);
}

/// Puts the records of an uncompressed chunk into a frame, by its specification, in one block that is stored.
TEST_F(Mcap, CompressedChunksAreRead) {
  write_small();
  const std::string file = contents(path);
  std::size_t chunk = 8;
  while (file[chunk] != 6) chunk += 9 + number_at<std::uint64_t>(file, chunk + 1);
  const auto size = number_at<std::uint64_t>(file, chunk + 25);
  const std::string records = file.substr(chunk + 49, size);
  const auto number = [](auto value, std::size_t bytes) { return std::string(reinterpret_cast<char*>(&value), bytes); };
  const std::map<std::string, std::string> frames = {
      {"zstd", "\x28\xb5\x2f\xfd\xa0" + number(size, 4) + number(size << 3 | 1, 3) + records},
      {"lz4", "\x04\x22\x4d\x18\x60\x40\x82" + number(size | 0x80000000, 4) + records + number(0u, 4)}};
  for (const auto& [name, frame] : frames) {
    const auto with = [&](const std::string& bytes, std::uint64_t told) {
      const std::string content = file.substr(chunk + 9, 16) + number(told, 8) + file.substr(chunk + 33, 4) +
                                  number(name.size(), 4) + name + number(bytes.size(), 8) + bytes;
      make_file(other, file.substr(0, chunk) + "\6" + number(content.size(), 8) + content);
    };
    with(frame, size);
    McapReader reader(other);
    const auto message = reader.next();
    ASSERT_TRUE(message) << name;
    const std::string data(reinterpret_cast<const char*>(message->data.data()), message->data.size());
    const McapPlace place = message->place;
    while (reader.next()) continue;
    const auto again = reader.read(place).data;
    EXPECT_EQ(std::string(reinterpret_cast<const char*>(again.data()), again.size()), data);
    EXPECT_EQ(data, "a");
    with(frame.substr(0, frame.size() - 1), size);
    EXPECT_TRUE(contains(error_of([&] { all_of(other); }), "a chunk is cut short")) << name;
    with(frame, size - 1);
    EXPECT_TRUE(contains(error_of([&] { all_of(other); }), "a chunk is longer than it may be")) << name;
    with(frame, std::uint64_t{1} << 60);
    EXPECT_TRUE(contains(error_of([&] { all_of(other); }), "a chunk of 1152921504606846976 bytes")) << name;
  }
}

TEST_F(Mcap, ErrorsSayWhatIsWrong) {
  make_file(path, "PK\3\4 and so on");
  EXPECT_EQ(error_of([&] { McapReader reader(path); }),
            path + ": is no MCAP file (it does not begin as one of version 0 does)");
  EXPECT_EQ(error_of([&] { McapReader reader(folder / "none.mcap"); }),
            folder / "none.mcap" + ": cannot be read: No such file or directory");
  EXPECT_EQ(error_of([&] { McapWriter writer(path, {}); }),
            path + ": is there already (choose another name, or remove it)");
  EXPECT_EQ(error_of([&] { McapWriter writer(folder / "no/a.mcap", {}); }),
            folder / "no/a.mcap" + ": cannot be made: No such file or directory");

  const std::string magic("\x89MCAP0\r\n", 8);
  // A chunk of no records, compressed; a message of a channel that nobody announced.
  std::string chunk("\x06\x2C\0\0\0\0\0\0\0", 9);
  chunk += std::string(16, '\0') + std::string(8, '\0') + std::string(4, '\0') + std::string("\4\0\0\0lzma", 8) +
           std::string(8, '\0');
  make_file(path, magic + chunk);
  EXPECT_EQ(error_of([&] { all_of(path); }),
            path + ": byte 8: a chunk is compressed with 'lzma'; zstd and lz4 are known");
  make_file(path, magic + std::string("\x05\x16\0\0\0\0\0\0\0", 9) + std::string("\7\0", 2) + std::string(20, '\0'));
  EXPECT_EQ(error_of([&] { all_of(path); }), path + ": byte 8: a message of channel 7, which was not announced");
}

TEST(WireHeader, IsReadFromEveryMessageAndItsRunChanged) {
  for_each_message([]<class Message>() {
    for (const Size size : {Size::kMin, Size::kTypical, Size::kMax}) {
      Message message = sample_of<Message>(size);
      const Bytes bytes = encoded(message);
      const auto header = header_of(bytes);
      ASSERT_TRUE(header) << topic_of<Message>().type;
      EXPECT_EQ(header->protocol, msg::PROTOCOL);
      EXPECT_EQ(header->session, message.header().session().c_str());
      EXPECT_EQ(header->sender, message.header().sender().c_str());
      EXPECT_EQ(header->incarnation, message.header().incarnation());
      EXPECT_EQ(header->message, message.header().message());
      for (std::size_t length = 1; length <= 64; length += size == Size::kTypical ? 1 : 21) {
        const std::string run(length, 'r');
        Bytes changed;
        ASSERT_TRUE(with_session(bytes, run, changed));
        message.header().session(run);
        ASSERT_EQ(changed, encoded(message)) << topic_of<Message>().type << ", " << length;
      }
    }
  });
}

TEST(WireHeader, IsNotFoundInOtherBytes) {
  const Bytes bytes = encoded(sample_of<msg::Action>(Size::kTypical));
  for (std::size_t size = 0; size < 40; ++size) EXPECT_FALSE(header_of(std::span(bytes).first(size))) << size;
  Bytes other = bytes;
  other[1] = std::byte{7};  // XCDR2
  EXPECT_FALSE(header_of(other));
  other = bytes;
  other[8] = std::byte{66};  // a name of more characters than there are
  Bytes to;
  EXPECT_FALSE(header_of(other));
  EXPECT_FALSE(with_session(other, "run", to));
}

TEST(IdlText, OfEveryTopicStandsAlone) {
  for (const Topic& topic : all_topics()) {
    const std::string text = idl_of(topic.type);
    EXPECT_FALSE(contains(text, "#include")) << topic.type;
    EXPECT_EQ(text.find("struct Header {"), text.rfind("struct Header {")) << topic.type;
    EXPECT_NE(text.find("struct Header {"), std::string::npos) << topic.type;
    EXPECT_NE(text.find("struct " + topic.type.substr(topic.type.rfind(':') + 1) + " {"), std::string::npos);
  }
  EXPECT_THROW(idl_of("citylearn::msg::Nothing"), Error);
}

}  // namespace
}  // namespace citylearn::testing
