// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "env_service/dataset_io/dataset.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/files/files.h"
#include "tests/fuzz/targets.h"
#include "tests/support/processes/service.h"

namespace citylearn::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFiles = 24;
constexpr int kPictures = 8;

/// Names that stay inside the folder.
bool usable(std::string_view name) {
  if (name.empty() || name.size() > 100 || std::count(name.begin(), name.end(), '/') > 5) return false;
  for (const char c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && std::string_view("._-/ ").find(c) == std::string_view::npos)
      return false;
  for (const fs::path& part : fs::path(name))
    if (part.empty() || part == "." || part == ".." || part == "/") return false;
  return true;
}

/// Videos are there, but empty: the inside of their decoders is left to the people who make them.
void write(const fs::path& path, std::string_view contents) {
  std::error_code ignored;
  std::string suffix = path.extension();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) { return std::tolower(c); });
  const std::vector<std::string>& videos = video_suffixes();
  if (std::find(videos.begin(), videos.end(), suffix) != videos.end()) contents = {};
  fs::create_directories(path.parent_path(), ignored);
  std::ofstream(path, std::ios::binary) << contents;
}

void check(const Traversal& traversal) {
  const auto frames = static_cast<std::size_t>(traversal.frames);
  require(traversal.frames >= 2, "a route has two frames");
  require(traversal.positions.size() == frames, "positions are filled");
  require((traversal.dimension > 0) != (traversal.images != nullptr), "either features or images");
  require(traversal.features.size() == frames * static_cast<std::size_t>(traversal.dimension), "features");
  for (const float x : traversal.features) require(std::isfinite(x), "finite features");
  for (const float x : traversal.positions) require(!std::isinf(x), "positions are numbers or NaN");
  for (const auto* list : {&traversal.latitude, &traversal.longitude, &traversal.times}) {
    require(list->empty() || list->size() == frames, "a value a frame");
    for (const double x : *list) require(!std::isinf(x), "values are numbers or NaN");
  }
  traversal.hash();
  if (!traversal.images) return;
  require(traversal.images->frames() == traversal.frames, "a picture a frame");
  Bytes bytes;
  for (int frame = 0; frame < std::min(traversal.frames, kPictures); ++frame) {
    traversal.images->name(frame);
    traversal.images->fault(frame);
    accepted([&] { traversal.images->read(frame, bytes); });
  }
}

/// A selection of one kind or another: all of them at once would be slow.
Selection selection_of(const std::string& sibling, std::size_t turn) {
  Selection selection;
  const char* const ways[] = {"dataset", "index", "matches", "distance", "gps"};
  switch (turn % 8) {
    case 0:
      selection.first = static_cast<int>(turn / 8 % 4);
      selection.end = static_cast<int>(turn / 8 % 7);
      selection.step = 1 + static_cast<int>(turn / 8 % 3);
      break;
    case 1:
      selection.from = static_cast<double>(turn / 8 % 5) - 2;
      selection.to = 1000;
      selection.step_metres = 0.05 + static_cast<double>(turn / 8 % 11);
      break;
    case 2:
      break;
    default:
      selection.align = sibling;
      selection.by = ways[turn % 8 - 3];
      selection.skip_bad_frames = turn / 8 % 2 == 0;
  }
  return selection;
}

}  // namespace

bool dataset_folder(Input input) {
  std::string_view text(reinterpret_cast<const char*>(input.data()), input.size());
  const auto line = [&text] {
    const std::string_view first = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), first.size() + 1));
    return std::string(first);
  };
  const std::string name = line();
  const std::vector<const DatasetRegistry::Entry*> entries = DatasetRegistry::instance().entries();
  const auto entry = std::find_if(entries.begin(), entries.end(), [&](auto* known) { return known->name == name; });
  if (entry == entries.end() || name == "synthetic") return false;

  static const testing::Folder root;
  const fs::path folder = root / "data";
  fs::remove_all(folder);
  fs::create_directory(folder);
  for (std::size_t files = 0; !text.empty() && files < kFiles; ++files) {
    const std::string head = line();
    const std::string_view contents = text.substr(0, text.starts_with("=== ") ? 0 : text.find("\n=== "));
    text.remove_prefix(std::min(text.size(), contents.empty() ? 0 : contents.size() + 1));
    if (head.starts_with("=== ") && usable(head.substr(4))) write(folder / head.substr(4), contents);
  }

  bool all = true;
  const bool opened = accepted([&] {
    const Parameters parameters("dataset " + name, (*entry)->parameters, {});
    const std::unique_ptr<Dataset> dataset = (*entry)->create(parameters, folder.string());
    std::vector<std::string> names = dataset->names();
    names.resize(std::min<std::size_t>(names.size(), 3));
    for (const std::string& one : names) {
      accepted([&] { dataset->condition(one); });
      all &= accepted([&] { check(dataset->load(one)); });
      for (const std::string& other : names) accepted([&] { dataset->matches(one, other); });
      accepted([&] { check(select(*dataset, one, selection_of(names.back(), input.size()))); });
    }
  });
  return opened && all;
}

}  // namespace citylearn::fuzz
