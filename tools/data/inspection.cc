// SPDX-License-Identifier: Apache-2.0
#include "tools/data/inspection.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <unordered_set>
#include <utility>

#include "core/files/image_header.h"
#include "core/util/text.h"
#include "env_service/files/files.h"
#include "env_service/geometry/plane.h"
#include "env_service/images/image_sources.h"
#include "env_service/streets/street_graph.h"
#include "env_service/traversal/alignment.h"
#include "env_service/traversal/sight.h"
#include "env_service/traversal/street_views.h"

namespace citylearn {
namespace {

constexpr int kFewestCompared = 48;   // frames; fewer tell too little
constexpr double kNear = 25;          // metres between places that are taken for the same
constexpr double kMinStep = 2;        // metres between places that are compared
constexpr double kMinBrightest = 16;  // of 255, the largest value of a picture
constexpr int kFewestSteps = 5;       // that show which way a recording runs

std::string fixed(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : "-";
}

std::string size_of(const Bytes& picture, const std::string& name) {
  const ImageHeader header = read_image_header(picture, name);
  return fmt::format("{}x{}", header.width, header.height);
}

/// Adds a line for each kind of file in the folder whose path, with its suffix or without, is not among `taken`, but
/// for files of traversals that could not be loaded.
void find_left_out(const std::string& folder, const std::unordered_set<std::string>& taken,
                   const std::set<std::string>& failed, bool own, Inspection& found) {
  namespace fs = std::filesystem;
  static const std::set<std::string> passed_over{".csv", ".json", ".xml", ".yaml", ".yml", ".toml", ".ini",
                                                 ".db",  ".xmp",  ".aae", ".thm",  ".log", ".md",   ".lrv"},
      texts{"files without a suffix", ".txt files", ".tsv files", ".pdf files", ".html files", ".srt files"};
  const bool database = LevelDb::is_in(folder);        // takes all of its files
  std::map<std::string, std::set<std::string>> kinds;  // paths by kind
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && at != end; at.increment(error)) {
    const std::string path = path_below(at->path().string(), folder);
    const bool poses = lower(path).ends_with(".poses.csv"), hidden = at->path().filename().string().starts_with('.');
    const std::string suffix = poses ? ".poses.csv" : lower(at->path().extension().string());
    const std::string stem = path.substr(0, path.size() - suffix.size());
    std::error_code ignored;
    const bool is_folder = at->is_directory(ignored);
    if (hidden && is_folder) at.disable_recursion_pending();
    if (hidden || (is_folder ? !fs::is_empty(at->path(), ignored) : passed_over.contains(suffix)) ||
        failed.contains(path.substr(0, path.find('/'))) || taken.contains(path) || taken.contains(stem) ||
        taken.contains(stem + suffix) || (database && LevelDb::owns(path)))
      continue;
    const std::string unnamed =
        path.find('/') == path.npos ? "files without a suffix" : "files in folders without a suffix";
    kinds[is_folder ? "empty folders" : suffix.empty() ? unnamed : suffix + " files"].insert(path);
  }
  for (const auto& [kind, paths] : kinds) {
    auto& lines = own && !texts.contains(kind) ? found.not_taken : found.left_out;
    lines.push_back(fmt::format("{} {}, the first {}", paths.size(), kind, *paths.begin()));
  }
}

/// Adds a line for each recording whose frames do not show the places of those of equal index of "summer", or else of
/// the first one, as far as their pictures or features tell.
void compare_by_sight(Dataset& dataset, const std::vector<Traversal>& traversals, Inspection& found) {
  const Traversal* first = nullptr;
  for (const Traversal& one : traversals)
    if (one.frames >= kFewestCompared && (!first || one.name == "summer")) first = &one;
  if (!first) return;
  const auto whole = [&](const Traversal& one) { return one.images ? one : dataset.load(one.name); };
  const Traversal route = whole(*first);
  std::vector<int> frames(static_cast<std::size_t>(route.frames));
  std::iota(frames.begin(), frames.end(), 0);
  for (const Traversal& other : traversals)
    if (&other != first && other.frames >= kFewestCompared && !other.images == !route.images &&
        other.dimension == route.dimension)
      try {
        const SightAlignment alignment = align_by_sight(route, frames, whole(other));
        if (alignment.elsewhere || other.frames != route.frames)
          found.notes.push_back(alignment.summary + " (--align-by sight)");
        found.matches.push_back({route.name, other.name, other.frames, alignment.found, alignment.confidence});
        for (std::size_t i = 0; i < alignment.unmatched.size(); ++i)
          if (alignment.unmatched[i]) found.matches.back().counterparts[i] = -1;
      } catch (const Error& error) {
        found.notes.push_back(error.what());
      }
}

/// Returns the known places of a route with their frames, without those that hardly differ from the one before.
std::vector<std::pair<Point, int>> thinned(const Route& route) {
  std::vector<std::pair<Point, int>> places;
  for (std::size_t i = 0; i < route.latitude.size(); ++i) {
    if (!std::isfinite(route.latitude[i]) || !std::isfinite(route.longitude[i])) continue;
    const Point place = on_earth(route.latitude[i], route.longitude[i]);
    if (places.empty() || metres_between(place, places.back().first) >= kMinStep)
      places.emplace_back(place, static_cast<int>(i));
  }
  return places;
}

/// Adds a line where a recording runs the other way than the first one with places, or, of the user's `own`, elsewhere.
void compare_by_place(const std::vector<Route>& routes, bool own, Inspection& found) {
  if (routes.empty()) return;
  Grid grid(kNear);
  for (const auto& [place, frame] : thinned(routes[0])) grid.add(place, frame);
  std::vector<Grid::Near> near;
  for (std::size_t other = 1; other < routes.size(); ++other) {
    const auto places = thinned(routes[other]);
    std::size_t far = 0;
    int along = 0, against = 0, before = -1;
    for (const auto& [place, index] : places) {
      grid.near(place, near);
      if (near.empty()) {
        ++far;
        continue;
      }
      const int frame =
          std::min_element(near.begin(), near.end(), [](auto& a, auto& b) { return a.metres < b.metres; })->frame;
      along += before >= 0 && frame > before;
      against += before >= 0 && frame < before;
      before = frame;
    }
    const std::string &name = routes[other].name, &first = routes[0].name;
    if (against >= kFewestSteps && against > 3 * along)
      found.notes.push_back(name + " runs the other way than " + first +
                            ", by latitude and longitude: cameras that look ahead see other things");
    if (own && 2 * far > places.size())
      found.notes.push_back(fmt::format("{} of {} places of {} are farther than {} m from all of {}", far,
                                        places.size(), name, kNear, first));
  }
}

}  // namespace

Inspection inspect(Dataset& dataset, const std::string& folder, const std::function<bool(long, long)>& progress) {
  Inspection inspection;
  std::unordered_set<std::string> taken;
  std::set<std::string> failed;
  std::vector<Traversal> traversals;
  std::map<std::uint64_t, std::string> names;  // by the hash of what frames show
  long all = 0;
  std::string no_streets;
  try {
    if (const auto streets = dataset.streets())
      taken.insert(
          {"nodes.txt", "links.txt", "graph/nodes.txt", "graph/links.txt", path_below(streets->where(), folder)});
  } catch (const Error& error) {
    no_streets = error.what();
  }
  for (const std::string& name : dataset.names()) try {
      taken.insert(name + ".poses.csv");
      traversals.push_back(dataset.load(name));
      taken.insert(traversals.back().places_from);
      all += traversals.back().frames;
      if (const Traversal& one = traversals.back();
          !one.streets &&
          std::any_of(one.latitude.begin(), one.latitude.end(), [](double x) { return std::isfinite(x); }))
        inspection.routes.push_back({name, one.latitude, one.longitude});
      if (!traversals.back().streets) try {
          for (const std::string& line : streets_driven(traversals.back(), name).description())
            inspection.notes.push_back(name + ": " + line);
        } catch (const Error&) {  // it is a line alone
        }
      std::vector<float> positions = std::exchange(traversals.back().positions, {});
      if (const auto [same, is_new] = names.emplace(traversals.back().hash(), name); !is_new)
        inspection.notes.push_back(name + " shows the same in every frame as " + same->second + ": is it a copy?");
      traversals.back().positions = std::move(positions);
      traversals.back().features = {};  // they were checked as they were read
      const LeftOut left_out = dataset.left_out(name);
      for (const std::string& line : left_out.on_purpose) inspection.left_out.push_back(name + ": " + line);
      for (const std::string& line : left_out.faults) inspection.faults.push_back({name, -1, "", line});
    } catch (const Error& error) {
      inspection.faults.push_back({name, -1, "", error.what()});
      failed.insert(name);
      taken.insert(name);
    }
  try {
    const std::vector<std::string> lines = dataset.describe_streets();  // once the recordings are read
    inspection.notes.insert(inspection.notes.begin(), lines.begin(), lines.end());
  } catch (const Error& error) {
    no_streets = error.what();
  }
  if (failed.empty() && !no_streets.empty()) inspection.faults.push_back({"streets", -1, "", no_streets});
  for (const Traversal& one : traversals)
    if (one.dimension != traversals[0].dimension && one.dimension > 0 && traversals[0].dimension > 0)
      inspection.faults.push_back(
          {one.name, -1, "",
           fmt::format("has {} features a frame, {} has {}: they are of two encoders, or one table is transposed",
                       one.dimension, traversals[0].name, traversals[0].dimension)});
  if (dataset.correspondence() == Correspondence::kMatches)
    for (std::size_t i = 1; i < traversals.size(); ++i) try {
        align_by_matches(traversals[0], {}, traversals[i], dataset.matches(traversals[0].name, traversals[i].name));
      } catch (const Error& error) {
        inspection.faults.push_back({traversals[i].name, -1, "", error.what()});
      }
  Bytes bytes;
  for (const Traversal& traversal : traversals) {
    int dark = 0;
    std::set<std::string> sizes;
    for (int frame = 0; frame < traversal.frames; ++frame) {
      if (traversal.images) {
        const std::string name = traversal.images->name(frame);
        taken.insert(name.find(", frame ") == name.npos ? name.substr(0, name.rfind('.'))
                                                        : name.substr(0, name.rfind(',')));
        double brightest = 0;
        if (const std::string what = decoding_fault(*traversal.images, frame, bytes, brightest); !what.empty()) {
          inspection.faults.push_back({traversal.name, frame, name, what});
        } else {
          dark += brightest < kMinBrightest;
          sizes.insert(size_of(bytes, name));
        }
      }
      if (!progress(++inspection.frames, all)) return inspection;
    }
    if (dark == traversal.frames)
      inspection.notes.push_back(
          fmt::format("{}: all {} pictures are almost black, as those of 16 bits with low numbers: scale them up",
                      traversal.name, dark));
    if (sizes.size() > 1 && !dataset.distinctive())
      inspection.notes.push_back(fmt::format("{}: has pictures of {} sizes, as {} and {}: are some of another camera?",
                                             traversal.name, sizes.size(), *sizes.begin(), *sizes.rbegin()));
  }
  find_left_out(folder, taken, failed, !dataset.distinctive(), inspection);
  const auto [least, most] =
      std::minmax_element(traversals.begin(), traversals.end(), [](auto& a, auto& b) { return a.frames < b.frames; });
  if (least != most && least->frames != most->frames && dataset.correspondence() == Correspondence::kIndex)
    inspection.notes.push_back(fmt::format(
        "{} has {} frames and {} {}: frames of equal index must show the same place, or be matched, as with --align-by "
        "sight",
        least->name, least->frames, most->name, most->frames));
  if (dataset.correspondence() == Correspondence::kIndex && !dataset.distinctive() &&
      std::none_of(traversals.begin(), traversals.end(), [](const Traversal& one) { return one.streets != nullptr; }))
    compare_by_sight(dataset, traversals, inspection);
  compare_by_place(inspection.routes, !dataset.distinctive(), inspection);
  return inspection;
}

Summary summarise(Dataset& dataset, const std::string& name) {
  Summary summary;
  summary.name = name;
  summary.metres = summary.mean_step = std::numeric_limits<double>::quiet_NaN();
  try {
    const Traversal traversal = dataset.load(name);
    summary.condition = traversal.condition;
    summary.frames = traversal.frames;
    summary.dimension = traversal.dimension;
    std::vector<double> known;
    std::copy_if(traversal.positions.begin(), traversal.positions.end(), std::back_inserter(known),
                 [](float metres) { return std::isfinite(metres); });
    const auto [least, most] = std::minmax_element(known.begin(), known.end());
    if (!known.empty()) summary.metres = *most - *least;
    if (known.size() > 1) summary.mean_step = summary.metres / static_cast<double>(known.size() - 1);
    summary.gps =
        std::any_of(traversal.latitude.begin(), traversal.latitude.end(), [](double x) { return !std::isnan(x); });
    if (summary.gps || !known.empty()) summary.places = traversal.places_from;
    if (!traversal.images) return summary;
    Bytes bytes;
    for (int frame = 0; frame < traversal.frames; ++frame) {
      if (!traversal.images->fault(frame).empty()) {
        ++summary.bad_frames;
      } else if (summary.pixels.empty()) {
        traversal.images->read(frame, bytes);
        summary.pixels = size_of(bytes, traversal.images->name(frame));
      }
    }
  } catch (const Error& error) {
    summary.error = error.what();
  }
  return summary;
}

std::string to_table(const std::vector<Summary>& summaries) {
  const std::size_t names = 2;  // columns of names, which stand left; figures stand right
  std::vector<std::vector<std::string>> rows = {
      {"traversal", "condition", "frames", "metres", "step m", "places", "pixels", "features", "bad"}};
  for (const Summary& one : summaries) {
    if (!one.error.empty()) {
      rows.push_back({one_line(one.name), "cannot be loaded: " + one.error});
      continue;
    }
    rows.push_back({one_line(one.name), one_line(one.condition), std::to_string(one.frames), fixed(one.metres, 0),
                    fixed(one.mean_step, 2),
                    !one.places.empty() ? one_line(one.places)
                    : one.gps           ? "yes"
                                        : "no",
                    one.pixels.empty() ? "-" : one.pixels, one.dimension ? std::to_string(one.dimension) : "-",
                    std::to_string(one.bad_frames)});
  }
  std::vector<std::size_t> widths(rows[0].size());
  for (const auto& row : rows)
    for (std::size_t i = 0; i < (row.size() == widths.size() ? row.size() : 1); ++i)
      widths[i] = std::max(widths[i], row[i].size());
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i)
      text += (i == 0 ? "" : "  ") + fmt::format(fmt::runtime(i < names ? "{:<{}}" : "{:>{}}"), row[i], widths[i]);
    text += "\n";
  }
  return text;
}

}  // namespace citylearn
