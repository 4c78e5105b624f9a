// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>

#include "core/util/text.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"

namespace citylearn {
namespace {

const std::vector<std::string> kSeasons{"spring", "summer", "fall", "winter"};
constexpr double kNordlandReach = 60;  ///< seconds before the first and after the last GPS row
constexpr double kClockChange = 1800;  ///< seconds; the longest tunnel takes a few minutes

bool tells(const std::string& name, const std::string& season) {
  return lower(name).find(season) != std::string::npos ||
         (season == "fall" && lower(name).find("autumn") != std::string::npos);
}

/// Nordland: 729 km of railway in Norway (Trondheim to Bodo), filmed from the engine once in each season; the films
/// were aligned so that frame i of all is the same place (Suenderhauf, Neubert, Protzel 2013). Letter case does not
/// matter:
///   spring/ summer/ fall/ winter/            pictures, commonly one a second of film, or one film
///   {season}_images_train/ ..._test/         parts for training and testing (Olid, Facil, Civera 2018), whose
///                                            pictures may lie in folders of sections
///   nordland-{season}.mp4 or any film with the season in its name
///   gpsData/{season}.csv, or beside: "tid,lat,lon,..." a row a second; tid is HHMMSScc, degrees are times 100,000
/// Unsure: how the raw GPS logs relate to the aligned films is not written down. Here the log's first row belongs to
/// the film's first second, and time runs as the log's clock does; seasons differ by up to some kilometres then, so
/// traversals are aligned by index and never by GPS. In names of pictures the last number counts them, one a second.
class Nordland : public FolderDataset {
 public:
  Nordland(const std::string& folder, const Parameters& parameters)
      : FolderDataset("nordland", folder, "spring, summer, fall and winter"),
        rate_(parameters["rate"]),
        test_(parameters.flag("test")) {}

  std::vector<std::string> names() override {
    const std::map<std::string, std::string> known = sources();
    std::vector<std::string> names;
    for (const std::string& season : kSeasons)
      if (known.contains(season)) names.push_back(season);
    return names;
  }

  /// Returns whether it has GPS logs, or names that are more than a season's.
  bool distinctive() override {
    const std::map<std::string, std::string> known = sources();
    return std::any_of(known.begin(), known.end(), [&](const auto& one) {
      const std::string name = lower(path_below(one.second, folder_));
      return name.find("nordland") != name.npos || name.find("_images_") != name.npos || !gps_log(one.first).empty();
    });
  }

  /// Returns pairs of pictures with the same number.
  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    require_known(a);
    require_known(b);
    const std::map<std::string, std::string> known = sources();
    std::map<long, int> frames;
    std::vector<std::pair<int, int>> pairs;
    for (const std::string& name : {a, b}) {
      const std::vector<std::string> pictures = season_pictures(known.at(name));
      if (pictures.empty()) return Dataset::matches(a, b);
      for (std::size_t i = 0; i < pictures.size(); ++i) {
        const long number = last_number(stem_of(pictures[i]));
        if (name == a)
          frames.emplace(number, static_cast<int>(i));
        else if (const auto found = frames.find(number); found != frames.end())
          pairs.emplace_back(found->second, static_cast<int>(i));
      }
    }
    return pairs;
  }

 private:
  Traversal read(const std::string& name) override {
    const std::string path = sources().at(name);
    std::vector<std::string> pictures = season_pictures(path);
    if (pictures.empty()) return with_gps(filmed(name, {is_folder(path) ? the_film_in(path) : path}));
    std::vector<double> times;
    for (const std::string& picture : pictures)
      times.push_back(static_cast<double>(last_number(stem_of(picture))) / rate_);
    Traversal traversal = pictured(name, std::move(pictures), path);
    // Sections count anew, and names may hold no numbers: then there is no clock.
    if (std::is_sorted(times.begin(), times.end()) && times.front() >= 0) traversal.times = std::move(times);
    return with_gps(std::move(traversal));
  }

  Traversal with_gps(Traversal traversal) const {
    const std::string log = gps_log(traversal.name);
    if (!log.empty() && !traversal.times.empty()) read_gps(log, traversal);
    return traversal;
  }

  /// Paths of a folder's pictures, or of those in its folders, section by section.
  static std::vector<std::string> season_pictures(const std::string& path) {
    std::vector<std::string> folders, paths;
    if (is_folder(path)) folders = picture_folders(path, 1);
    if (!folders.empty() && folders[0] == path) folders.resize(1);
    for (const std::string& folder : folders)
      for (const std::string& file : pictures_in(folder)) paths.push_back(folder + "/" + file);
    return paths;
  }

  static std::string the_film_in(const std::string& path) {
    const std::vector<std::string> films = files_in(path, video_suffixes());
    if (films.size() != 1)
      throw Error("holds no pictures and " + std::to_string(films.size()) + " films", path, "either is needed");
    return path + "/" + films.front();
  }

  /// Returns the path of each season's folder or film. Folders go before films that pictures were taken from.
  std::map<std::string, std::string> sources() const {
    std::map<std::string, std::string> found;
    const std::vector<std::string> folders = folders_in(folder_), films = files_in(folder_, video_suffixes());
    for (const std::string& season : kSeasons) {
      std::vector<std::string> fitting;
      for (const std::string& name : folders)
        if (tells(name, season) && tells_part(name) && has_frames(folder_ + "/" + name)) {
          if (lower(name) == season) fitting.clear();
          fitting.push_back(name);
          if (lower(name) == season) break;
        }
      if (fitting.empty())
        for (const std::string& name : films)
          if (tells(name, season)) fitting.push_back(name);
      if (fitting.size() > 1)
        throw Error("both " + fitting[0] + " and " + fitting[1] + " seem to be " + season, folder_, "move one of them");
      if (!fitting.empty()) found[season] = folder_ + "/" + fitting.front();
    }
    if (found.empty()) not_recognised("folder or film of spring, summer, fall or winter in it");
    return found;
  }

  static bool has_frames(const std::string& path) {
    return !picture_folders(path, 1).empty() || !files_in(path, video_suffixes()).empty();
  }
  /// Folders of the training and of the test part may lie side by side.
  bool tells_part(const std::string& name) const {
    const bool train = lower(name).find("train") != std::string::npos,
               test = lower(name).find("test") != std::string::npos;
    return test_ ? test : train || !test;
  }

  std::string gps_log(const std::string& season) const {
    for (const std::string folder : {"/gpsData", "/gps", ""}) {
      if (!is_folder(folder_ + folder)) continue;
      for (const std::string& file : files_in(folder_ + folder, {".csv"}))
        if (const std::string path = folder_ + folder + "/" + file;
            tells(file, season) && (!folder.empty() || TextTable(path, {}).has("tid")))
          return path;
    }
    return "";
  }

  /// Seconds of the day in HHMMSScc, -1 when it is not a time.
  static double seconds_of(double tid) {
    const long time = static_cast<long>(tid) / 100;
    const long hours = time / 10000, minutes = time / 100 % 100, seconds = time % 100;
    if (tid < 0 || hours > 23 || minutes > 59 || seconds > 60) return -1;
    return static_cast<double>(hours * 3600 + minutes * 60 + seconds);
  }

  static void read_gps(const std::string& path, Traversal& traversal) {
    const TextTable log(path, {});
    GpsRows rows;
    rows.log = path;
    double last = 0, elapsed = 0;
    for (int row = 0; row < log.rows(); ++row) {
      double north = log.number(row, "lat"), east = log.number(row, "lon");
      if (std::abs(north) > 90 || std::abs(east) > 180) {
        north /= 1e5;
        east /= 1e5;
      }
      if (std::abs(north) > 90 || std::abs(east) > 180) log.fail(row, "not a latitude and a longitude");
      // The published logs hold a few rows of a broken or repeated time, which are passed over, and clocks that were
      // put forward by an hour on the way.
      const double now = seconds_of(log.number(row, "tid"));
      if (now < 0 || (!rows.times.empty() && now <= last)) continue;
      if (!rows.times.empty()) elapsed += now - last > kClockChange ? 1 : now - last;
      last = now;
      rows.add(elapsed, north, east);
    }
    if (rows.times.empty()) throw Error("has no positions", path);
    locate(traversal, rows, kNordlandReach);
  }

  double rate_;
  bool test_;
};

const DatasetRegistry::Registration nordland_registration({
    "nordland",
    "Nordland railway: 729 km in four seasons, frame aligned",
    {{"rate", "pictures per second of film, where folders hold pictures", 1, 0.01, 60},
     {"test", "1: read the test part of partitioned Nordland", 0, 0, 1, true}},
    open_folder<Nordland>,
    {},
    {{"paper",
      "Suenderhauf, Neubert, Protzel: Are We There Yet? Challenging SeqSLAM on a 3000 km Journey Across All Four "
      "Seasons, ICRA 2013 workshop"},
     {"address", "https://nrkbeta.no/2013/01/15/nordlandsbanen-minute-by-minute-season-by-season/"},
     {"licence", "Creative Commons, by NRK; the page tells which"},
     {"size", "four films of 10 hours, 35,768 frames at one a second"}},
});

}  // namespace
}  // namespace citylearn
