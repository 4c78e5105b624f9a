// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"

namespace citylearn {
namespace {

bool is_the_drive(const std::string& name) {
  const std::string small = lower(name);
  return small.find("gold") != std::string::npos && small.find("coast") != std::string::npos;
}

/// Gold Coast drive (Milford et al., CVPR workshops 2015): 87 km from Brisbane to the Gold Coast, one GoPro video of
/// 1080p at 30 Hz, also published in low resolution and as a short sample. There is no ground truth ("vision-only"):
/// positions are unknown. Each video of the folder whose name holds "gold" and "coast" (gold_coast_compressed.mp4) is a
/// traversal, and each folder of numbered frames so named. Unsure: the names of the other two videos.
class GoldCoastDrive : public FolderDataset {
 public:
  GoldCoastDrive(const std::string& folder, const Parameters&)
      : FolderDataset("gold_coast_drive", folder, "videos named like gold_coast_compressed.mp4") {}

  std::vector<std::string> names() override {
    std::vector<std::string> found;
    for (const auto& [name, path] : recordings()) found.push_back(name);
    if (found.empty()) not_recognised("video or folder of pictures named like gold_coast_compressed.mp4 in it");
    return found;
  }

  std::string condition(const std::string&) override { return "day"; }
  bool distinctive() override { return false; }

 private:
  Traversal read(const std::string& name) override { return recorded(name, recordings().at(name)); }

  std::map<std::string, std::string> recordings() const {
    std::map<std::string, std::string> found;
    if (!is_folder(folder_)) return found;
    for (const std::string& name : folders_in(folder_))
      if (is_the_drive(name)) found[name] = below(folder_, name);
    for (const std::string& file : files_in(folder_, video_suffixes()))
      if (is_the_drive(file)) found[stem_of(file)] = below(folder_, file);
    return found;
  }
};

const DatasetRegistry::Registration gold_coast_drive_registration({
    "gold_coast_drive",
    "Gold Coast drive: one 87 km drive from Brisbane to the Gold Coast, by motorway and streets",
    {},
    open_folder<GoldCoastDrive>,
    {},
    {{"paper",
      "Milford et al.: Sequence Searching With Deep-Learnt Depth for Condition- and Viewpoint-Invariant "
      "Route-Based Place Recognition, CVPR workshops 2015"},
     {"address", "https://qcr.github.io"},
     {"licence", "none stated; the page asks to cite the paper"},
     {"size", "15.2 GB; in low resolution 257 MB; a sample 315 MB"}},
});

}  // namespace
}  // namespace citylearn
