// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/feature_store.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <random>
#include <thread>

#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

const FeatureStore::Key kStoreKey{"hog-1 bins=12", 32, 0x0123456789ABCDEF, 50};

/// Returns the descriptor that any process writes for this frame.
std::vector<float> descriptor(int frame, int dimension) {
  std::vector<float> numbers(static_cast<std::size_t>(dimension));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    numbers[i] = static_cast<float>(frame) + static_cast<float>(i) / 1024.0f;
  return numbers;
}

void write(FeatureStore& store, const FeatureStore::Key& key, int frame) {
  store.write(frame, descriptor(frame, key.dimension));
}

/// Returns whether the frame is there. Wrong numbers are a test failure.
bool read(const FeatureStore& store, const FeatureStore::Key& key, int frame) {
  std::vector<float> numbers(static_cast<std::size_t>(key.dimension), -1.0f);
  if (!store.read(frame, numbers)) return false;
  EXPECT_EQ(numbers, descriptor(frame, key.dimension)) << "frame " << frame;
  return true;
}

int count(const std::vector<bool>& present) {
  return static_cast<int>(std::count(present.begin(), present.end(), true));
}

std::string opening(const Folder& folder, const FeatureStore::Key& key = kStoreKey) {
  return error_of([&] { FeatureStore(folder.path(), key); });
}

/// A child process that runs `action` and ends with its result.
pid_t child(const std::function<int()>& action) {
  const pid_t process = ::fork();
  if (process != 0) return process;
  int status = 99;
  try {
    status = action();
  } catch (const std::exception& exception) {
    std::fprintf(stderr, "%s\n", exception.what());
  }
  ::_exit(status);
}

int status_of(pid_t process) {
  int status = 0;
  ::waitpid(process, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

struct FeatureStoreTest : ::testing::Test {
  const Folder folder;
};

TEST_F(FeatureStoreTest, KeepsWhatWasWritten) {
  const std::string deeper = folder / "made/when/missing";
  {
    FeatureStore store(deeper, kStoreKey);
    EXPECT_EQ(count(store.present()), 0);
    EXPECT_EQ(store.present().size(), 50u);
    EXPECT_FALSE(read(store, kStoreKey, 0));
    for (const int frame : {0, 7, 49}) write(store, kStoreKey, frame);
    EXPECT_TRUE(read(store, kStoreKey, 7));
  }
  const FeatureStore store(deeper, kStoreKey);
  EXPECT_EQ(fs::path(store.path()).filename(), "8e45658d-0123456789abcdef.features");
  for (int frame = 0; frame < 50; ++frame) {
    const bool there = frame == 0 || frame == 7 || frame == 49;
    EXPECT_EQ(store.present()[frame], there);
    EXPECT_EQ(read(store, kStoreKey, frame), there);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(deeper), {}), 1) << "something temporary stayed";
}

TEST_F(FeatureStoreTest, AFrameIsWrittenOnce) {
  FeatureStore store(folder.path(), kStoreKey);
  write(store, kStoreKey, 3);
  store.write(3, std::vector<float>(32, 0.5f));
  EXPECT_TRUE(read(store, kStoreKey, 3)) << "the first one stays";
}

TEST_F(FeatureStoreTest, OtherKeysOtherFiles) {
  const FeatureStore::Key night{kStoreKey.encoder, 32, 1, 50}, other{"hog-1 bins=13", 32, kStoreKey.traversal, 50};
  FeatureStore a(folder.path(), kStoreKey), b(folder.path(), night), c(folder.path(), other);
  write(a, kStoreKey, 1);
  EXPECT_EQ(count(b.present()), 0);
  EXPECT_EQ(count(c.present()), 0);
}

TEST_F(FeatureStoreTest, TakesNoRoomBeforeItsFrames) {
  const FeatureStore store(folder.path(), {"netvlad", 32768, 1, 100000});  // 13 GB
  struct stat status {};
  ASSERT_EQ(::stat(store.path().c_str(), &status), 0);
  EXPECT_LT(status.st_blocks * 512, 1 << 20);
}

TEST_F(FeatureStoreTest, RefusesKeysOutOfBounds) {
  EXPECT_TRUE(contains(opening(folder, {"", 4, 1, 4}), "1 to 200 characters, not 0"));
  EXPECT_TRUE(contains(opening(folder, {std::string(201, 'x'), 4, 1, 4}), "1 to 200 characters, not 201"));
  EXPECT_TRUE(contains(opening(folder, {"x", 0, 1, 4}), "numbers, not 0"));
  EXPECT_TRUE(contains(opening(folder, {"x", 1 << 30, 1, 4}), "numbers, not 1073741824"));
  EXPECT_TRUE(contains(opening(folder, {"x", 4, 1, 0}), "frames, not 0"));
  EXPECT_TRUE(contains(opening(folder, {"x", 4, 1, 1 << 30}), "frames, not 1073741824"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 0);
}

TEST_F(FeatureStoreTest, RefusesFramesAndSizesThatItHasNot) {
  FeatureStore store(folder.path(), kStoreKey);
  std::vector<float> right(32), wrong(31);
  EXPECT_THROW(store.read(-1, right), Error);
  EXPECT_THROW(store.read(50, right), Error);
  EXPECT_THROW(store.write(50, right), Error);
  EXPECT_THROW(store.read(0, wrong), Error);
  EXPECT_THROW(store.write(0, wrong), Error);
  EXPECT_THROW(store.claim(-1, 2), Error);
  EXPECT_THROW(store.claim(0, 0), Error);
  EXPECT_THROW(store.claim(49, 2), Error);
  EXPECT_THROW(store.claim(2, std::numeric_limits<int>::max()), Error);
}

TEST_F(FeatureStoreTest, ClaimsExcludeEachOther) {
  FeatureStore one(folder.path(), kStoreKey);
  auto other = std::make_unique<FeatureStore>(folder.path(), kStoreKey);
  auto claim = one.claim(10, 10);
  ASSERT_TRUE(claim);
  EXPECT_FALSE(other->claim(19, 1));
  EXPECT_FALSE(other->claim(0, 50));
  EXPECT_FALSE(one.claim(15, 10)) << "not even by the same object";
  auto before = other->claim(0, 10), after = other->claim(20, 30);
  EXPECT_TRUE(before);
  EXPECT_TRUE(after);
  EXPECT_FALSE(one.claim(9, 1));
  claim.reset();
  EXPECT_TRUE(other->claim(10, 10)) << "released";
  EXPECT_TRUE(one.claim(10, 10)) << "released at once";
  other.reset();
  EXPECT_TRUE(one.claim(0, 50)) << "claims end with their object";
  before.reset();
  after.reset();
  // A claim binds those who claim, nobody else.
  claim = one.claim(0, 50);
  FeatureStore third(folder.path(), kStoreKey);
  write(third, kStoreKey, 4);
  EXPECT_TRUE(read(one, kStoreKey, 4));
}

TEST_F(FeatureStoreTest, ClaimsEndWithTheirProcess) {
  FeatureStore store(folder.path(), kStoreKey);
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t holder = child([&] {
    FeatureStore own(folder.path(), kStoreKey);
    const auto claim = own.claim(5, 5);
    const char answer = claim ? 'y' : 'n';
    if (::write(ready[1], &answer, 1) != 1) return 1;
    ::pause();
    return 0;
  });
  char answer = 0;
  ASSERT_EQ(::read(ready[0], &answer, 1), 1);
  EXPECT_EQ(answer, 'y');
  EXPECT_FALSE(store.claim(9, 2));
  ::kill(holder, SIGKILL);
  EXPECT_EQ(status_of(holder), 128 + SIGKILL);
  EXPECT_TRUE(store.claim(9, 2));
  ::close(ready[0]);
  ::close(ready[1]);
}

TEST(FeatureStoreProcesses, CreateAndWriteAtOnce) {
  FeatureStore::Key key = kStoreKey;
  key.frames = 400;
  key.dimension = 500;
  for (int round = 0; round < 5; ++round) {
    const Folder folder;
    std::vector<pid_t> writers;
    // Each writes all frames, two upwards and two downwards, all reading what the others have written so far.
    for (int process = 0; process < 4; ++process)
      writers.push_back(child([&, process] {
        FeatureStore store(folder.path(), key);
        for (int i = 0; i < key.frames; ++i) {
          const int frame = process % 2 ? key.frames - 1 - i : i;
          write(store, key, frame);
          if (!read(store, key, frame)) return 1;
          read(store, key, (frame * 7) % key.frames);
          if (::testing::Test::HasFailure()) return 2;
        }
        return 0;
      }));
    for (const pid_t writer : writers) EXPECT_EQ(status_of(writer), 0);
    const FeatureStore store(folder.path(), key);
    for (int frame = 0; frame < key.frames; ++frame) EXPECT_TRUE(read(store, key, frame)) << frame;
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
  }
}

TEST_F(FeatureStoreTest, ThreadsShareOne) {
  FeatureStore store(folder.path(), kStoreKey);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int frame = 0; frame < kStoreKey.frames; ++frame) write(store, kStoreKey, frame);
    });
  for (std::thread& thread : threads) thread.join();
  for (int frame = 0; frame < kStoreKey.frames; ++frame) EXPECT_TRUE(read(store, kStoreKey, frame));
}

TEST_F(FeatureStoreTest, SurvivesKill) {
  FeatureStore::Key key = kStoreKey;
  key.frames = 60000;
  key.dimension = 700;  // not a divisor of a page: frames straddle them
  FeatureStore store(folder.path(), key);
  std::mt19937 random(1);
  int first = 0, kills = 0;
  while (kills < 40) {
    int tell[2];
    ASSERT_EQ(::pipe(tell), 0);
    ASSERT_EQ(::fcntl(tell[1], F_SETPIPE_SZ, 4096), 4096);  // the writer can be no more than 1024 frames ahead
    const int begin = first;
    const pid_t writer = child([&] {
      FeatureStore own(folder.path(), key);
      for (int frame = begin; frame < key.frames; ++frame) {
        write(own, key, frame);
        if (::write(tell[1], &frame, sizeof frame) != sizeof frame) return 1;
      }
      return 0;
    });
    ::close(tell[1]);
    const int enough = begin + 1 + static_cast<int>(random() % 300);
    int told = begin - 1, frame = 0;
    while (told < enough && ::read(tell[0], &frame, sizeof frame) == sizeof frame) told = frame;
    ::kill(writer, SIGKILL);
    ASSERT_EQ(status_of(writer), 128 + SIGKILL);
    while (::read(tell[0], &frame, sizeof frame) == sizeof frame) told = frame;
    ::close(tell[0]);
    ++kills;
    ASSERT_LT(told + 1, key.frames);
    // What the dead one told of is there, and at most one frame more.
    for (frame = begin; frame <= told; ++frame) ASSERT_TRUE(read(store, key, frame)) << frame;
    const std::vector<bool> present = store.present();
    EXPECT_EQ(count(present), told + 1 + present[told + 1]);
    first = told + 1;
  }
  const std::vector<bool> present = store.present();
  for (int frame = 0; frame < first; ++frame) ASSERT_TRUE(present[frame] && read(store, key, frame)) << frame;
}

class DamagedStore : public ::testing::Test {
 protected:
  DamagedStore() {
    FeatureStore store(folder_.path(), kStoreKey);
    for (int frame = 0; frame < kStoreKey.frames; ++frame) write(store, kStoreKey, frame);
    path_ = store.path();
    bytes_ = contents(path_);
  }
  /// Returns the error of opening these bytes, which must stay unchanged.
  std::string opened(const std::string& bytes) {
    make_file(path_, bytes);
    std::string message = opening(folder_);
    EXPECT_EQ(contents(path_), bytes);
    EXPECT_TRUE(message.empty() || contains(message, path_)) << message;
    return message;
  }
  Folder folder_;
  std::string path_, bytes_;
};

TEST_F(DamagedStore, CutShort) {
  for (const std::size_t size : {std::size_t{0}, std::size_t{4}, std::size_t{511}, std::size_t{512}, std::size_t{900},
                                 std::size_t{4096}, bytes_.size() - 1})
    EXPECT_TRUE(contains(opened(bytes_.substr(0, size)), "cut short")) << size;
  EXPECT_TRUE(contains(opened(bytes_ + "x"), "longer"));
  EXPECT_EQ(opened(bytes_), "");
}

TEST_F(DamagedStore, CutWhileOpen) {
  FeatureStore store(folder_.path(), kStoreKey);
  ASSERT_EQ(::truncate(path_.c_str(), static_cast<off_t>(bytes_.size() - 40 * 128 - 1)), 0);
  EXPECT_TRUE(read(store, kStoreKey, 8));
  EXPECT_FALSE(read(store, kStoreKey, 9));
  EXPECT_FALSE(read(store, kStoreKey, 49));
  ASSERT_EQ(::truncate(path_.c_str(), 0), 0);
  EXPECT_FALSE(read(store, kStoreKey, 8));
  EXPECT_EQ(count(store.present()), 0);
}

TEST_F(DamagedStore, EveryBitOfTheHeaderCounts) {
  for (std::size_t bit = 0; bit < 512 * 8; bit += 3) {
    std::string bytes = bytes_;
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ 1 << bit % 8);
    make_file(path_, bytes);
    const std::string message = opening(folder_);
    EXPECT_TRUE(contains(message, bit < 64 ? "is not a feature store" : "damaged header")) << bit << message;
  }
}

TEST_F(DamagedStore, AFlippedBitCostsOneFrame) {
  std::mt19937 random(2);
  for (int round = 0; round < 200; ++round) {
    std::string bytes = bytes_;
    // In the index, or in the numbers.
    const std::size_t begin = round % 2 ? 512 : 4096, size = round % 2 ? 50 * 8 : 50 * 128;
    const std::size_t at = random() % size;
    bytes[begin + at] = static_cast<char>(bytes[begin + at] ^ 1 << random() % 8);
    make_file(path_, bytes);
    FeatureStore store(folder_.path(), kStoreKey);
    const int broken = static_cast<int>(at / (round % 2 ? 8 : 128));
    for (int frame = 0; frame < 50; ++frame) ASSERT_EQ(read(store, kStoreKey, frame), frame != broken) << frame;
    write(store, kStoreKey, broken);
    EXPECT_TRUE(read(store, kStoreKey, broken)) << "a torn frame is written again";
  }
}

TEST_F(DamagedStore, FramesInEachOthersPlaceAreNone) {
  std::string bytes = bytes_;
  std::swap_ranges(bytes.begin() + 512, bytes.begin() + 520, bytes.begin() + 520);
  std::swap_ranges(bytes.begin() + 4096, bytes.begin() + 4096 + 128, bytes.begin() + 4096 + 128);
  make_file(path_, bytes);
  const FeatureStore store(folder_.path(), kStoreKey);
  EXPECT_FALSE(read(store, kStoreKey, 0));
  EXPECT_FALSE(read(store, kStoreKey, 1));
  EXPECT_TRUE(read(store, kStoreKey, 2));
}

TEST_F(DamagedStore, AnotherKeysFileIsNamedAndLeft) {
  const Folder elsewhere;
  const FeatureStore::Key other{"tiny\n-1", 4, 77, 9};
  const std::string foreign = contents(FeatureStore(elsewhere.path(), other).path());
  const std::string message = opened(foreign);
  EXPECT_TRUE(contains(message, "belongs to encoder 'tiny?-1' with 4 numbers a frame, 9 frames")) << message;
  // The same encoder and traversal, but not the same shape.
  FeatureStore::Key wider = kStoreKey;
  wider.dimension = 33;
  make_file(path_, bytes_);
  EXPECT_TRUE(contains(opening(folder_, wider), "belongs to encoder 'hog-1 bins=12' with 32 numbers"));
}

TEST_F(DamagedStore, ForeignFilesAreNamedAndLeft) {
  EXPECT_TRUE(contains(opened("0.1,0.2,0.3\n0.2,0.3,0.4\n"), "is not a feature store"));
  EXPECT_TRUE(contains(opened(std::string(bytes_.size(), '\0')), "is not a feature store"));
  fs::remove(path_);
  fs::create_directory(path_);
  EXPECT_TRUE(contains(opening(folder_), "directory"));
  fs::remove(path_);
  ASSERT_EQ(::mkfifo(path_.c_str(), 0600), 0);
  EXPECT_TRUE(contains(opening(folder_), "is not a file"));
}

TEST_F(FeatureStoreTest, UnwritableFolders) {
  make_file(folder / "file", "text");
  EXPECT_TRUE(contains(error_of([&] { FeatureStore(folder / "file", kStoreKey); }), "file"));
  EXPECT_TRUE(contains(error_of([&] { FeatureStore(folder / "file/below", kStoreKey); }), "file/below"));
  EXPECT_TRUE(contains(error_of([&] { FeatureStore("", kStoreKey); }), "folder"));
  // Root may write anywhere: the child becomes nobody.
  fs::create_directory(folder / "locked");
  fs::permissions(folder.path(), fs::perms(0755));
  fs::permissions(folder / "locked", fs::perms(0555));
  const pid_t nobody = child([&] {
    if (::geteuid() == 0 && ::setuid(65534) != 0) return 1;
    const std::string message = error_of([&] { FeatureStore(folder / "locked", kStoreKey); });
    return contains(message, "Permission denied") && contains(message, ".features") ? 0 : 2;
  });
  EXPECT_EQ(status_of(nobody), 0);
}

TEST_F(FeatureStoreTest, AFullDiskKeepsTheFramesBefore) {
  FeatureStore store(folder.path(), kStoreKey);
  // A limit on a file's size stands for the disk's: the write that meets it is cut short, the next fails.
  const pid_t writer = child([&] {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{4096 + 10 * 128 + 60, RLIM_INFINITY};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return 1;
    FeatureStore own(folder.path(), kStoreKey);
    for (int frame = 0; frame < 10; ++frame) write(own, kStoreKey, frame);
    for (int frame = 10; frame < 13; ++frame) {
      const std::string message = error_of([&] { write(own, kStoreKey, frame); });
      if (!contains(message, own.path()) || !contains(message, "make room")) return 2;
      if (read(own, kStoreKey, frame)) return 3;
    }
    return 0;
  });
  EXPECT_EQ(status_of(writer), 0);
  for (int frame = 0; frame < 50; ++frame) EXPECT_EQ(read(store, kStoreKey, frame), frame < 10);
  write(store, kStoreKey, 10);
  EXPECT_TRUE(read(store, kStoreKey, 10)) << "with room again";
}

TEST_F(FeatureStoreTest, AFullDiskLeavesNoPartOfANewFile) {
  const pid_t writer = child([&] {
    ::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{1000, RLIM_INFINITY};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return 1;
    return contains(opening(folder), "make room") ? 0 : 2;
  });
  EXPECT_EQ(status_of(writer), 0);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 0);
}

}  // namespace
}  // namespace citylearn::testing
