// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string_view>

#include "core/wire/service.h"
#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {

extern const std::string_view kPythonProgram;  // python/citylearn/encoder.py, which CMake puts into a source

namespace {

constexpr int kSocket = 3, kProgram = 4;  // descriptors of the child process
constexpr int kPollInterval = 50;         // ms
constexpr int kStartFactor = 10;          // a start may take so many times the time of a batch
constexpr std::chrono::milliseconds kEndInterval{1000};
constexpr double kSlow = 1;  // seconds a picture
constexpr int kMaxText = 4096;

/// What FILE.py says of its function.
struct Greeting {
  std::int32_t dimension = 0, width = 0, height = 0, batch = 0;  // width 0: pictures come as they are
  float seconds = 0;                                             // of a picture in the trial
  char name[108] = {};                                           // version and hash
};

/// An interpreter that runs FILE.py, as a child process. Killed when this object is destroyed; it ends by itself when
/// this process does. Used by one thread.
class Interpreter {
 public:
  /// Throws Error when it cannot be started.
  Interpreter(std::string file, std::chrono::seconds limit);
  ~Interpreter();
  Interpreter(const Interpreter&) = delete;
  Interpreter& operator=(const Interpreter&) = delete;

  /// Waits until the function has passed its trial. Throws Error with what is wrong.
  const Greeting& greet();
  /// Encodes pictures of one size, height x width x 3 bytes each, to D numbers each. Returns false when the process is
  /// dead. Throws Error when the function fails or takes too long.
  bool encode(std::array<std::int32_t, 3> count_height_width, Bytes& pictures, std::span<float> descriptors);
  /// Returns how the dead process ended.
  std::string end();

 private:
  bool exited();
  bool transfer(bool sends, void* data, std::size_t size);
  bool receive(void* data, std::size_t size);

  const std::string file_;
  std::string program_ = "python3";
  const std::chrono::seconds limit_;
  int socket_ = -1;
  pid_t id_ = -1;
  std::optional<int> status_;
  Clock::time_point deadline_;
  bool stopping_ = false;  // this program is to stop, and the deadline is close
  Greeting greeting_;
};

Interpreter::Interpreter(std::string file, std::chrono::seconds limit) : file_(std::move(file)), limit_(limit) {
  if (const char* named = std::getenv("CITYLEARN_PYTHON"); named && *named) program_ = named;
  int ends[2];
  const int source = ::memfd_create("citylearn_encoder", MFD_CLOEXEC);
  if (source < 0 || ::write(source, kPythonProgram.data(), kPythonProgram.size()) != std::ssize(kPythonProgram) ||
      ::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
    throw Error(std::strerror(errno), file_);
  socket_ = ends[0];
  // Above those that they become: dup2 to itself would leave it to be closed.
  const int other = ::fcntl(ends[1], F_DUPFD_CLOEXEC, kProgram + 1);
  const int code = ::fcntl(source, F_DUPFD_CLOEXEC, kProgram + 1);
  std::string words[] = {program_, "-u", "/proc/self/fd/" + std::to_string(kProgram), file_};
  char* arguments[] = {words[0].data(), words[1].data(), words[2].data(), words[3].data(), nullptr};
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);  // what it prints goes to the log
  posix_spawn_file_actions_adddup2(&actions, other, kSocket);
  posix_spawn_file_actions_adddup2(&actions, code, kProgram);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setpgroup(&attributes, 0);  // Ctrl-C is for this process, which ends that one
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  const int failed = posix_spawnp(&id_, arguments[0], &actions, &attributes, arguments, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  for (const int one : {other, code, source, ends[1]}) ::close(one);
  count_memory_of(id_);
  if (!failed) return;
  ::close(socket_);
  throw Error("cannot start '" + program_ + "': " + std::strerror(failed), file_,
              "CITYLEARN_PYTHON names the interpreter, as venv/bin/python3");
}

Interpreter::~Interpreter() {
  ::close(socket_);
  if (exited()) return;
  ::kill(-id_, SIGKILL);  // and what it started
  while (::waitpid(id_, nullptr, 0) < 0 && errno == EINTR) continue;
}

const Greeting& Interpreter::greet() {
  deadline_ = Clock::now() + kStartFactor * limit_;
  if (!receive(&greeting_, sizeof greeting_)) throw Error(end(), file_);
  greeting_.name[sizeof greeting_.name - 1] = '\0';
  return greeting_;
}

bool Interpreter::encode(std::array<std::int32_t, 3> count_height_width, Bytes& pictures,
                         std::span<float> descriptors) {
  deadline_ = Clock::now() + limit_;
  stopping_ = false;
  return transfer(true, count_height_width.data(), sizeof count_height_width) &&
         transfer(true, pictures.data(), pictures.size()) && receive(descriptors.data(), descriptors.size_bytes());
}

std::string Interpreter::end() {
  for (const auto until = Clock::now() + kEndInterval; !exited() && Clock::now() < until;)
    ::poll(nullptr, 0, kPollInterval);
  if (!status_) return program_ + " has closed its socket";
  if (WIFSIGNALED(*status_)) return program_ + " was ended by signal: " + strsignal(WTERMSIG(*status_));
  return program_ + " ended with status " + std::to_string(WEXITSTATUS(*status_));
}

bool Interpreter::exited() {
  int status = 0;
  if (!status_ && ::waitpid(id_, &status, WNOHANG) == id_) status_ = status;
  return status_.has_value();
}

/// Sends or receives all bytes. Returns false when the process is dead. Throws Error at the deadline.
bool Interpreter::transfer(bool sends, void* data, std::size_t size) {
  for (char* at = static_cast<char*>(data); size > 0;) {
    pollfd waiting{socket_, static_cast<short>(sends ? POLLOUT : POLLIN), 0};
    if (::poll(&waiting, 1, kPollInterval) <= 0) {
      if (stop_requested() && !std::exchange(stopping_, true))
        deadline_ = std::min(deadline_, Clock::now() + kEndInterval);
      if (Clock::now() >= deadline_)
        throw Error(stopping_ ? "was stopped"
                    : greeting_.batch == 0
                        ? "has not begun within " + std::to_string(kStartFactor * limit_.count()) + " s"
                        : "has not encoded a batch within " + std::to_string(limit_.count()) + " s",
                    file_, stopping_ ? "" : "--python-seconds allows more");
      if (exited()) return false;
      continue;
    }
    const ssize_t done =
        sends ? ::send(socket_, at, size, MSG_DONTWAIT | MSG_NOSIGNAL) : ::recv(socket_, at, size, MSG_DONTWAIT);
    if (done < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (done <= 0) return false;
    at += done;
    size -= static_cast<std::size_t>(done);
  }
  return true;
}

/// Receives an answer, or throws the Error that comes instead, whose length goes before it.
bool Interpreter::receive(void* data, std::size_t size) {
  std::int32_t length;
  if (!transfer(false, &length, sizeof length)) return false;
  if (length == 0) return transfer(false, data, size);
  std::string text(static_cast<std::size_t>(std::clamp(length, 0, kMaxText)), ' ');
  if (!transfer(false, text.data(), text.size())) return false;
  throw Error(text);
}

/// A function in a Python file (docs/how-to/use-a-python-encoder.md).
class Python : public Encoder {
 public:
  Python(const Parameters& parameters, const EncoderFiles& files)
      : file_(files.model), limit_(parameters.integer("seconds")) {
    std::error_code unknown;
    if (file_.empty()) throw Error("needs a Python file", "", "give it as --encoder FILE.py");
    if (!std::filesystem::is_regular_file(file_, unknown)) throw Error("there is no such file", file_);
    greeting_ = start();
    if (greeting_.seconds > kSlow)
      spdlog::warn("{}: takes {:.1f} s a picture, which is slow", file_, greeting_.seconds);
  }

  Spec spec() const override {
    return {std::string("python-1 ") + greeting_.name, greeting_.dimension, greeting_.batch};
  }

  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    for (const cv::Mat& picture : pictures) check_picture(picture);
    Eigen::MatrixXf descriptors(greeting_.dimension, pictures.size());
    const auto most = static_cast<std::size_t>(greeting_.batch);
    for (std::size_t first = 0, count = 0; first < pictures.size(); first += count, count = 0) {
      while (first + count < pictures.size() && count < most &&
             size_of(pictures[first + count]) == size_of(pictures[first]))
        ++count;
      const auto part = descriptors.middleCols(static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(count));
      encode_batch(pictures.subspan(first, count),
                   {const_cast<float*>(part.data()), static_cast<std::size_t>(part.size())});
    }
    return descriptors;
  }

 private:
  Greeting start() {
    spdlog::info("starting {} ...", file_);
    interpreter_ = std::make_unique<Interpreter>(file_, limit_);
    return interpreter_->greet();
  }

  cv::Size size_of(const cv::Mat& picture) const {
    return greeting_.width > 0 ? cv::Size(greeting_.width, greeting_.height) : picture.size();
  }

  void encode_batch(std::span<const cv::Mat> pictures, std::span<float> descriptors) {
    const cv::Size size = size_of(pictures[0]);
    const int count = static_cast<int>(pictures.size());
    sent_.resize(std::size_t{3} * size.area() * pictures.size());
    for_each_on_threads(count, [&](int i) {
      cv::Mat rgb(size, CV_8UC3, &sent_[std::size_t{3} * size.area() * i]);
      cv::cvtColor(scaled(pictures[static_cast<std::size_t>(i)], size.width, size.height), rgb, cv::COLOR_BGR2RGB);
    });
    const auto encoded = [&] { return interpreter_->encode({count, size.height, size.width}, sent_, descriptors); };
    if (encoded()) return;
    spdlog::warn("{}: {} while it encoded; it is started again", file_, interpreter_->end());
    if (std::strcmp(start().name, greeting_.name) != 0) throw Error("has changed since this program began", file_);
    if (!encoded()) throw Error(interpreter_->end() + " twice while it encoded the same pictures", file_);
  }

  const std::string file_;
  const std::chrono::seconds limit_;
  std::unique_ptr<Interpreter> interpreter_;
  Greeting greeting_;
  Bytes sent_;
};

const EncoderRegistry::Registration python_registration({
    "python",
    "a function in Python (--encoder FILE.py), as a network of PyTorch (docs/how-to/use-a-python-encoder.md)",
    {{"seconds", "s that the function may take for a batch, and ten times as many to start", 60, 1, 86400, true}},
    [](const Parameters& values, const EncoderFiles& files) { return std::make_unique<Python>(values, files); },
});

}  // namespace
}  // namespace citylearn
