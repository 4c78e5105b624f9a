// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <limits>

#include "core/files/files.h"
#include "core/recording/compression.h"
#include "core/recording/mcap_writer.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they are");

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

// Opcodes of records.
enum : unsigned char {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};
constexpr std::size_t kRecordHead = 9;  // opcode and length

std::uint32_t crc32_of(std::string_view bytes, std::uint32_t before = 0) {
  return static_cast<std::uint32_t>(
      ::crc32_z(before, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
}

/// Bytes of a record's content.
class Out {
 public:
  template <class Number>
  Out& number(Number value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Out& text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
    return *this;
  }
  Out& map(const McapMetadata& values) {
    Out entries;
    for (const auto& [name, value] : values) entries.text(name).text(value);
    return text(entries.bytes_);
  }
  template <class Pairs>
  Out& numbers(const Pairs& pairs) {
    Out entries;
    for (const auto& [first, second] : pairs) entries.number(first).number(second);
    return text(entries.bytes_);
  }
  const std::string& bytes() const { return bytes_; }
  std::string record(unsigned char opcode) const {
    Out head;
    head.number(opcode).number(static_cast<std::uint64_t>(bytes_.size()));
    return head.bytes_ + bytes_;
  }

 private:
  std::string bytes_;
};

/// Reads a record's content; what it lacks is told by `fail`.
template <class Fail>
class In {
 public:
  In(std::string_view bytes, const Fail& fail) : bytes_(bytes), fail_(fail) {}

  template <class Number>
  Number number() {
    Number value;
    std::memcpy(&value, raw(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view text() { return raw(number<std::uint32_t>()); }
  std::string_view raw(std::uint64_t length) {
    if (length > bytes_.size()) fail_("a record ends beyond its place");
    const std::string_view part = bytes_.substr(0, length);
    bytes_.remove_prefix(length);
    return part;
  }
  McapMetadata map() {
    McapMetadata values;
    for (In entries(text(), fail_); !entries.empty();) {
      const std::string_view name = entries.text();
      values[std::string(name)] = entries.text();
    }
    return values;
  }
  bool empty() const { return bytes_.empty(); }
  std::string_view rest() const { return bytes_; }

 private:
  std::string_view bytes_;
  const Fail& fail_;
};

}  // namespace

// Writing.

McapWriter::McapWriter(const std::string& path, const Options& options) : path_(path), options_(options) {
  file_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (file_ < 0 && errno == EEXIST) throw Error("is there already", path, "choose another name, or remove it");
  if (file_ < 0) throw Error(std::string("cannot be made: ") + std::strerror(errno), path);
  try {
    put(kMagic);
    put(Out().text(options_.profile).text(options_.library).record(kHeader));
    about_ = at_;
    put(Out().text("recording").map(options_.about).record(kMetadata));
    about_length_ = at_ - about_;
  } catch (const Error&) {
    ::close(file_);
    ::unlink(path.c_str());  // a recording without a beginning would only stand in the way of the next start
    throw;
  }
}

McapWriter::~McapWriter() {
  if (file_ >= 0) ::close(file_);
}

void McapWriter::put(std::string_view bytes) {
  at_ += bytes.size();
  crc_ = crc32_of(bytes, crc_);
  while (!bytes.empty()) {
    const ssize_t written = ::write(file_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) throw Error(std::string("cannot be written: ") + std::strerror(errno), path_);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

std::uint16_t McapWriter::add(const McapChannel& channel) {
  channels_.emplace_back();
  const auto number = static_cast<std::uint16_t>(channels_.size());
  const std::string schema =
      Out().number(number).text(channel.type).text(channel.schema_encoding).text(channel.schema).record(kSchema);
  const std::string record = Out()
                                 .number(number)
                                 .number(number)
                                 .text(channel.topic)
                                 .text(channel.encoding)
                                 .map(channel.metadata)
                                 .record(kChannel);
  put(schema + record);
  schema_records_ += schema;
  channel_records_ += record;
  return number;
}

void McapWriter::write(std::uint16_t channel, std::uint64_t time, std::span<const std::byte> data) {
  if (chunk_.empty()) chunk_first_ = chunk_last_ = time;
  chunk_first_ = std::min(chunk_first_, time);
  chunk_last_ = std::max(chunk_last_, time);
  Channel& to = channels_.at(channel - 1u);
  to.index.emplace_back(time, chunk_.size());
  Out message;
  message.number(channel).number(++to.written).number(time).number(time);
  const std::uint64_t length = message.bytes().size() + data.size();
  chunk_ += Out().number(static_cast<unsigned char>(kMessage)).number(length).bytes();
  chunk_ += message.bytes();
  chunk_.append(reinterpret_cast<const char*>(data.data()), data.size());
  if (chunk_.size() >= options_.chunk_bytes || chunk_last_ - chunk_first_ >= options_.chunk_nanoseconds) flush();
}

void McapWriter::flush() {
  if (chunk_.empty()) return;
  Chunk chunk{chunk_first_, chunk_last_, at_, 0, 0, chunk_.size(), {}};
  Out content;
  content.number(chunk.first)
      .number(chunk.last)
      .number(chunk.size)
      .number(crc32_of(chunk_))
      .text("")  // no compression
      .number(chunk.size);
  Out head;
  head.number(static_cast<unsigned char>(kChunk)).number(std::uint64_t{content.bytes().size() + chunk_.size()});
  std::string bytes = head.bytes() + content.bytes() + chunk_;
  chunk.length = bytes.size();
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    if (channels_[i].index.empty()) continue;
    const auto number = static_cast<std::uint16_t>(i + 1);
    chunk.indexes[number] = at_ + bytes.size();
    bytes += Out().number(number).numbers(channels_[i].index).record(kMessageIndex);
    channels_[i].index.clear();
  }
  chunk.index_length = bytes.size() - chunk.length;
  chunk_.clear();
  put(bytes);
  chunks_.push_back(std::move(chunk));
}

void McapWriter::close() {
  flush();
  put(Out().number(crc_).record(kDataEnd));

  const std::uint64_t summary = at_;
  std::string bytes, offsets;
  const auto group = [&](unsigned char opcode, const std::string& records) {
    if (records.empty()) return;
    offsets += Out()
                   .number(opcode)
                   .number(summary + bytes.size())
                   .number(static_cast<std::uint64_t>(records.size()))
                   .record(kSummaryOffset);
    bytes += records;
  };
  group(kSchema, schema_records_);
  group(kChannel, channel_records_);
  std::uint64_t first = std::numeric_limits<std::uint64_t>::max(), last = 0;
  std::string indexes;
  for (const Chunk& chunk : chunks_) {
    first = std::min(first, chunk.first);
    last = std::max(last, chunk.last);
    indexes += Out()
                   .number(chunk.first)
                   .number(chunk.last)
                   .number(chunk.start)
                   .number(chunk.length)
                   .numbers(chunk.indexes)
                   .number(chunk.index_length)
                   .text("")
                   .number(chunk.size)
                   .number(chunk.size)
                   .record(kChunkIndex);
  }
  std::uint64_t messages = 0;
  std::map<std::uint16_t, std::uint64_t> counts;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    messages += channels_[i].written;
    counts[static_cast<std::uint16_t>(i + 1)] = channels_[i].written;
  }
  const auto channels = static_cast<std::uint32_t>(channels_.size());
  group(kStatistics, Out()
                         .number(messages)
                         .number(static_cast<std::uint16_t>(channels))
                         .number(channels)
                         .number(std::uint32_t{0})  // attachments
                         .number(std::uint32_t{1})  // metadata
                         .number(static_cast<std::uint32_t>(chunks_.size()))
                         .number(chunks_.empty() ? 0 : first)
                         .number(last)
                         .numbers(counts)
                         .record(kStatistics));
  group(kMetadataIndex, Out().number(about_).number(about_length_).text("recording").record(kMetadataIndex));
  group(kChunkIndex, indexes);

  Out footer;
  footer.number(summary).number(summary + bytes.size());
  Out head;
  head.number(static_cast<unsigned char>(kFooter)).number(std::uint64_t{footer.bytes().size() + sizeof(std::uint32_t)});
  bytes += offsets + head.bytes() + footer.bytes();
  const std::uint32_t crc = crc32_of(bytes);
  put(bytes + Out().number(crc).bytes() + std::string(kMagic));
  if (::close(std::exchange(file_, -1)) != 0)
    throw Error(std::string("cannot be written: ") + std::strerror(errno), path_);
}

// Reading.

McapReader::McapReader(const std::string& path) : path_(path) {
  refuse_special_file(path_);
  file_.open(path_, std::ios::binary);
  std::string magic(kMagic.size(), '\0');
  if (!file_) throw Error(std::string("cannot be read: ") + std::strerror(errno), path_);
  file_.seekg(0, std::ios::end);
  const std::streamoff size = file_.tellg();
  file_.seekg(0);
  if (size < 0 || !file_) throw Error("cannot be read", path_);
  size_ = static_cast<std::uint64_t>(size);
  file_.read(magic.data(), static_cast<std::streamsize>(magic.size()));
  file_.clear();
  if (magic != kMagic) throw Error("is no MCAP file", path_, "it does not begin as one of version 0 does");
  at_ = kMagic.size();
  if (!read_record()) return;
  const auto wrong = [this](const char* what) { fail(what); };
  if (opcode_ == kHeader)
    profile_ = In(std::string_view(content_), wrong).text();
  else
    at_ = kMagic.size();
}

void McapReader::fail(const std::string& what, const std::string& remedy) const {
  throw Error(what, path_ + ": byte " + std::to_string(record_), remedy);
}

void McapReader::cut_short() {
  ended_ = true;
  missing_ = "cut short after " + std::to_string(size_) + " bytes; whole up to byte " + std::to_string(record_);
}

/// Reads the next record of the file into content_. Returns false when there is none or not all of it.
bool McapReader::read_record() {
  record_ = at_;
  char head[kRecordHead];
  if (size_ - at_ < sizeof head || !file_.seekg(static_cast<std::streamoff>(at_)) || !file_.read(head, sizeof head)) {
    cut_short();
    return false;
  }
  std::uint64_t length;
  opcode_ = static_cast<unsigned char>(head[0]);
  std::memcpy(&length, head + 1, sizeof length);
  // Where a machine went off, a file may end in zeros.
  if (length > size_ - at_ - sizeof head || opcode_ == 0) {
    cut_short();
    return false;
  }
  at_ += sizeof head + length;
  // What is not asked for is not read: indexes, attachments, what other versions may have.
  const bool wanted = opcode_ == kHeader || opcode_ == kSchema || opcode_ == kChannel || opcode_ == kMessage ||
                      opcode_ == kChunk || opcode_ == kMetadata;
  if (wanted && length > kMaxRecordBytes) fail("a record of " + std::to_string(length) + " bytes");
  content_.resize(wanted ? length : 0);
  if (!file_.read(content_.data(), static_cast<std::streamsize>(content_.size()))) fail("cannot be read");
  return true;
}

void McapReader::take_schema(std::string_view content) {
  const auto wrong = [this](const char* what) { fail(what); };
  In in(content, wrong);
  const auto number = in.number<std::uint16_t>();
  Schema& schema = schemas_[number];
  schema.name = in.text();
  schema.encoding = in.text();
  schema.data = in.text();
}

void McapReader::take_channel(std::string_view content) {
  const auto wrong = [this](const char* what) { fail(what); };
  In in(content, wrong);
  const auto number = in.number<std::uint16_t>();
  const auto schema_number = in.number<std::uint16_t>();
  if (channels_.contains(number)) return;  // said again; messages point at the first
  McapChannel channel;
  channel.topic = in.text();
  channel.encoding = in.text();
  channel.metadata = in.map();
  if (schema_number != 0) {
    const auto schema = schemas_.find(schema_number);
    if (schema == schemas_.end()) fail("channel '" + channel.topic + "' is of a schema that was not announced");
    channel.type = schema->second.name;
    channel.schema_encoding = schema->second.encoding;
    channel.schema = schema->second.data;
  }
  channels_.emplace(number, std::move(channel));
}

void McapReader::take_chunk(std::string_view content) {
  const auto wrong = [this](const char* what) { fail(what); };
  In in(content, wrong);
  in.number<std::uint64_t>();  // first and last time
  in.number<std::uint64_t>();
  const auto size = in.number<std::uint64_t>();
  const auto crc = in.number<std::uint32_t>();
  const std::string compression(in.text());
  const std::string_view records = in.raw(in.number<std::uint64_t>());
  if (size > kMaxRecordBytes) fail("a chunk of " + std::to_string(size) + " bytes");
  chunk_at_ = 0;
  if (compression.empty())
    chunk_ = records;
  else if (const std::string fault = decompress(compression, records, size, chunk_); !fault.empty())
    fail("a chunk " + fault);
  if (chunk_.size() != size) fail("a chunk is not as long as it says");
  if (crc != 0 && crc32_of(chunk_) != crc) fail("a chunk is damaged: its checksum is another");
}

McapMessage McapReader::message(std::string_view content, std::uint64_t offset) const {
  const auto wrong = [this](const char* what) { fail(what); };
  In in(content, wrong);
  const auto number = in.number<std::uint16_t>();
  const auto channel = channels_.find(number);
  if (channel == channels_.end()) fail("a message of channel " + std::to_string(number) + ", which was not announced");
  McapMessage message;
  message.channel = &channel->second;
  message.sequence = in.number<std::uint32_t>();
  message.log_time = in.number<std::uint64_t>();
  in.number<std::uint64_t>();  // of its publication
  message.data = std::as_bytes(std::span(in.rest()));
  message.place = {record_, offset};
  return message;
}

McapMessage McapReader::read(const McapPlace& place) {
  if (record_ != place.record) {
    at_ = place.record;
    if (!read_record()) fail("has changed since it was opened");
    if (opcode_ == kChunk) take_chunk(content_);
  }
  if (opcode_ == kMessage) return message(content_, 0);
  chunk_at_ = place.offset;
  std::optional<McapMessage> found = opcode_ == kChunk && place.offset < chunk_.size() ? next() : std::nullopt;
  if (!found || found->place.record != place.record || found->place.offset != place.offset)
    fail("has changed since it was opened");
  return *found;
}

std::optional<McapMessage> McapReader::next() {
  const auto wrong = [this](const char* what) { fail(what); };
  while (true) {
    while (chunk_at_ < chunk_.size()) {
      In in(std::string_view(chunk_).substr(chunk_at_), wrong);
      const auto opcode = in.number<unsigned char>();
      const std::string_view content = in.raw(in.number<std::uint64_t>());
      const std::uint64_t offset = std::exchange(chunk_at_, chunk_at_ + kRecordHead + content.size());
      if (opcode == kSchema) take_schema(content);
      if (opcode == kChannel) take_channel(content);
      if (opcode == kMessage) return message(content, offset);
    }
    if (ended_ || !read_record()) return std::nullopt;
    switch (opcode_) {
      case kSchema:
        take_schema(content_);
        break;
      case kChannel:
        take_channel(content_);
        break;
      case kMessage:
        return message(content_, 0);
      case kChunk:
        take_chunk(content_);
        break;
      case kMetadata: {
        In in(content_, wrong);
        const std::string name(in.text());
        metadata_[name] = in.map();
        break;
      }
      case kFooter:
        ended_ = true;
        if (size_ - at_ < kMagic.size()) cut_short();
        break;
      default:
        break;  // of no concern here, or of a later version
    }
  }
}

}  // namespace citylearn
