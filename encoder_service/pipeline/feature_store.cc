// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/feature_store.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <string_view>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/sha256.h"
#include "core/wire/messages.h"

// The file: a header, an index of one entry a frame, and from the next multiple of 4 KiB on F x D floats. A frame is
// written before its entry, and its entry in one piece, so an entry never refers to numbers that are not there.

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "the store is written as it lies in memory");

constexpr std::string_view kMagic = "CLFEAT\r\n";
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kPresent = 0x746E7250;
constexpr int kMaxDescriptor = 1 << 20;
constexpr const char* kRemake = "delete it, and its frames are encoded again";

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t dimension;
  std::uint64_t traversal;
  std::uint32_t frames;
  std::uint32_t encoder_size;
  char encoder[200];  // zeros behind its end
  char zeros[276];
  std::uint32_t checksum;  // CRC-32 of what is before
};
static_assert(sizeof(Header) == 512);

struct Entry {
  std::uint32_t state;     // kPresent, or anything else: absent
  std::uint32_t checksum;  // CRC-32 of the frame's number (32 bits) and its D floats
};
static_assert(sizeof(Entry) == 8, "an entry lies within one page, so it is written in one piece");

std::uint32_t checksum(std::uint32_t seed, const void* bytes, std::size_t size) {
  return static_cast<std::uint32_t>(::crc32_z(seed, static_cast<const unsigned char*>(bytes), size));
}

Header header_of(const FeatureStore::Key& key) {
  Header header{};
  std::memcpy(header.magic, kMagic.data(), kMagic.size());
  header.version = kVersion;
  header.dimension = static_cast<std::uint32_t>(key.dimension);
  header.traversal = key.traversal;
  header.frames = static_cast<std::uint32_t>(key.frames);
  header.encoder_size = static_cast<std::uint32_t>(key.encoder.size());
  std::memcpy(header.encoder, key.encoder.data(), key.encoder.size());
  header.checksum = checksum(0, &header, offsetof(Header, checksum));
  return header;
}

/// Names the file by a digest: names of encoders hold blanks, and two may differ in their last letters alone.
std::string file_name(const FeatureStore::Key& key) {
  return fmt::format("{}-{:016x}.features", sha256(key.encoder).substr(0, 8), key.traversal);
}

void check_key(const FeatureStore::Key& key, const std::string& folder) {
  if (key.encoder.empty() || key.encoder.size() > sizeof Header::encoder)
    throw Error("an encoder's name has 1 to 200 characters, not " + std::to_string(key.encoder.size()), folder);
  if (key.dimension < 1 || key.dimension > kMaxDescriptor)
    throw Error(
        "a descriptor has 1 to " + std::to_string(kMaxDescriptor) + " numbers, not " + std::to_string(key.dimension),
        folder);
  if (key.frames < 1 || key.frames > static_cast<int>(msg::MAX_FRAMES))
    throw Error(
        "a traversal has 1 to " + std::to_string(msg::MAX_FRAMES) + " frames, not " + std::to_string(key.frames),
        folder);
}

/// Closes a file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  operator int() const { return number_; }

 private:
  int number_;
};

[[noreturn]] void fail(const std::string& doing, const std::string& path) {
  const int why = errno;
  const bool full = why == ENOSPC || why == EDQUOT || why == EFBIG;
  throw Error(doing + ": " + std::strerror(why), path,
              full ? "make room; the frames stored so far are kept" : "is it on a disk that this user may write to?");
}

/// Reads as many bytes as there are, up to `size`.
std::size_t read_at(int file, void* bytes, std::size_t size, std::int64_t at, const std::string& path) {
  std::size_t done = 0;
  while (done < size) {
    const ssize_t count = ::pread(file, static_cast<char*>(bytes) + done, size - done, at + static_cast<off_t>(done));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail("cannot be read", path);
    if (count == 0) break;
    done += static_cast<std::size_t>(count);
  }
  return done;
}

void write_at(int file, const void* bytes, std::size_t size, std::int64_t at, const std::string& path) {
  std::size_t done = 0;
  while (done < size) {
    const ssize_t count =
        ::pwrite(file, static_cast<const char*>(bytes) + done, size - done, at + static_cast<off_t>(done));
    if (count < 0 && errno == EINTR) continue;
    if (count == 0) errno = ENOSPC;
    if (count <= 0) fail("cannot be written", path);
    done += static_cast<std::size_t>(count);
  }
}

/// Open file description locks belong to the one opening of the file, so two stores of one process exclude each other,
/// and the kernel drops them with the process. Beyond the file's end they lie where no numbers are.
constexpr std::int64_t kClaims = std::int64_t{1} << 61, kWrites = std::int64_t{1} << 62;

struct flock range(short type, std::int64_t first, int count) {
  struct flock range {};
  range.l_type = type;
  range.l_whence = SEEK_SET;
  range.l_start = first;
  range.l_len = count;
  return range;
}

/// Without `wait`, returns false when another one has it.
bool lock(int file, std::int64_t first, int count, bool wait, const std::string& path) {
  struct flock wanted = range(F_WRLCK, first, count);
  while (::fcntl(file, wait ? F_OFD_SETLKW : F_OFD_SETLK, &wanted) != 0) {
    if (errno == EINTR) continue;
    if (!wait && (errno == EAGAIN || errno == EACCES)) return false;
    throw Error(std::string("cannot be locked: ") + std::strerror(errno), path, "use a disk whose files can be locked");
  }
  return true;
}

void unlock(int file, std::int64_t first, int count) {
  struct flock held = range(F_UNLCK, first, count);
  ::fcntl(file, F_OFD_SETLK, &held);
}

/// Creates a store without frames, all at once under its name; one that is there already stays. Frames take disk space
/// as they are written.
void create(const std::string& path, const Header& header, std::int64_t size) {
  std::string name = path + ".new-XXXXXX";
  const Descriptor file(::mkostemp(name.data(), O_CLOEXEC));
  if (file < 0) fail("cannot be created", path);
  try {
    if (::fchmod(file, 0644) != 0 || ::ftruncate(file, size) != 0) fail("cannot be created", path);
    write_at(file, &header, sizeof header, 0, path);
    if (::fsync(file) != 0) fail("cannot be created", path);
    // Where files have one name only (FAT), the rename does as well.
    if (::link(name.c_str(), path.c_str()) != 0 && errno != EEXIST &&
        ::renameat2(AT_FDCWD, name.c_str(), AT_FDCWD, path.c_str(), RENAME_NOREPLACE) != 0 && errno != EEXIST)
      fail("cannot be created", path);
  } catch (...) {
    ::unlink(name.c_str());
    throw;
  }
  ::unlink(name.c_str());
}

void check_file(int file, const Header& wanted, std::int64_t size, const std::string& path) {
  struct stat status {};
  if (::fstat(file, &status) != 0) fail("cannot be read", path);
  if (!S_ISREG(status.st_mode)) throw Error("is not a file", path, "move it away");
  Header header{};
  const std::size_t there = read_at(file, &header, sizeof header, 0, path);
  if (std::memcmp(header.magic, kMagic.data(), std::min(there, kMagic.size())) != 0)
    throw Error("is not a feature store", path, "move it away");
  if (there < sizeof header) throw Error("the feature store is cut short", path, kRemake);
  if (header.checksum != checksum(0, &header, offsetof(Header, checksum)))
    throw Error("the feature store has a damaged header", path, kRemake);
  if (header.version != kVersion)
    throw Error("is a feature store of version " + std::to_string(header.version) + ", this program knows " +
                    std::to_string(kVersion),
                path, "use the program that wrote it, or delete it");
  if (std::memcmp(&header, &wanted, sizeof header) != 0) {
    std::string name(header.encoder, std::min<std::size_t>(header.encoder_size, sizeof header.encoder));
    for (char& c : name)
      if (c < ' ' || c > '~') c = '?';
    throw Error("belongs to encoder '" + name + "' with " + std::to_string(header.dimension) + " numbers a frame, " +
                    std::to_string(header.frames) + " frames of traversal " + fmt::format("{:016x}", header.traversal),
                path, "keep stores in another folder, or delete it");
  }
  if (status.st_size < size) throw Error("the feature store is cut short", path, kRemake);
  if (status.st_size > size) throw Error("the feature store is longer than it may be", path, kRemake);
}

}  // namespace

struct FeatureStore::Impl {
  Key key;
  std::string path;
  int file = -1;
  std::mutex mutex;           // of the members below and of writes: file locks do not exclude threads of one store
  std::vector<bool> claimed;  // by this object

  ~Impl() {
    if (file >= 0) ::close(file);
  }
  std::int64_t entry_at(int frame) const {
    return static_cast<std::int64_t>(sizeof(Header) + sizeof(Entry) * static_cast<std::size_t>(frame));
  }
  std::size_t frame_size() const { return sizeof(float) * static_cast<std::size_t>(key.dimension); }
  std::int64_t frame_at(int frame) const {
    const std::int64_t index_end = entry_at(key.frames), begin = (index_end + 4095) / 4096 * 4096;
    return begin + static_cast<std::int64_t>(frame_size()) * frame;
  }
  std::int64_t size() const { return frame_at(key.frames); }
  void check(int first, int count) const {
    if (first < 0 || count < 1 || first > key.frames - count)
      throw Error("has no frames " + std::to_string(first) + " to " + std::to_string(std::int64_t{first} + count - 1) +
                      ", it has " + std::to_string(key.frames),
                  path);
  }
  void check(int frame, std::size_t dimension) const {
    check(frame, 1);
    if (dimension != static_cast<std::size_t>(key.dimension))
      throw Error("holds " + std::to_string(key.dimension) + " numbers a frame, not " + std::to_string(dimension),
                  path);
  }
  /// Includes the frame's number, so that numbers in another frame's place do not count.
  std::uint32_t checksum_of(int frame, const float* numbers) const {
    return checksum(checksum(0, &frame, sizeof frame), numbers, frame_size());
  }
  bool read(int frame, float* numbers) const {
    Entry entry{};
    if (read_at(file, &entry, sizeof entry, entry_at(frame), path) < sizeof entry || entry.state != kPresent)
      return false;
    return read_at(file, numbers, frame_size(), frame_at(frame), path) == frame_size() &&
           checksum_of(frame, numbers) == entry.checksum;
  }
};

FeatureStore::FeatureStore(const std::string& folder, const Key& key) : impl_(std::make_shared<Impl>()) {
  check_key(key, folder);
  create_folder(folder);
  Impl& impl = *impl_;
  impl.key = key;
  impl.path = (std::filesystem::path(folder) / file_name(key)).string();
  impl.claimed.resize(static_cast<std::size_t>(key.frames));
  const Header header = header_of(key);
  const auto open = [&] { impl.file = ::open(impl.path.c_str(), O_RDWR | O_CLOEXEC | O_NONBLOCK | O_NOCTTY); };
  open();
  if (impl.file < 0 && errno == ENOENT) {
    create(impl.path, header, impl.size());
    open();
  }
  if (impl.file < 0) fail("cannot be opened", impl.path);
  check_file(impl.file, header, impl.size(), impl.path);
}

FeatureStore::~FeatureStore() = default;

bool FeatureStore::read(int frame, std::span<float> descriptor) const {
  impl_->check(frame, descriptor.size());
  return impl_->read(frame, descriptor.data());
}

void FeatureStore::write(int frame, std::span<const float> descriptor) {
  Impl& impl = *impl_;
  impl.check(frame, descriptor.size());
  // Two processes that write one frame at once would mix their numbers, which differ by rounding.
  const std::lock_guard guard(impl.mutex);
  lock(impl.file, kWrites + frame, 1, true, impl.path);
  struct Unlock {
    int file, frame;
    ~Unlock() { unlock(file, kWrites + frame, 1); }
  } at_the_end{impl.file, frame};
  std::vector<float> there(descriptor.size());
  if (impl.read(frame, there.data())) return;
  write_at(impl.file, descriptor.data(), impl.frame_size(), impl.frame_at(frame), impl.path);
  const Entry entry{kPresent, impl.checksum_of(frame, descriptor.data())};
  write_at(impl.file, &entry, sizeof entry, impl.entry_at(frame), impl.path);
}

std::vector<bool> FeatureStore::present() const {
  std::vector<Entry> entries(static_cast<std::size_t>(impl_->key.frames));
  read_at(impl_->file, entries.data(), entries.size() * sizeof(Entry), impl_->entry_at(0), impl_->path);
  std::vector<bool> present;
  present.reserve(entries.size());
  for (const Entry& entry : entries) present.push_back(entry.state == kPresent);
  return present;
}

std::unique_ptr<FeatureStore::Claim> FeatureStore::claim(int first, int count) {
  class Lock : public Claim {
   public:
    Lock(const std::shared_ptr<Impl>& impl, int first, int count) : impl_(impl), first_(first), count_(count) {}
    ~Lock() override {
      const std::shared_ptr<Impl> impl = impl_.lock();
      if (!impl) return;  // with the store its file was closed, and that released it
      const std::lock_guard guard(impl->mutex);
      std::fill_n(impl->claimed.begin() + first_, count_, false);
      unlock(impl->file, kClaims + first_, count_);
    }

   private:
    std::weak_ptr<Impl> impl_;
    int first_, count_;
  };
  Impl& impl = *impl_;
  impl.check(first, count);
  const std::lock_guard guard(impl.mutex);
  const auto begin = impl.claimed.begin() + first, end = begin + count;
  if (std::find(begin, end, true) != end) return nullptr;
  if (!lock(impl.file, kClaims + first, count, false, impl.path)) return nullptr;
  std::fill(begin, end, true);
  return std::make_unique<Lock>(impl_, first, count);
}

const std::string& FeatureStore::path() const { return impl_->path; }

}  // namespace citylearn
