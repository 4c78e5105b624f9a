// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/page.h"

#include <filesystem>
#include <regex>

#include "core/files/files.h"
#include "core/util/error.h"
#include "core/util/sha256.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxBytes = 64u << 20;

std::string type_of(const fs::path& path) {
  static const std::map<std::string, std::string> types = {{".html", "text/html; charset=utf-8"},
                                                           {".js", "text/javascript; charset=utf-8"},
                                                           {".css", "text/css; charset=utf-8"},
                                                           {".json", "application/json"},
                                                           {".map", "application/json"},
                                                           {".webmanifest", "application/manifest+json"},
                                                           {".txt", "text/plain; charset=utf-8"},
                                                           {".svg", "image/svg+xml"},
                                                           {".png", "image/png"},
                                                           {".jpg", "image/jpeg"},
                                                           {".ico", "image/x-icon"},
                                                           {".woff2", "font/woff2"}};
  const auto found = types.find(path.extension());
  return found == types.end() ? "application/octet-stream" : found->second;
}

}  // namespace

Page::Page(const std::string& folder) {
  std::error_code none;
  if (!fs::is_directory(folder, none)) return;
  const std::regex hashed(R"(/assets/.*-[A-Za-z0-9_-]{8}\.[a-z0-9]+)");  // as Vite names them
  std::map<std::string, std::string> compressed;
  std::size_t bytes = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_symlink() || !entry.is_regular_file()) continue;
    const std::string name = "/" + fs::relative(entry.path(), folder).generic_string();
    bytes += entry.file_size();
    if (bytes > kMaxBytes) throw Error("more than 64 MiB of files", folder, "is this the folder of the built page?");
    std::string body = read_file(entry.path());
    if (entry.path().extension() == ".gz") {
      compressed[name.substr(0, name.size() - 3)] = std::move(body);
      continue;
    }
    const std::string tag = "\"" + sha256(body).substr(0, 16) + "\"";
    files_[name] = {type_of(entry.path()), std::move(body), "", tag, std::regex_match(name, hashed)};
  }
  for (auto& [name, body] : compressed)
    if (const auto file = files_.find(name); file != files_.end()) file->second.compressed = std::move(body);
}

const Page::File* Page::find(const std::string& path) const {
  const auto found = files_.find(path == "/" ? "/index.html" : path);
  return found == files_.end() ? nullptr : &found->second;
}

}  // namespace citylearn
