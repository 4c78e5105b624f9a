// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"

namespace citylearn {
namespace {

/// Alderley Day/Night (Milford & Wyeth, ICRA 2012): one route driven on a sunny day and in a rainy night.
///   FRAMESA/Image00001.jpg ...: the night; FRAMESB/Image00001.jpg ...: the day; numbers begin at 1
///   framematches.csv: rows "number in FRAMESA, number in FRAMESB" of the same place, marked by hand; no header
/// The archives hold a folder of their own name, so FRAMESA/FRAMESA is found too. There is no GPS: positions are
/// unknown. Unsure: whether every frame of the night has a row (a frame without one is matched to nothing here).
class Alderley : public FolderDataset {
 public:
  Alderley(const std::string& folder, const Parameters&)
      : FolderDataset("alderley", folder, "FRAMESA, FRAMESB and framematches.csv") {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    if (!pictures("day").empty()) found.push_back("day");
    if (!pictures("night").empty()) found.push_back("night");
    if (found.empty()) not_recognised("FRAMESA or FRAMESB in it");
    return found;
  }

  Correspondence correspondence() const override { return Correspondence::kMatches; }

  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    require_known(a);
    require_known(b);
    std::vector<std::pair<int, int>> pairs;
    if (a == b) {
      for (const auto& [number, frame] : frames(a)) pairs.emplace_back(frame, frame);
      return pairs;
    }
    const std::map<long, int> nights = frames("night"), days = frames("day");
    const std::string path = below(folder_, "framematches.csv");
    const TextTable table(path, {',', false});
    for (int row = 0; row < table.rows(); ++row) {
      if (table.columns(row) < 2) table.fail(row, "not two frame numbers");
      const std::string_view first = table.text(row, 0);
      if (row == 0 && !first.empty() && (first.front() < '0' || first.front() > '9')) continue;  // a header after all
      const auto night = nights.find(whole(table, row, 0)), day = days.find(whole(table, row, 1));
      if (night == nights.end() || day == days.end()) continue;  // a thinned folder lacks frames of many rows
      pairs.emplace_back(night->second, day->second);
      if (!of_night(a)) std::swap(pairs.back().first, pairs.back().second);
    }
    if (pairs.empty()) throw Error("matches none of the frames in FRAMESA and FRAMESB", path);
    return pairs;
  }

 private:
  Traversal read(const std::string& name) override { return recorded(name, pictures(name)); }

  static bool of_night(const std::string& name) { return name == "night"; }

  static long whole(const TextTable& table, int row, int column) {
    const double number = table.number(row, column);
    if (number < 0 || number > 1e6 || number != static_cast<double>(static_cast<long>(number)))
      table.fail(row, "not a frame number");
    return static_cast<long>(number);
  }

  std::string pictures(const std::string& name) const {
    const std::string folder = of_night(name) ? "FRAMESA" : "FRAMESB";
    return first_folder(folder_, {folder + "/" + folder, folder});
  }

  std::map<long, int> frames(const std::string& name) const {
    std::map<long, int> frames;
    for (const NumberedFile& file : numbered_files(pictures(name), image_suffixes()))
      frames.emplace(file.number, static_cast<int>(frames.size()));
    return frames;
  }
};

const DatasetRegistry::Registration alderley_registration({
    "alderley",
    "Alderley Day/Night: 8 km of Brisbane suburbs on a sunny day and in a rainy night",
    {},
    open_folder<Alderley>,
    {},
    {{"paper",
      "Milford, Wyeth: SeqSLAM: Visual Route-Based Navigation for Sunny Summer Days and Stormy Winter Nights, "
      "ICRA 2012"},
     {"address", "https://wiki.qut.edu.au/pages/viewpage.action?pageId=181178395"},
     {"licence", "none stated; the page asks to cite the paper"},
     {"size", "14,607 day and 16,960 night pictures of 640 x 260"}},
});

}  // namespace
}  // namespace citylearn
