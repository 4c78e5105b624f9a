// SPDX-License-Identifier: Apache-2.0
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/files/times.h"
#include "env_service/geometry/geometry.h"

namespace citylearn {
namespace {

/// Pictures whose names say where they were taken, as "VPR datasets downloader" (Berton et al., Deep Visual
/// Geo-localization Benchmark, CVPR 2022) lays out Pitts30k, Tokyo 24/7, San Francisco XL, St Lucia and others:
///   images/{train,val,test}/{database,queries}/@easting@northing@zone@band@latitude@longitude@picture@tile@heading@
///   pitch@roll@height@timestamp@note@.jpg
/// All fields but the first two may be empty. A folder of pictures is a traversal, "test-database"; --data may also
/// name a folder below. Pictures are in the order of their timestamps; without these, in that of their names, which is
/// no drive. Where latitude or longitude is missing they follow from zone and band; without a zone, x and y are
/// eastings and northings.
class UtmNames : public FolderDataset {
 public:
  UtmNames(const std::string& folder, const Parameters&)
      : FolderDataset("utm_names", folder, "images/test/{database,queries} of @easting@northing@... pictures") {}

  std::vector<std::string> names() override {
    return names_of(folders(), "database/ or queries/ of pictures named @easting@northing@...");
  }
  Correspondence correspondence() const override { return Correspondence::kGps; }

 private:
  bool drives() const override { return false; }

  std::map<std::string, std::string> folders() const {
    std::map<std::string, std::string> found;
    for (const std::string above : {"images/", ""})
      for (const std::string part : {"train-", "val-", "test-", ""})
        for (const std::string kind : {"database", "queries"}) {
          const std::string path =
              below(folder_, above + (part.empty() ? "" : part.substr(0, part.size() - 1) + "/") + kind);
          if (!is_folder(path)) continue;
          const std::vector<std::string> files = files_in(path, image_suffixes());
          if (!files.empty() && fields_of(files[0]).size() > 3) found.emplace(part + kind, path);
        }
    return found;
  }

  /// Returns what stands between the signs: easting, northing, zone ...; empty when the name is not of this form.
  /// They are parts of `file`, which must outlive them.
  static std::vector<std::string_view> fields_of(std::string_view file) {
    if (!file.starts_with('@')) return {};
    std::vector<std::string_view> fields = split(file.substr(1), '@');
    for (std::string_view& field : fields)
      if (field.starts_with('+')) field.remove_prefix(1);  // of a number
    return fields;
  }

  /// Returns the digits of a name's timestamp, yyyymmddhhmmss; empty when it has none.
  static std::string timestamp(const std::string& file) {
    const std::vector<std::string_view> fields = fields_of(file);
    std::string time(fields.size() > 12 ? fields[12] : "");
    std::erase_if(time, [](char c) { return c < '0' || c > '9'; });
    return time;
  }

  Traversal read(const std::string& name) override {
    const std::string folder = folders().at(name);
    std::vector<std::string> paths = files_in(folder, image_suffixes());
    const auto untimed =
        std::count_if(paths.begin(), paths.end(), [](const std::string& file) { return timestamp(file).empty(); });
    if (untimed == 0)
      std::stable_sort(paths.begin(), paths.end(), [](auto& a, auto& b) { return timestamp(a) < timestamp(b); });
    else
      spdlog::warn("{}: {} of {} names have no timestamp, so that nothing tells the order of the drive", folder,
                   untimed, paths.size());
    std::vector<double> latitude, longitude, x, y;
    for (std::string& path : paths) {
      const std::string file = path;
      const std::vector<std::string_view> fields = fields_of(file);
      path = below(folder, file);
      x.push_back(field_number(fields, 0));
      y.push_back(field_number(fields, 1));
      if (std::isnan(x.back()) || std::isnan(y.back()))
        throw Error("its name does not begin with @easting@northing@ in metres", path, "move it away");
      LatLon place{field_number(fields, 4), field_number(fields, 5)};
      const double zone = field_number(fields, 2);
      if ((std::isnan(place.latitude) || std::isnan(place.longitude)) && zone >= 1 && zone <= 60)
        place = from_utm(x.back(), y.back(), static_cast<int>(zone),
                         fields.size() < 4 || fields[3].empty() || (fields[3][0] | 32) >= 'n');
      if (std::abs(place.latitude) > 90 || std::abs(place.longitude) > 180)
        throw Error("its name has no latitude and longitude in degrees", path, "move it away");
      latitude.push_back(place.latitude);
      longitude.push_back(place.longitude);
    }
    Traversal traversal = pictured(name, std::move(paths), folder);
    if (std::any_of(latitude.begin(), latitude.end(), [](double degrees) { return std::isfinite(degrees); })) {
      locate(traversal, std::move(latitude), std::move(longitude));
    } else {
      traversal.positions = metres_along_plane(x, y);
      traversal.x = std::move(x);
      traversal.y = std::move(y);
    }
    traversal.places_from = "names";
    return traversal;
  }
};

const DatasetRegistry::Registration utm_names_registration({
    "utm_names",
    "pictures named @easting@northing@... in images/{train,val,test}/{database,queries}, as place recognition lays out "
    "Pitts30k, Tokyo 24/7 and others",
    {},
    open_folder<UtmNames>,
    {},
    {{"paper", "Berton et al.: Deep Visual Geo-localization Benchmark, CVPR 2022"},
     {"address", "https://github.com/gmberton/VPR-datasets-downloader"},
     {"licence", "that of each dataset"},
     {"size", "a few hundred pictures to 41 million"}},
});

}  // namespace
}  // namespace citylearn
