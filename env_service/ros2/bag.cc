// SPDX-License-Identifier: Apache-2.0
#include "env_service/ros2/bag.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <filesystem>

#include "core/files/files.h"
#include "core/recording/compression.h"
#include "core/recording/mcap.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

const std::vector<std::string> kBagSuffixes = {".mcap", ".db3", ".mcap.zstd", ".db3.zstd"};
constexpr std::size_t kMaxMetadataBytes = std::size_t{16} << 20;

bool is_own_recording(const std::string& path) {
  try {
    return lower(path).ends_with(".mcap") && McapReader(path).profile() == "citylearn";
  } catch (const Error&) {
    return false;  // reading it will say what is wrong
  }
}

}  // namespace

Bag::Bag(const std::string& path)
    : path_(path), parent_((std::filesystem::path(path) / "").parent_path().parent_path()) {
  if (const std::string metadata = below(path, "metadata.yaml"); is_file(metadata))
    read_metadata(metadata);
  else
    paths_ = is_folder(path) ? files_of(path) : std::vector{path};
  if (paths_.empty())
    throw Error("has no file of a bag, .mcap or .db3" + (faults_.empty() ? "" : ": " + faults_.front()), path);
}

std::string Bag::stem(const std::string& file) {
  for (const std::string& suffix : kBagSuffixes)
    if (lower(file).ends_with(suffix)) return file.substr(0, file.size() - suffix.size());
  return "";
}

std::vector<std::string> Bag::files_of(const std::string& folder) {
  std::vector<std::string> paths = files_in(folder, kBagSuffixes);
  for (std::string& path : paths) path.insert(0, folder + "/");
  std::erase_if(paths, [](const std::string& path) {  // what rosbag2 decompressed lies beside what it was
    return is_own_recording(path) || (path.ends_with(".zstd") && is_file(path.substr(0, path.size() - 5)));
  });
  return paths;
}

void Bag::read_metadata(const std::string& path) try {
  const YAML::Node metadata = YAML::Load(read_file(path, kMaxMetadataBytes))["rosbag2_bagfile_information"];
  if (!metadata.IsMap()) throw Error("has no rosbag2_bagfile_information", path);
  const std::string mode = lower(metadata["compression_mode"].as<std::string>("")),
                    format = metadata["compression_format"].as<std::string>("");
  if (!mode.empty() && mode != "none" && format != "zstd")
    throw Error("has compression_format '" + format + "'; zstd is known", path);
  told_ = metadata["message_count"].as<std::uint64_t>(0);
  for (const YAML::Node& file : metadata["relative_file_paths"]) {
    // Up to version 3 they begin with the folder's name; some writers leave .zstd out.
    const auto name = file.as<std::string>();
    const std::string last = name.substr(name.rfind('/') + 1),
                      found = first_file(path_, {name, last, name + ".zstd", last + ".zstd"});
    if (found.empty())
      faults_.push_back(path_below(path_, parent_) + ": " + last + " is missing, which metadata.yaml names");
    else
      paths_.push_back(found);
  }
} catch (const YAML::Exception& error) {
  const std::string line = error.mark.is_null() ? "" : ", line " + std::to_string(error.mark.line + 1);
  throw Error("cannot be read: " + error.msg, path + line, "mend or remove it");
}

void Bag::read_all(const std::function<bool(const BagTopic&)>& wanted,
                   const std::function<void(const BagMessage&)>& use) {
  std::vector<bool> is_wanted;
  std::uint64_t all = 0;
  BagPlace place;
  const auto topic = [&](BagTopic one) {
    if (const auto slash = one.type.find('/'); one.encoding == "cdr" && slash == one.type.rfind('/') && slash + 1)
      one.type.insert(slash, "/msg");  // some writers leave it out
    const auto found = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& known) {
      return known.name == one.name && known.type == one.type && known.encoding == one.encoding;
    });
    if (found != topics_.end()) return static_cast<std::size_t>(found - topics_.begin());
    topics_.push_back(one);
    is_wanted.push_back(wanted(one));
    return topics_.size() - 1;
  };
  const auto count = [&](std::size_t number) {
    ++all;
    ++topics_[number].messages;
    return static_cast<bool>(is_wanted[number]);
  };
  const auto used = [&](BagMessage message) {
    message.place.file = place.file;
    message.data = decompressed(message.data);
    use(message);
  };
  files_.resize(paths_.size());
  for (; place.file < paths_.size(); ++place.file) try {
      files_[place.file] = open_bag_file(paths_[place.file]);
      files_[place.file]->read_all({topic, count, used});
    } catch (const Error& error) {
      faults_.push_back(path_below(error.what(), parent_));
      if (topics_.empty() && place.file + 1 == paths_.size()) throw;
    }
  if (topics_.empty()) throw Error("holds no message", path_);
  if (faults_.empty() && all < told_)
    faults_.push_back(path_below(path_, parent_) + ": " + std::to_string(all) +
                      " messages are there, metadata.yaml counts " + std::to_string(told_));
}

std::span<const std::byte> Bag::read(const BagPlace& place) { return decompressed(files_.at(place.file)->read(place)); }

/// A message that was compressed alone begins with zstd's magic number, which no CDR does.
std::span<const std::byte> Bag::decompressed(std::span<const std::byte> data) {
  const std::string_view bytes(reinterpret_cast<const char*>(data.data()), data.size());
  if (!bytes.starts_with("\x28\xb5\x2f\xfd")) return data;
  if (!decompress("zstd", bytes, kMaxMessageBytes, buffer_).empty()) return {};
  return std::as_bytes(std::span(buffer_));
}

}  // namespace citylearn
