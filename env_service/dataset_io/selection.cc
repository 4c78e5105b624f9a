// SPDX-License-Identifier: Apache-2.0
#include "env_service/dataset_io/selection.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "core/util/text.h"
#include "env_service/images/image_sources.h"
#include "env_service/traversal/alignment.h"
#include "env_service/traversal/sight.h"
#include "env_service/traversal/street_views.h"

namespace citylearn {
namespace {

constexpr double kMinMetres = 0.05;  ///< apart
constexpr double kMove = 0.075;      ///< of a picture's width, to the right where the camera was further left

const std::map<std::string, Correspondence> kWays{{"index", Correspondence::kIndex},
                                                  {"matches", Correspondence::kMatches},
                                                  {"distance", Correspondence::kDistance},
                                                  {"gps", Correspondence::kGps},
                                                  {"sight", Correspondence::kSight}};

void check(const Selection& selection) {
  if (selection.first < 0 || selection.end <= selection.first) throw Error("no frame in it", "--frames");
  if (!(selection.from < selection.to)) throw Error("no place in it", "--metres");
  if (selection.step < 1) throw Error("must be 1 or more", "--step");
  if (selection.step_metres != 0 && !(selection.step_metres >= kMinMetres && std::isfinite(selection.step_metres)))
    throw Error("must be 0.05 or more", "--step-metres");
  if (selection.step > 1 && selection.step_metres > 0)
    throw Error("cannot be together with --step", "--step-metres", "give one of them");
  if (!(selection.tolerance > 0 && selection.tolerance <= 1e5)) throw Error("must be 0..100000 m", "--align-within");
}

/// Returns the frames cut out of `traversal`, thinned.
std::vector<int> cut(const Traversal& traversal, const Selection& selection) {
  const auto metres = [&](int frame) { return traversal.positions[static_cast<std::size_t>(frame)]; };
  const auto need_positions = [&](const std::string& option) {
    if (std::none_of(traversal.positions.begin(), traversal.positions.end(), [](float m) { return std::isfinite(m); }))
      throw Error("positions of " + traversal.name + " are not known", option, "use --frames and --step");
  };
  int begin = selection.first, end = traversal.frames;
  if (selection.end != std::numeric_limits<int>::max()) end = selection.end;
  if (begin >= traversal.frames || end > traversal.frames)
    throw Error("beyond " + traversal.name + ", which has " + std::to_string(traversal.frames) + " frames", "--frames");
  if (std::isfinite(selection.from) || std::isfinite(selection.to)) {
    need_positions("--metres");
    const auto inside = [&](int frame) { return metres(frame) >= selection.from && metres(frame) < selection.to; };
    // Frames of unknown position stay when known ones are on both sides.
    while (begin < end && !inside(begin)) ++begin;
    while (end > begin && !inside(end - 1)) --end;
  }
  std::vector<int> frames;
  if (selection.step_metres > 0) {
    need_positions("--step-metres");
    for (int frame = begin; frame < end; ++frame)
      if (std::isfinite(metres(frame)) &&
          (frames.empty() || metres(frame) - static_cast<double>(metres(frames.back())) >= selection.step_metres))
        frames.push_back(frame);
  } else {
    for (long frame = begin; frame < end; frame += selection.step) frames.push_back(static_cast<int>(frame));
  }
  if (frames.size() < 2)
    throw Error(
        "of " + traversal.name + (frames.empty() ? " no frame is" : " only one frame is") + " left, a route needs two",
        "--frames, --metres or --step", "select more");
  return frames;
}

/// Returns the frames of `traversal` at the places of `frames`, those cut out of its sibling. Sets `unmatched` where
/// some have none.
std::vector<int> aligned(Dataset& dataset, const Traversal& traversal, const Traversal& sibling,
                         const std::vector<int>& frames, const Selection& selection, std::vector<bool>& unmatched) {
  Correspondence by = traversal.streets ? Correspondence::kIndex : dataset.correspondence();
  if (selection.by != "dataset") {
    if (!kWays.contains(selection.by))
      throw Error("unknown way '" + selection.by + "'", "--align-by",
                  "known: dataset, " + joined(kWays, &decltype(kWays)::value_type::first));
    by = kWays.at(selection.by);
  }
  SightAlignment alignment;
  if (by == Correspondence::kSight) {
    alignment = align_by_sight(sibling, frames, traversal);
    spdlog::info(alignment.summary);
    unmatched = alignment.unmatched;
  }
  std::vector<int> found =
      by == Correspondence::kSight ? alignment.found
      : by == Correspondence::kGps ? align_by_gps(sibling, frames, traversal, selection.tolerance)
      : by == Correspondence::kMatches
          ? align_by_matches(sibling, frames, traversal, dataset.matches(sibling.name, traversal.name))
      : by == Correspondence::kDistance ? align_by_distance(sibling, frames, traversal, selection.tolerance)
                                        : align_by_index(sibling, frames, traversal);
  if (by != Correspondence::kGps) warn_if_apart(sibling, frames, traversal, found, selection.tolerance);
  return found;
}

/// Returns the nearest frame of the recording without a fault; the earlier of two.
int replacement_for(const Images& images, int frame) {
  for (int away = 1; away < images.frames(); ++away)
    for (const int near : {frame - away, frame + away})
      if (near >= 0 && near < images.frames() && images.fault(near).empty()) return near;
  throw Error("no frame of the recording can be read", images.name(frame), images.fault(frame));
}

/// Returns the frames to show in place of `frames`.
std::vector<int> without_bad_ones(const Images& images, std::vector<int> frames, bool skip) {
  constexpr int kMaxNamedFrames = 20;
  int bad = 0, last = -1, replacement = -1;
  std::string first;
  for (int& frame : frames) {
    const std::string fault = images.fault(frame);
    if (fault.empty()) continue;
    if (++bad == 1) first = images.name(frame) + ": " + fault;
    if (!skip) {
      if (bad <= kMaxNamedFrames) spdlog::error("bad frame {}: {}", images.name(frame), fault);
      continue;
    }
    if (frame != last) replacement = replacement_for(images, frame);
    last = frame;
    if (bad <= kMaxNamedFrames)
      spdlog::warn("bad frame {}: {}; {} replaces it", images.name(frame), fault, images.name(replacement));
    frame = replacement;
  }
  if (bad > kMaxNamedFrames) spdlog::warn("{} bad frames, {} of them named", bad, kMaxNamedFrames);
  if (bad && !skip)
    throw Error(first + (bad > 1 ? ", and " + std::to_string(bad - 1) + " more bad frames" : ""), "",
                "replace the files, cut with --frames, or use their neighbours with --on-bad-frame skip");
  return frames;
}

/// Makes the frames those of the links of the streets that a recording has run through: the traversal itself, or its
/// sibling, where it is aligned to one, so that both walk on one map.
void walk_on_streets(Traversal& traversal, const Traversal& driven, std::optional<StateRule> rule) {
  if (rule != StateRule::kStreet)
    throw Error(
        "traversal '" + driven.name + "' has no map of streets, and was seen in the direction of the drive alone",
        "--rule", "give --rule street, or leave it out");
  DriveStreets streets = streets_driven(driven, "traversal '" + driven.name + "'");
  spdlog::info("{}: {}", driven.name, streets.description().front());
  const std::vector<std::string_view> names = split(driven.name, '+');
  std::vector<std::string> counts;
  for (std::size_t i = 0; i < driven.begins.size(); ++i) {
    const auto first = streets.places.begin() + driven.begins[i];
    const auto end = i + 1 < names.size() ? streets.places.begin() + driven.begins[i + 1] : streets.places.end();
    counts.push_back(fmt::format("{} of {} of {}", end - first - std::count(first, end, -1), end - first, names[i]));
  }
  if (!counts.empty()) spdlog::info("{}: frames at places of these streets: {}", driven.name, joined(counts));
  show_along_links(traversal, std::make_shared<const StreetMap>(std::move(streets.map)), streets.shown);
}

/// Returns the recordings that an option's name joins, "monday+tuesday"; one where it is the name of one.
std::vector<std::string> joined_by(Dataset& dataset, const std::string& option, const std::string& name) {
  if (name.find('+') == name.npos) return {name};
  const std::vector<std::string> known = dataset.names();
  if (std::find(known.begin(), known.end(), name) != known.end()) return {name};
  std::vector<std::string> names;
  for (const std::string_view part : split(name, '+')) names.emplace_back(part);
  const std::set<std::string> once(names.begin(), names.end());
  if (once.contains("")) throw Error("names nothing beside a +", option + " " + name, "name a recording on both sides");
  if (once.size() < names.size()) throw Error("names a recording twice", option + " " + name, "name each once");
  return names;
}

/// Returns the recording of which `name` is NAME-left or NAME-right, what its camera would have seen further left or
/// right; none where the dataset has one called so.
std::optional<std::string> moved_from(Dataset& dataset, const std::string& name) {
  const std::size_t end = name.rfind('-');
  if (!name.ends_with("-left") && !name.ends_with("-right")) return std::nullopt;
  const std::vector<std::string> known = dataset.names();
  const auto knows = [&](const std::string& one) { return std::find(known.begin(), known.end(), one) != known.end(); };
  return knows(name) || !knows(name.substr(0, end)) ? std::nullopt : std::optional(name.substr(0, end));
}

/// Loads a recording of the dataset, or what is moved_from() one.
Traversal load(Dataset& dataset, const std::string& name) {
  const std::optional<std::string> whole = moved_from(dataset, name);
  Traversal traversal = dataset.load(whole.value_or(name));
  if (!whole) return traversal;
  if (!traversal.images)
    throw Error("has no pictures to move", "traversal '" + *whole + "'", "leave -left and -right out");
  const bool left = name.ends_with("-left");
  spdlog::info("'{}' is '{}' as a camera further {} would have seen it: there is no recording of this name", name,
               *whole, left ? "left" : "right");
  traversal.name = name;
  traversal.images = moved(traversal.images, left ? kMove : -kMove);
  return traversal;
}

/// Returns the frames of one recording that are selected. `sibling` becomes those of the one that it is aligned to, at
/// the same places, where streets will be made of them.
Traversal recorded(Dataset& dataset, const std::string& name, const Selection& selection,
                   std::optional<Traversal>& sibling) {
  Traversal traversal = load(dataset, name);
  std::vector<bool> unmatched;
  std::vector<int> frames, places;  // places: the frames of the sibling
  if (selection.align.empty() || moved_from(dataset, name) == selection.align) {
    frames = cut(traversal, selection);
  } else {
    sibling = dataset.load(selection.align);
    places = cut(*sibling, selection);
    frames = aligned(dataset, traversal, *sibling, places, selection, unmatched);
  }
  std::vector<int> all(static_cast<std::size_t>(traversal.frames));
  std::iota(all.begin(), all.end(), 0);
  if (traversal.streets && frames != all)
    throw Error("streets are walked on as a whole", "--frames, --metres, --step or --align-to",
                "leave it out, or give --rule line");
  if (traversal.images) {
    std::vector<int> shown = without_bad_ones(*traversal.images, frames, selection.skip_bad_frames);
    if (shown != all) traversal.images = picked(traversal.images, std::move(shown));
  }
  if (frames != all) traversal.keep(frames);
  traversal.unmatched = std::move(unmatched);
  if (sibling && dataset.on_streets() && !traversal.streets) sibling->keep(places);
  return traversal;
}

/// Throws Error unless these recordings can be joined, each aligned to the sibling of its number.
void check_join(Dataset& dataset, const std::string& name, const std::vector<std::string>& names,
                const std::vector<std::string>& siblings, const Selection& selection) {
  if (!dataset.on_streets())
    throw Error("joins recordings to streets", "--traversal " + name, "add --rule street, or name one of them");
  if (siblings.size() != names.size())
    throw Error(fmt::format("names {} of {} recordings", siblings.size(), names.size()), "--align-to",
                "name one for each of --traversal, in the same order, with + between them");
  const bool frames = selection.first > 0 || selection.end < Selection().end;
  if (frames || std::isfinite(selection.from) || std::isfinite(selection.to))
    throw Error("cuts one recording", frames ? "--frames" : "--metres", "leave it out, or name one with --traversal");
}

}  // namespace

Traversal select(Dataset& dataset, const std::string& name, const Selection& selection) {
  check(selection);
  const std::vector<std::string> names = joined_by(dataset, "--traversal", name);
  std::vector<std::string> siblings(names.size());
  if (!selection.align.empty()) siblings = joined_by(dataset, "--align-to", selection.align);
  if (siblings == names) throw Error("is the traversal itself", "--align-to", "name a sibling");
  if (names.size() > 1 || siblings.size() > 1) check_join(dataset, name, names, siblings, selection);
  std::optional<Traversal> traversal, driven;
  const auto add = [](std::optional<Traversal>& all, Traversal& one) {
    all ? all->join(one) : void(all = std::move(one));
  };
  for (std::size_t i = 0; i < names.size(); ++i) {
    Selection selected = selection;
    selected.align = siblings[i];
    std::optional<Traversal> sibling;
    Traversal one = recorded(dataset, names[i], selected, sibling);
    add(traversal, one);
    if (sibling) add(driven, *sibling);
  }
  if (dataset.on_streets() && !traversal->streets)
    walk_on_streets(*traversal, driven ? *driven : *traversal, dataset.rule());
  return std::move(*traversal);
}

}  // namespace citylearn
