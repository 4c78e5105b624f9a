// SPDX-License-Identifier: Apache-2.0
#include "places.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "core/util/error.h"
#include "env_service/geometry/geometry.h"
#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

constexpr double kFixError = 100, kPoseError = 10;  // metres that a place may be off
constexpr double kMaxSpeedRatio = 25;               // to the usual speed
constexpr double kStrained = 0.3;                   // of the farthest way that is possible
constexpr double kSimulatedExtent = 10'000;         // metres around 0, 0
constexpr double kMaxJump = 30'000;                 // metres; zones of UTM are farther apart
constexpr std::size_t kMaxJumps = 3, kMinCopies = 4, kMinKnown = 5, kMaxLookBack = 50;

/// The known places of a drive, of which it forgets those that cannot be.
class DriveCheck {
 public:
  explicit DriveCheck(const Places& places) : places_(places) {
    bool timed = places.times.size() == places.a.size();
    for (std::size_t row = 0; row < places.a.size(); ++row)
      if (std::isfinite(places.a[row]) && std::isfinite(places.b[row])) {
        all_.push_back(
            {row, places.a[row], places.b[row], timed ? places.times[row] : 0,
             places.on_earth ? on_earth(places.a[row], places.b[row]) : Point{places.a[row], places.b[row]}});
        timed = timed && (all_.size() == 1 ? std::isfinite(all_[0].time) : all_.back().time >= all_.end()[-2].time);
      }
    for (Place& place : all_)
      if (!timed) place.time = static_cast<double>(place.row);
    kept_ = all_;
  }

  std::vector<std::size_t> check() {
    if (places_.on_earth) forget_null_island();
    const std::size_t fixes = kept_.size();
    std::vector<std::size_t> jumps;
    if (fixes >= kMinKnown) {
      measure_speed();
      forget_copies();
      jumps = forget_stretches();
    }
    if (forgotten_.empty()) return jumps;
    const auto& [first, why] = *forgotten_.begin();
    const std::string text = fmt::format("{} of {} {} are ignored, the first {}: {}", forgotten_.size(), all_.size(),
                                         places_.what, places_.name(first), why);
    if ((fixes - kept_.size()) * 4 > fixes) throw Error(text, places_.where, "these are too many: mend or remove them");
    spdlog::warn("{}: {}", places_.where, text);
    fill();
    return jumps;
  }

 private:
  struct Place {
    std::size_t row;
    double a, b, time;
    Point point;
  };
  static double metres(const Place& from, const Place& to) { return metres_between(from.point, to.point); }
  /// Returns the way from one place to another, in parts of the farthest that is possible.
  double strain(const Place& from, const Place& to) const {
    const double error = places_.on_earth ? kFixError : kPoseError;
    return metres(from, to) / std::max(error, kMaxSpeedRatio * speed_ * (to.time - from.time));
  }
  std::string apart(const Place& from, const Place& to) const {
    return fmt::format("{:.3f} km lie between {} and {}",
                       (places_.on_earth ? metres_between(from.a, from.b, to.a, to.b) : metres(from, to)) / 1000,
                       places_.name(from.row), places_.name(to.row));
  }

  template <class Why>
  void forget(const std::vector<bool>& bad, Why why) {
    std::vector<Place> kept;
    for (std::size_t i = 0; i < kept_.size(); ++i)
      bad[i] ? void(forgotten_.emplace(kept_[i].row, why(i))) : kept.push_back(kept_[i]);
    kept_ = std::move(kept);
  }

  /// Puts what was forgotten between the places around, where these are near.
  void fill() {
    auto next = kept_.begin();
    for (const Place& place : all_) {
      while (next != kept_.end() && next->row < place.row) ++next;
      if (!forgotten_.contains(place.row)) continue;
      double &a = places_.a[place.row], &b = places_.b[place.row];
      a = b = std::nan("");
      if (next == kept_.begin() || next == kept_.end() || metres(next[-1], *next) > kFixError) continue;
      const double share = (place.time - next[-1].time) / (next->time - next[-1].time), aside = next->b - next[-1].b;
      a = next[-1].a + share * (next->a - next[-1].a);
      b = next[-1].b + share * (places_.on_earth ? std::remainder(aside, 360) : aside);
      if (places_.on_earth) b = std::remainder(b, 360);
    }
  }

  void forget_null_island() {
    bool simulated = false, small = true;
    std::vector<bool> zero;
    for (const Place& place : kept_) {
      if (std::abs(place.a) > 90 || std::abs(place.b) > 180)
        throw Error(fmt::format("{} is at {}, {}: not a latitude and a longitude in degrees", places_.name(place.row),
                                place.a, place.b),
                    places_.where);
      zero.push_back(place.a == 0 && place.b == 0);
      simulated = simulated || (!zero.back() && metres_between(on_earth(0, 0), place.point) < kSimulatedExtent);
      small = small && std::abs(place.a) <= std::numbers::pi / 2 && std::abs(place.b) <= std::numbers::pi;
    }
    if (simulated) return;
    forget(zero, [](std::size_t) { return "0, 0 is not a fix"; });
    if (small && !kept_.empty())
      throw Error("all " + places_.what + " are in the sea off Africa", places_.where, "give degrees, not radians");
  }

  void measure_speed() {
    std::vector<double> speeds;
    const auto speed = [&](std::size_t i, std::size_t j) {
      return metres(kept_[i], kept_[j]) / (kept_[j].time - kept_[i].time);
    };
    for (std::size_t i = 2; i < kept_.size(); ++i)
      if (const double least = std::min(speed(i - 2, i - 1), speed(i - 2, i)); least > 0 && std::isfinite(least))
        speeds.push_back(least);
    if (speeds.empty()) return;
    // Below the median, as a wrong place makes several speeds wrong.
    const auto usual = speeds.begin() + static_cast<std::ptrdiff_t>((speeds.size() - 1) * 2 / 5);
    std::nth_element(speeds.begin(), usual, speeds.end());
    speed_ = *usual;
  }

  void forget_copies() {
    std::vector<bool> copy(kept_.size());
    for (std::size_t first = 0, next = 1; next < kept_.size(); ++next) {
      const Place &before = kept_[next - 1], &here = kept_[next];
      const double step = metres(before, here), usual = speed_ * (here.time - kept_[first].time);
      if (step == 0) continue;
      if (next - first > kMinCopies && step > 0.6 * usual && step < 3 * usual &&
          step > 3 * speed_ * (here.time - before.time))
        std::fill_n(copy.begin() + static_cast<std::ptrdiff_t>(first + 1), next - first - 1, true);
      first = next;
    }
    forget(copy, [](std::size_t) { return "the place before was copied until it jumps on"; });
  }

  std::vector<std::size_t> forget_stretches() {
    std::vector<std::size_t> begins;  // of stretches without a jump
    for (std::size_t i = 0; i < kept_.size(); ++i)
      if (i == 0 || strain(kept_[i - 1], kept_[i]) > kStrained) begins.push_back(i);
    const std::size_t count = begins.size();
    begins.push_back(kept_.size());
    // Finds the chain of stretches with the most places, of which each jump costs a tenth, and one place there and back
    // between two strained ways is not worth these. `best` has the worth of the best chain to a stretch, and the
    // stretch before it or itself.
    const auto cost = [&](const Place& from, const Place& to) {
      const double way = strain(from, to);
      return way > 1 ? std::max(3.0, static_cast<double>(kept_.size()) / 10) : way > kStrained ? 0.6 : 0;
    };
    std::vector<std::pair<double, std::size_t>> best(count);
    for (std::size_t i = 0; i < count; ++i) {
      best[i] = {0, i};
      for (std::size_t j = i - std::min(i, kMaxLookBack); j < i; ++j)
        best[i] = std::max(best[i], {best[j].first - cost(kept_[begins[j + 1] - 1], kept_[begins[i]]), j});
      best[i].first += static_cast<double>(begins[i + 1] - begins[i]);
    }
    std::vector<bool> bad(kept_.size(), true);
    std::vector<std::size_t> jumps;
    double farthest = 0;
    std::string text;
    auto i = static_cast<std::size_t>(std::max_element(best.begin(), best.end()) - best.begin());
    for (bool more = true; more; i = best[i].second) {
      for (std::size_t place = begins[i]; place < begins[i + 1]; ++place) bad[place] = false;
      more = best[i].second != i;
      const Place &last = kept_[begins[best[i].second + 1] - 1], &next = kept_[begins[i]];
      if (!more || strain(last, next) <= 1) continue;
      jumps.push_back(next.row);
      if (metres(last, next) > farthest) text = apart(last, next);
      farthest = std::max(farthest, metres(last, next));
    }
    if (jumps.size() > kMaxJumps || farthest > kMaxJump)
      throw Error(text, places_.where, "mend the places; do units, signs or zones of UTM change?");
    if (!jumps.empty() && places_.warns_of_jumps) spdlog::warn("{}: {}", places_.where, text);
    const auto good = static_cast<std::size_t>(std::find(bad.begin(), bad.end(), false) - bad.begin());
    forget(bad,
           [&](std::size_t at) { return at > 0 ? apart(kept_[at - 1], kept_[at]) : apart(kept_[at], kept_[good]); });
    return jumps;
  }

  const Places& places_;
  std::vector<Place> all_, kept_;
  std::map<std::size_t, std::string> forgotten_;  ///< row, and why
  double speed_ = 0;                              ///< metres a second
};

}  // namespace

std::vector<std::size_t> forget_impossible(const Places& places) { return DriveCheck(places).check(); }

void fill_heights(std::vector<double>& metres) {
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < metres.size(); ++i)
    if (is_height(metres[i])) known.push_back(i);
  if (known.empty()) return metres.clear();
  std::fill_n(metres.begin(), known.front(), metres[known.front()]);
  for (std::size_t k = 0; k + 1 < known.size(); ++k) {
    const std::size_t from = known[k], to = known[k + 1];
    for (std::size_t i = from + 1; i < to; ++i)
      metres[i] = std::lerp(metres[from], metres[to], static_cast<double>(i - from) / static_cast<double>(to - from));
  }
  std::fill(metres.begin() + static_cast<std::ptrdiff_t>(known.back()), metres.end(), metres[known.back()]);
}

void forget_impossible(Traversal& traversal, const std::string& folder) {
  const std::string where = folder + ": traversal '" + traversal.name + "'";
  const auto name = [&traversal](std::size_t row) {
    const std::string frame = "frame " + std::to_string(row);
    return traversal.images ? frame + " (" + traversal.images->name(static_cast<int>(row)) + ")" : frame;
  };
  const auto check = [&](std::vector<double>& a, std::vector<double>& b, bool on_earth) {
    if (a.empty() || a.size() != b.size()) return false;
    const auto along = [&] { return on_earth ? metres_along(a, b) : metres_along_plane(a, b, traversal.height); };
    const std::vector<float> before = along();
    const bool measured =
        std::equal(before.begin(), before.end(), traversal.positions.begin(), traversal.positions.end(),
                   [](float x, float y) { return x == y || (std::isnan(x) && std::isnan(y)); });
    forget_impossible({a, b, traversal.times, on_earth, where, "places", name});
    if (measured) traversal.positions = along();
    return measured;
  };
  const bool from_earth = check(traversal.latitude, traversal.longitude, true);
  if (check(traversal.x, traversal.y, false) || from_earth) return;
  std::vector<double> metres(traversal.positions.begin(), traversal.positions.end()), line(metres.size());
  forget_impossible({metres, line, traversal.times, false, where, "positions", name});
  traversal.positions.assign(metres.begin(), metres.end());
}

}  // namespace citylearn
