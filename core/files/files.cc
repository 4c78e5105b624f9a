// SPDX-License-Identifier: Apache-2.0
#include "core/files/files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/util/error.h"
#include "core/util/machine.h"

namespace citylearn {

void write_file(const std::string& path, std::string_view contents) {
  const std::string temporary =
      path + "." + std::to_string(process_number()) + ".tmp";  // several processes may write it
  int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  const auto fail = [&](const char* doing) {
    const std::string why = std::strerror(errno);
    if (file >= 0) ::close(file);
    ::unlink(temporary.c_str());
    throw Error(std::string(doing) + ": " + why, path, "is there space, and may this user write there?");
  };
  if (file < 0) fail("cannot create it");
  std::size_t written = 0;
  while (written < contents.size()) {
    const ssize_t count = ::write(file, contents.data() + written, contents.size() - written);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail("cannot write it");
    written += static_cast<std::size_t>(count);
  }
  if (::fsync(file) != 0) fail("cannot write it");
  if (::rename(temporary.c_str(), path.c_str()) != 0) fail("cannot put it in place");
  ::close(file);
  sync_folder_of(path);  // the rename itself lasts only from then on
}

void sync_folder_of(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  const int directory = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0) return;
  ::fsync(directory);
  ::close(directory);
}

void create_folder(const std::string& path, const std::string& remedy) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw Error("this folder cannot be created: " + error.message(), path, remedy);
}

void refuse_special_file(const std::string& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (std::filesystem::is_directory(status)) throw Error("is a folder, not a file", path);
  if (std::filesystem::is_other(status)) throw Error("is a FIFO, socket or device, not a file", path);
}

std::string read_file(const std::string& path, std::size_t most) {
  refuse_special_file(path);
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error(std::strerror(errno), path);
  const auto fail_if_larger = [&](std::uintmax_t size) {
    if (size > most) throw Error("is larger than " + std::to_string(most) + " bytes", path);
  };
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (!error) fail_if_larger(size);
  std::string text;
  char block[1 << 16];
  while (file.read(block, sizeof block), file.gcount() > 0) {
    text.append(block, static_cast<std::size_t>(file.gcount()));
    fail_if_larger(text.size());
  }
  if (file.bad()) throw Error("cannot be read", path);
  return text;
}

}  // namespace citylearn
