// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>

#include "core/util/random.h"
#include "core/wire/messages.h"
#include "env_service/dataset_io/dataset.h"
#include "env_service/drawn_city/drawn_images.h"
#include "env_service/traversal/street_views.h"

// The same bits on every machine: whole-number random lanes, + - * / and square roots, which IEEE 754 rounds in one
// way, and no fused multiply-add (this file is compiled with -ffp-contract=off). Nothing of libm but sqrt.

namespace citylearn {
namespace {

// Shares and decays below are fitted to NetVLAD features, reduced to 64-d, of 1,000 frames of the Nordland railway in
// summer and fall: distances between neighbours 1 to 40 frames apart, between conditions at one place and at different
// places, the spectrum, and how the difference between the conditions is correlated along the route.

/// Changes of the places under one condition. Variances are per frame, of vectors whose squared length is 1 in summer.
struct Condition {
  const char* name;
  double own;    ///< variance that this condition does not share with the others
  double shift;  ///< length of its shift of all frames
};
constexpr std::array<Condition, 4> kConditions{{
    {"summer", 0.136, 0.14},
    {"fall", 0.100, 0.14},
    {"winter", 0.220, 0.20},
    {"night", 0.360, 0.30},
}};
constexpr double kShared = 0.190;  // variance of what a place shows under every condition
constexpr double kMean = 0.74;     // length of the mean vector
constexpr double kCut = 0.10;      // a scene ends here: tunnel, station, bend. Probability per frame

constexpr double kFeatureSpacing = 10;  // metres between frames, as on the recordings

constexpr int kStreets = 8, kBlock = 4;                  // streets each way of a city of streets; links of a block
constexpr int kStreetLinks = (kStreets - 1) * kBlock;    // of a street, one way
constexpr int kViews = 2 * 2 * kStreets * kStreetLinks;  // of a city of streets: each link is one

constexpr double kTunnel = 0.05;      // a tunnel begins here. Probability per frame
constexpr double kTunnelEnds = 0.45;  // its length is geometric
constexpr double kDark = 0.95;        // length of what all tunnels have in common

/// Returns a standard normal number, except for its tails (twelve uniform numbers of 16 bits: none beyond 6).
double normal(Random& random) {
  std::int64_t sum = 0;
  for (int draw = 0; draw < 3; ++draw)
    for (std::uint64_t lanes = random.next(), lane = 0; lane < 4; ++lane, lanes >>= 16) sum += lanes & 0xFFFF;
  return static_cast<double>(sum - 6 * 65535) / 65536.0;
}

using Vector = std::vector<double>;

/// Variance 1 in every direction, correlation decay^n over n frames.
class Drift {
 public:
  Drift(int dimension, double decay) : state_(dimension), decay_(decay), innovation_(std::sqrt(1 - decay * decay)) {}
  /// Goes to the next frame; a fresh start has nothing in common with the frame before.
  void step(Random& random, bool fresh) {
    for (double& value : state_) {
      const double noise = normal(random);
      value = fresh || first_ ? noise : decay_ * value + innovation_ * noise;
    }
    first_ = false;
  }
  double operator[](int k) const { return state_[k]; }

 private:
  Vector state_;
  double decay_, innovation_;
  bool first_ = true;
};

/// Returns standard deviations by direction, squares adding up to 1: few strong directions and many weak ones.
Vector spectrum(int dimension, double slope) {
  Vector values(dimension);
  double sum = 0;
  for (int k = 0; k < dimension; ++k) {
    const double order = 64.0 * k / dimension;
    values[k] = (1 - order / 64) / std::sqrt(1 + slope * order);
    sum += values[k];
  }
  for (double& value : values) value = std::sqrt(value / sum);
  return values;
}

/// An orthogonal mixture of all components: random signs, then a butterfly over every bit of the index, twice.
class Mixture {
 public:
  Mixture(int dimension, Random random) : signs_(2, Vector(dimension)) {
    for (Vector& signs : signs_)
      for (double& sign : signs) sign = random.below(2) == 0 ? 1 : -1;
  }
  void apply(Vector& x) const {
    const std::size_t size = x.size();
    const double half = std::sqrt(0.5);
    for (const Vector& signs : signs_) {
      for (std::size_t k = 0; k < size; ++k) x[k] *= signs[k];
      for (std::size_t bit = 1; bit < size; bit *= 2)
        for (std::size_t k = 0; k < size; ++k) {
          if (k & bit || k + bit >= size) continue;
          const double a = x[k], b = x[k + bit];
          x[k] = (a + b) * half;
          x[k + bit] = (a - b) * half;
        }
    }
  }

 private:
  std::vector<Vector> signs_;
};

Vector direction(int dimension, double length, Random random) {
  Vector vector(dimension);
  double sum = 0;
  for (double& value : vector) {
    value = normal(random);
    sum += value * value;
  }
  for (double& value : vector) value *= length / std::sqrt(sum);
  return vector;
}

/// Returns a grid of streets, link after link of each street and of its other side.
StreetMap grid(double spacing) {
  StreetMap map;
  std::map<std::pair<int, int>, std::uint32_t> places;
  const auto place = [&](int east, int north) {
    const auto [at, added] = places.try_emplace({east, north}, static_cast<std::uint32_t>(places.size()));
    if (added) {
      map.east.push_back(static_cast<float>(east * spacing));
      map.north.push_back(static_cast<float>(north * spacing));
    }
    return at->second;
  };
  for (int direction = 0; direction < 4; ++direction)  // north, east, south, west
    for (int street = 0; street < kStreets; ++street)
      for (int link = 0; link < kStreetLinks; ++link) {
        const auto at = [&](int done) {
          const int along = direction < 2 ? done : kStreetLinks - done, across = street * kBlock;
          return direction % 2 ? place(along, across) : place(across, along);
        };
        map.from.push_back(at(link));
        map.to.push_back(at(link + 1));
        map.heading.push_back(90.0f * static_cast<float>(direction));
      }
  return map;
}

/// A generated route, as pictures or as features under four conditions. A place of features is what all conditions
/// share plus what each has of its own; both drift along the route, and have a part that belongs to the single frame.
class Synthetic : public Dataset {
 public:
  explicit Synthetic(const Parameters& parameters)
      : frames_(parameters.integer("frames")),
        dimension_(parameters.integer("dimension")),
        seed_(static_cast<std::uint64_t>(parameters["seed"])),
        images_(parameters.flag("images")),
        spacing_(parameters["spacing"]) {
    drawn_.width = parameters.integer("width");
    drawn_.height = parameters.integer("height");
    drawn_.seed = seed_;
    drawn_.countryside = parameters["countryside"];
    drawn_.viewpoint = parameters["viewpoint"];
  }

  /// Returns the names. The first four go from the easiest to the hardest.
  std::vector<std::string> names() override {
    if (images_) return drawn_names();
    std::vector<std::string> names;
    for (const Condition& condition : kConditions) names.push_back(condition.name);
    return names;
  }

  Traversal load(const std::string& name) override {
    const std::vector<std::string> known = names();
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end()) throw unknown_traversal(name, "dataset synthetic", known);
    Traversal traversal = images_ ? draw(name) : generate(static_cast<std::size_t>(found - known.begin()));
    if (on_streets()) show_streets(traversal);
    return traversal;
  }

 private:
  enum Stream : std::uint64_t {
    kMeanStream = 1,
    kMixtureStream,
    kPlaceStream,
    kWayStream,
    kShiftStream,
    kOwnStream,
    kDarkStream
  };
  // Seed 1 of this family of cities is about as hard as the real route; single cities differ a good deal.
  Random stream(Stream purpose, std::uint64_t condition = 0) const { return Random{11, seed_, purpose, condition}; }

  /// Returns metres along the route, about `spacing` apart; the same under every condition.
  std::vector<float> drive(double spacing) const {
    std::vector<float> positions;
    positions.reserve(static_cast<std::size_t>(frames()));
    Random way = stream(kWayStream);
    double metres = 0, speed = 0;
    for (int i = 0; i < frames(); ++i) {
      positions.push_back(static_cast<float>(metres));
      speed = 0.95 * speed + 0.05 * (2 * way.uniform() - 1);  // -1..1
      metres += spacing * (1 + speed);
    }
    return positions;
  }

  int frames() const { return on_streets() ? kViews : frames_; }

  /// Makes the frames of a drive through all streets, one way and the other, the views along the links of their grid.
  void show_streets(Traversal& traversal) const {
    if (rule_ != StateRule::kStreet) throw Error("the drawn city is seen along its links", "--rule", "take street");
    auto map = std::make_shared<StreetMap>(grid(images_ ? spacing_ : kFeatureSpacing));
    const std::vector<std::uint32_t> drive = map->put_in_order();
    show_along_links(traversal, std::move(map), {drive.begin(), drive.end()});
  }

  Traversal draw(const std::string& name) const {
    Traversal traversal;
    traversal.dataset = "synthetic";
    traversal.name = traversal.condition = name;
    traversal.frames = frames();
    traversal.positions = drive(spacing_);
    traversal.images = drawn_images(drawn_, name, traversal.positions);
    return traversal;
  }

  Traversal generate(std::size_t index) const {
    const Condition& condition = kConditions[index];
    Traversal traversal;
    traversal.dataset = "synthetic";
    traversal.name = traversal.condition = condition.name;
    traversal.frames = frames();
    traversal.dimension = dimension_;
    traversal.features.reserve(static_cast<std::size_t>(frames()) * dimension_);
    traversal.positions = drive(kFeatureSpacing);

    const Vector deviation = spectrum(dimension_, 2.8), own_deviation = spectrum(dimension_, 0.6);
    const Mixture mixture(dimension_, stream(kMixtureStream));
    const Vector mean = direction(dimension_, kMean, stream(kMeanStream));
    const Vector shift = direction(dimension_, condition.shift, stream(kShiftStream, index));
    const Vector dark = direction(dimension_, kDark, stream(kDarkStream));
    Random place = stream(kPlaceStream), own = stream(kOwnStream, index);
    Drift scene(dimension_, 0.943), view(dimension_, 0.61), frame(dimension_, 0);  // last long, some frames, one frame
    Drift season(dimension_, 0.926), instant(dimension_, 0);
    // Shares of the variance.
    const double from_scene = std::sqrt(kShared * 0.30), from_view = std::sqrt(kShared * 0.40);
    const double from_frame = std::sqrt(kShared * 0.30);
    const double from_season = std::sqrt(condition.own * 0.30), from_instant = std::sqrt(condition.own * 0.70);
    double strength = 1;
    bool tunnel = false;
    Vector x(dimension_);
    for (int i = 0; i < frames(); ++i) {
      const bool cut = place.uniform() < kCut;
      tunnel = place.uniform() < (tunnel ? 1 - kTunnelEnds : kTunnel);
      if (cut) strength = 0.4 + 1.1 * place.uniform();
      scene.step(place, cut && place.uniform() < 0.5);
      view.step(place, cut);
      frame.step(place, true);
      season.step(own, false);
      instant.step(own, true);
      for (int k = 0; k < dimension_; ++k)
        x[k] = deviation[k] * (from_scene * scene[k] + strength * (from_view * view[k] + from_frame * frame[k])) +
               own_deviation[k] * (from_season * season[k] + from_instant * instant[k]);
      mixture.apply(x);
      double sum = 0;
      for (int k = 0; k < dimension_; ++k) {
        x[k] += mean[k] + shift[k] + (tunnel ? dark[k] : 0);
        sum += x[k] * x[k];
      }
      const double length = std::sqrt(sum);
      for (const double value : x) traversal.features.push_back(static_cast<float>(value / length));
    }
    return traversal;
  }

  int frames_, dimension_;
  std::uint64_t seed_;
  bool images_;
  double spacing_;
  DrawnOptions drawn_;
};

const DatasetRegistry::Registration synthetic_registration({
    "synthetic",
    "a generated route: pictures of a drive under seven conditions, or features like real ones under four; with --rule "
    "street a grid of 8 x 8 streets",
    {{"frames", "frames of the route; streets have their own", 1000, 2, msg::MAX_FRAMES, true},
     {"dimension", "features a frame, without images", 64, 8, kMaxDimension, true},
     {"seed", "seed of the city", 1, 0, 1e9, true},
     {"images", "1: draws pictures, for an encoder_service; 0: generates features, 10 m apart", 1, 0, 1, true},
     {"spacing", "metres between pictures, on average", 4, 0.05, 10, false},
     {"width", "pixels of a picture's width", 160, 32, 1024, true},
     {"height", "pixels of a picture's height", 96, 32, 1024, true},
     {"countryside", "share of the route outside of the city", 0.35, 0, 1, false},
     {"viewpoint", "metres by which the camera of 'shifted' drives further left", 1.5, -2, 4, false}},
    [](const Parameters& parameters, const std::string& folder) {
      if (!folder.empty())
        throw Error("reads no folder", "dataset synthetic", "leave --data out, or give --dataset plain");
      return std::make_unique<Synthetic>(parameters);
    },
});

}  // namespace
}  // namespace citylearn
