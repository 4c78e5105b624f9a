// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/json_file.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"

namespace citylearn {
namespace {

constexpr char kImage[] = "_leftImg8bit.png";
constexpr double kRate = 17;  // frames a second (Cordts et al., section 2.1)
constexpr double kGap = 0.5;  // seconds without a frame after which GPS gives the way, not the speed

/// Cityscapes (Cordts et al., CVPR 2016): drives through 50 cities, of which the sequences are read:
///   leftImg8bit_sequence/<split>/<city>/<city>_<sequence>_<frame>_leftImg8bit.png (two numbers of 6 digits)
///   vehicle_sequence/<split>/<city>/..._vehicle.json: "gpsLatitude", "gpsLongitude" (degrees), "speed" (m/s),
///   "yawRate" timestamp_sequence/<split>/<city>/..._timestamp.txt: nanoseconds
/// also below a folder named like the archive, and likewise leftImg8bit_allFrames, and leftImg8bit/ with vehicle/
/// (demoVideo; of the single frames of the other splits only the long drives are routes, coarse ones). A traversal is a
/// city's sequence, "aachen_000000": in most cities a snippet of 30 frames (1.8 s), in some (hamburg, hanover,
/// frankfurt ...) a long drive of many snippets with gaps between. Positions: speed times time, which is smooth where
/// GPS jumps; over gaps, GPS. Without vehicle data they are unknown, without timestamps frames are 1/17 s apart.
/// Unsure: the layout of the allFrames archives (taken to be that of the sequences).
class Cityscapes : public FolderDataset {
 public:
  Cityscapes(const std::string& folder, const Parameters&)
      : FolderDataset("cityscapes", folder, "leftImg8bit_sequence") {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    for (const auto& [name, recording] : recordings())
      if (recording.files.size() > 1) found.push_back(name);
    if (found.empty())
      not_recognised("leftImg8bit_sequence/<split>/<city>/<city>_<sequence>_<frame>_leftImg8bit.png in it");
    return found;
  }

  /// Returns "day": the dataset has daylight and good weather by design.
  std::string condition(const std::string&) override { return "day"; }
  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  Traversal read(const std::string& name) override {
    const Recording& recording = recordings().at(name);
    std::vector<std::string> paths;
    for (const std::string& file : recording.files) paths.push_back(below(recording.images, file + kImage));
    Traversal traversal = pictured(name, std::move(paths), recording.images);
    read_times(recording, traversal);
    if (!recording.vehicle.empty()) read_vehicle(recording, traversal);
    return traversal;
  }

  struct Recording {
    std::string images, vehicle, timestamps;  // folders; the latter two empty when they were not fetched
    std::vector<std::string> files;           // "aachen_000000_000019"
  };

  const std::map<std::string, Recording>& recordings() {
    if (!recordings_.empty() || !is_folder(folder_)) return recordings_;
    for (const std::string kind : {"_sequence", "_allFrames", ""}) {
      const auto root = [&](const std::string& what) {
        return first_folder(
            folder_, {what + kind, what + kind + "_trainvaltest/" + what + kind, what + kind + "/" + what + kind});
      };
      const std::string images = root("leftImg8bit");
      if (images.empty()) continue;
      for (const std::string& split : folders_in(images)) {
        add_files(below(images, split), split, root("vehicle"), root("timestamp"));
        for (const std::string& city : folders_in(below(images, split)))
          add_files(below(images, split + "/" + city), split + "/" + city, root("vehicle"), root("timestamp"));
      }
    }
    return recordings_;
  }

  void add_files(const std::string& images, const std::string& sub, const std::string& vehicle,
                 const std::string& timestamps) {
    const auto beside = [&](const std::string& root) {
      return root.empty() || !is_folder(below(root, sub)) ? std::string() : below(root, sub);
    };
    for (const std::string& file : files_in(images, {kImage})) {
      const std::string frame = file.substr(0, file.size() - (sizeof kImage - 1));
      if (frame.size() < 15 || !has_form(frame.substr(frame.size() - 14), "_000000_000000")) continue;
      Recording& recording = recordings_[frame.substr(0, frame.size() - 7)];
      if (recording.images.empty()) recording = {images, beside(vehicle), beside(timestamps), {}};
      if (recording.images == images) recording.files.push_back(frame);
    }
  }

  static void read_times(const Recording& recording, Traversal& traversal) {
    const double first = static_cast<double>(last_number(recording.files.front()));
    for (const std::string& file : recording.files) {
      if (recording.timestamps.empty()) {
        traversal.times.push_back((static_cast<double>(last_number(file)) - first) / kRate);
        continue;
      }
      const std::string path = below(recording.timestamps, file + "_timestamp.txt");
      const TextTable table(path, {' ', false});
      if (table.rows() != 1) throw Error("is not one number of nanoseconds", path);
      const double seconds = table.number(0, 0) * 1e-9;
      if (!traversal.times.empty() && seconds <= traversal.times.back())
        throw Error("has a time that is not later than that of the frame before", path);
      traversal.times.push_back(seconds);
    }
  }

  static void read_vehicle(const Recording& recording, Traversal& traversal) {
    std::vector<double> speed;
    double metres = 0;
    for (std::size_t i = 0; i < recording.files.size(); ++i) {
      const std::string path = below(recording.vehicle, recording.files[i] + "_vehicle.json");
      const nlohmann::json vehicle = read_json(path);
      traversal.latitude.push_back(json_number(vehicle, "gpsLatitude", path));
      traversal.longitude.push_back(json_number(vehicle, "gpsLongitude", path));
      speed.push_back(json_number(vehicle, "speed", path));
      if (i > 0) {
        const double pause = traversal.times[i] - traversal.times[i - 1];
        metres += pause <= kGap ? pause * std::abs(speed[i] + speed[i - 1]) / 2
                                : metres_between(traversal.latitude[i - 1], traversal.longitude[i - 1],
                                                 traversal.latitude[i], traversal.longitude[i]);
      }
      traversal.positions[i] = static_cast<float>(metres);
    }
  }

  std::map<std::string, Recording> recordings_;
};

const DatasetRegistry::Registration cityscapes_registration({
    "cityscapes",
    "Cityscapes: snippets and some longer drives through 50 cities, with GPS and speed",
    {},
    open_folder<Cityscapes>,
    {},
    {{"paper", "Cordts et al.: The Cityscapes Dataset for Semantic Urban Scene Understanding, CVPR 2016"},
     {"address", "https://www.cityscapes-dataset.com"},
     {"licence", "Cityscapes licence: non-commercial research and teaching, no redistribution"},
     {"size", "leftImg8bit_sequence 324 GB"}},
});

}  // namespace
}  // namespace citylearn
