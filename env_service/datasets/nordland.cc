// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

#include "core/wire/messages.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/dataset_io/parts.h"

namespace citylearn {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kSeasons{"spring", "summer", "fall", "winter"};
constexpr double kReach = 60;          ///< seconds before the first and after the last GPS row
constexpr double kClockChange = 1800;  ///< seconds; the longest tunnel takes a few minutes

std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
  return text;
}

bool tells(const std::string& name, const std::string& season) {
  return lower(name).find(season) != std::string::npos ||
         (season == "fall" && lower(name).find("autumn") != std::string::npos);
}

/// The last number in a picture's name, -1 without one.
double number_in(const std::string& name) {
  const std::size_t end = name.find_last_of("0123456789");
  if (end == name.npos) return -1;
  const std::size_t before = name.find_last_not_of("0123456789", end);
  const std::size_t begin = before == name.npos ? 0 : before + 1;
  return end - begin < 9 ? std::stod(name.substr(begin, end - begin + 1)) : -1;
}

/// Nordland: 729 km of railway in Norway (Trondheim to Bodo), filmed from the engine once in each season; the films
/// were aligned so that frame i of all is the same place (Suenderhauf, Neubert, Protzel 2013). Letter case does not
/// matter:
///   spring/ summer/ fall/ winter/            pictures, commonly one a second of film, or one film
///   {season}_images_train/ ..._test/         parts for training and testing (Olid, Facil, Civera 2018); pictures may
///   lie
///                                            in folders of sections
///   nordland-{season}.mp4 or any film with the season in its name
///   gpsData/{season}.csv, or beside: "tid,lat,lon,..." a row a second; tid is HHMMSScc, degrees are times 100,000
/// Unsure: how the raw GPS logs relate to the aligned films is not written down. Here the log's first row belongs to
/// the film's first second, and time runs as the log's clock does; seasons differ by up to some kilometres then, so
/// traversals are aligned by index and never by GPS. In names of pictures the last number counts them, one a second.
class Nordland : public Dataset {
 public:
  Nordland(const std::string& folder, const Parameters& parameters)
      : folder_(folder), rate_(parameters["rate"]), test_(parameters.flag("test")) {
    if (folder.empty())
      throw Error("needs the folder that holds spring, summer, fall and winter", "dataset nordland",
                  "give it with --data DIR");
  }

  std::vector<std::string> names() override {
    const std::map<std::string, std::string> known = sources();
    std::vector<std::string> names;
    for (const std::string& season : kSeasons)
      if (known.contains(season)) names.push_back(season);
    return names;
  }

  Traversal load(const std::string& name) override {
    const std::map<std::string, std::string> known = sources();
    if (!known.contains(name)) throw unknown_traversal(name, folder_, names());
    const std::string& path = known.at(name);
    Traversal traversal;
    traversal.dataset = "nordland";
    traversal.name = name;
    traversal.condition = name;
    std::vector<std::string> pictures = pictures_in(path);
    if (!pictures.empty()) {
      for (const std::string& picture : pictures)
        traversal.times.push_back(number_in(fs::path(picture).stem().string()) / rate_);
      // Sections count anew, and names may tell nothing: then there is no clock.
      if (!std::is_sorted(traversal.times.begin(), traversal.times.end()) || traversal.times.front() < 0)
        traversal.times.clear();
      traversal.images = image_files(std::move(pictures), folder_);
    } else {
      double rate = 0;
      traversal.images = video_frames(fs::is_directory(path) ? the_film_in(path) : path, folder_, &rate);
      for (int frame = 0; rate > 0 && frame < traversal.images->frames(); ++frame)
        traversal.times.push_back(frame / rate);
    }
    traversal.frames = traversal.images->frames();
    if (traversal.frames < 2) throw Error("has only one frame, a route needs two", path);
    if (traversal.frames > static_cast<int>(msg::MAX_FRAMES))
      throw Error("more than " + std::to_string(msg::MAX_FRAMES) + " frames", path);
    traversal.positions.assign(static_cast<std::size_t>(traversal.frames), std::numeric_limits<float>::quiet_NaN());
    if (const std::string log = gps_log(name); !log.empty() && !traversal.times.empty()) read_gps(log, traversal);
    return traversal;
  }

  /// Pictures of the same number.
  std::vector<std::pair<int, int>> matches(const std::string& a, const std::string& b) override {
    const std::map<std::string, std::string> known = sources();
    std::map<double, int> frames;
    std::vector<std::pair<int, int>> pairs;
    for (const std::string& name : {a, b}) {
      if (!known.contains(name)) throw unknown_traversal(name, folder_, names());
      const std::vector<std::string> pictures = pictures_in(known.at(name));
      if (pictures.empty()) return Dataset::matches(a, b);
      for (std::size_t i = 0; i < pictures.size(); ++i) {
        const double number = number_in(fs::path(pictures[i]).stem().string());
        if (name == a)
          frames.emplace(number, static_cast<int>(i));
        else if (const auto found = frames.find(number); found != frames.end())
          pairs.emplace_back(found->second, static_cast<int>(i));
      }
    }
    return pairs;
  }

 private:
  /// Paths of a folder's pictures, or of those in its folders, section by section.
  static std::vector<std::string> pictures_in(const std::string& path) {
    std::vector<std::string> paths;
    if (!fs::is_directory(path)) return paths;
    for (const std::string& file : files_in(path, image_suffixes())) paths.push_back(path + "/" + file);
    if (paths.empty())
      for (const std::string& section : folders_in(path))
        for (const std::string& file : files_in(path + "/" + section, image_suffixes()))
          paths.push_back(path + "/" + section + "/" + file);
    return paths;
  }

  static std::string the_film_in(const std::string& path) {
    const std::vector<std::string> films = files_in(path, video_suffixes());
    if (films.size() != 1)
      throw Error("holds no pictures and " + std::to_string(films.size()) + " films", path, "one of both is needed");
    return path + "/" + films.front();
  }

  /// Path of each season's folder or film. Folders go before films that pictures were taken from.
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
    if (found.empty())
      throw Error("is not nordland: neither a folder nor a film of spring, summer, fall or winter", folder_,
                  "--data names the folder above the seasons");
    return found;
  }

  static bool has_frames(const std::string& path) {
    return !pictures_in(path).empty() || !files_in(path, video_suffixes()).empty();
  }
  /// Folders of the training and of the test part may lie side by side.
  bool tells_part(const std::string& name) const {
    const bool train = lower(name).find("train") != std::string::npos,
               test = lower(name).find("test") != std::string::npos;
    return test_ ? test : train || !test;
  }

  std::string gps_log(const std::string& season) const {
    for (const std::string folder : {"/gpsData", "/gps", ""}) {
      if (!fs::is_directory(folder_ + folder)) continue;
      for (const std::string& file : files_in(folder_ + folder, {".csv"}))
        if (tells(file, season)) return folder_ + folder + "/" + file;
    }
    return "";
  }

  /// Seconds of the day in HHMMSScc, -1 when it is no time.
  static double seconds_of(double tid) {
    const long time = static_cast<long>(tid) / 100;
    const long hours = time / 10000, minutes = time / 100 % 100, seconds = time % 100;
    if (tid < 0 || hours > 23 || minutes > 59 || seconds > 60) return -1;
    return static_cast<double>(hours * 3600 + minutes * 60 + seconds);
  }

  static void read_gps(const std::string& path, Traversal& traversal) {
    const TextTable log(path, {});
    std::vector<double> times, latitude, longitude;
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
      if (now < 0 || (!times.empty() && now <= last)) continue;
      if (!times.empty()) elapsed += now - last > kClockChange ? 1 : now - last;
      last = now;
      times.push_back(elapsed);
      latitude.push_back(north);
      longitude.push_back(east);
    }
    if (times.empty()) throw Error("has no positions", path);
    traversal.latitude = interpolate(times, latitude, traversal.times, kReach);
    traversal.longitude = interpolate(times, longitude, traversal.times, kReach);
    traversal.positions = metres_along(traversal.latitude, traversal.longitude);
  }

  std::string folder_;
  double rate_;
  bool test_;
};

const DatasetRegistry::Registration registration({
    "nordland",
    "Nordland railway: 729 km in four seasons, frame aligned",
    {{"rate", "pictures a second of film, where folders hold pictures", 1, 0.01, 60},
     {"test", "1: of partitioned Nordland the test part", 0, 0, 1, true}},
    [](const Parameters& parameters, const std::string& folder) {
      return std::make_unique<Nordland>(folder, parameters);
    },
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
