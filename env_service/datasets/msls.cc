// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <unordered_map>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"

namespace citylearn {
namespace {

/// Mapillary Street-Level Sequences (Warburg, Hauberg, Lopez-Antequera, Gargallo, Kuang, Civera, CVPR 2020), as its
/// archives unpack into one folder:
///   {train_val,test}/<city>/{database,query}/images/<key>.jpg
///   .../seq_info.csv: key, sequence_key, frame_number
///   .../raw.csv: key, lon, lat, pano; not of the test cities, whose places are not
///   published
/// A traversal is "<city>-database" or "<city>-query": its sequences in the order of seq_info.csv, each by frame
/// number. Panoramas are left out, as the paper's own loader does. Pictures that were not fetched are left out
/// too.
class MapillarySls : public FolderDataset {
 public:
  MapillarySls(const std::string& folder, const Parameters&)
      : FolderDataset("msls", folder, "train_val/ and test/ of cities") {}

  std::vector<std::string> names() override {
    return names_of(folders(), "train_val/<city>/{database,query}/seq_info.csv");
  }
  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  bool drives() const override { return false; }

  std::map<std::string, std::string> folders() const {
    std::map<std::string, std::string> found;
    for (const std::string part : {"train_val", "test", "."})
      for (const std::string& city :
           is_folder(below(folder_, part)) ? folders_in(below(folder_, part)) : std::vector<std::string>())
        for (const std::string kind : {"database", "query"})
          if (const std::string path = below(folder_, (part == "." ? "" : part + "/") + city + "/" + kind);
              is_file(path + "/seq_info.csv"))
            found.emplace(city + "-" + kind, path);
    return found;
  }

  Traversal read(const std::string& name) override {
    const std::string folder = folders().at(name);
    struct Picture {
      int sequence = 0;
      double number = 0;
      std::string path;
      double latitude = std::nan(""), longitude = std::nan("");
      bool panorama = false;
    };
    std::unordered_map<std::string, Picture> pictures;  // by key
    std::unordered_map<std::string, int> sequences;
    const TextTable order(folder + "/seq_info.csv", {});
    for (int row = 0; row < order.rows(); ++row) {
      Picture& picture = pictures[std::string(order.text(row, "key"))];
      if (!picture.path.empty()) order.fail(row, "a second row of this key");
      picture.path = folder + "/images/" + std::string(order.text(row, "key")) + ".jpg";
      picture.sequence =
          sequences.try_emplace(std::string(order.text(row, "sequence_key")), sequences.size()).first->second;
      picture.number = order.number(row, "frame_number");
    }
    if (const std::string path = folder + "/raw.csv"; is_file(path)) {
      const TextTable raw(path, {});
      for (int row = 0; row < raw.rows(); ++row) {
        const auto found = pictures.find(std::string(raw.text(row, "key")));
        if (found == pictures.end()) continue;
        Picture& picture = found->second;
        picture.latitude = raw.number(row, "lat");
        picture.longitude = raw.number(row, "lon");
        if (std::abs(picture.latitude) > 90 || std::abs(picture.longitude) > 180)
          raw.fail(row, "not a latitude and a longitude in degrees");
        picture.panorama = raw.has("pano") && raw.text(row, "pano") == "True";
      }
    }
    std::vector<Picture> kept;
    std::size_t panoramas = 0, missing = 0;
    for (auto& [key, picture] : pictures) {
      const bool there = is_file(picture.path);
      panoramas += picture.panorama;
      missing += !there && !picture.panorama;
      if (there && !picture.panorama) kept.push_back(std::move(picture));
    }
    if (panoramas + missing > 0)
      spdlog::warn("{}: {} panoramas are left out, and {} pictures that are not there", folder, panoramas, missing);
    std::sort(kept.begin(), kept.end(), [](const Picture& a, const Picture& b) {
      return std::tie(a.sequence, a.number, a.path) < std::tie(b.sequence, b.number, b.path);
    });
    std::vector<std::string> paths;
    std::vector<double> latitude, longitude;
    for (Picture& picture : kept) {
      paths.push_back(std::move(picture.path));
      latitude.push_back(picture.latitude);
      longitude.push_back(picture.longitude);
    }
    Traversal traversal = pictured(name, std::move(paths), folder);
    if (is_file(folder + "/raw.csv")) {
      locate(traversal, std::move(latitude), std::move(longitude));
      traversal.places_from = "raw.csv";
    }
    return traversal;
  }
};

const DatasetRegistry::Registration msls_registration({
    "msls",
    "Mapillary Street-Level Sequences: streets of 30 cities in many sequences, by day and night",
    {},
    open_folder<MapillarySls>,
    {},
    {{"paper",
      "Warburg, Hauberg, Lopez-Antequera, Gargallo, Kuang, Civera: Mapillary Street-Level Sequences: A Dataset for "
      "Lifelong Place Recognition, CVPR 2020"},
     {"address", "https://www.mapillary.com/dataset/places"},
     {"licence", "CC BY-NC-SA 4.0"},
     {"size", "1.6 million pictures, 60 GB"}},
});

}  // namespace
}  // namespace citylearn
