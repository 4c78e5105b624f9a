// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/world.h"

#include <algorithm>
#include <cmath>

namespace citylearn::drawn {
namespace {

float in(Random& random, double low, double high) { return static_cast<float>(low + (high - low) * random.uniform()); }

float lattice(std::uint64_t stream, std::int64_t x, std::int64_t y) {
  const std::uint64_t bits = mix_seeds({stream, static_cast<std::uint64_t>(x), static_cast<std::uint64_t>(y)});
  return static_cast<float>(bits >> 40) * 0x1p-23f - 1;
}
float ease(float t) { return t * t * t * (t * (t * 6 - 15) + 10); }

constexpr std::size_t kMaxCachedCells = 256;
// What a stream of random numbers decides.
enum Purpose { kBuilding = 1, kYard, kCars, kFurniture, kFields, kPlan };
enum Field : std::uint64_t { kBend = 31, kCurve, kTown, kQuarter };

}  // namespace

float noise(std::uint64_t stream, float x) {
  const float base = std::floor(x), share = ease(x - base);
  const auto k = static_cast<std::int64_t>(base);
  const float a = lattice(stream, k, 0), b = lattice(stream, k + 1, 0);
  return a + (b - a) * share;
}

float noise(std::uint64_t stream, float x, float y) {
  const float left = std::floor(x), top = std::floor(y), u = ease(x - left), v = ease(y - top);
  const auto i = static_cast<std::int64_t>(left), j = static_cast<std::int64_t>(top);
  const float a = lattice(stream, i, j), b = lattice(stream, i + 1, j);
  const float c = lattice(stream, i, j + 1), d = lattice(stream, i + 1, j + 1);
  return a + (b - a) * u + (c - a + (a - b - c + d) * u) * v;
}

World::World(const DrawnOptions& options, const Look& look, std::uint64_t look_index)
    : options_(options), look_(look), look_index_(look_index), painter_(look, options.seed) {}

Random World::shape(long cell, int side, int purpose) const {
  return Random{23, options_.seed, static_cast<std::uint64_t>(cell), static_cast<std::uint64_t>(side),
                static_cast<std::uint64_t>(purpose)};
}
Random World::mood(long cell, int side, int purpose) const {
  return Random{24,
                options_.seed,
                static_cast<std::uint64_t>(cell),
                static_cast<std::uint64_t>(side),
                static_cast<std::uint64_t>(purpose),
                look_index_};
}

float World::heading(float s) const {
  return 1.1f * noise(mix_seeds({kBend, options_.seed}), s / 260) +
         0.3f * noise(mix_seeds({kCurve, options_.seed}), s / 90);
}

Zone World::zone(long cell) const {
  // Stretches of about 130 m; the share of them is uniform in each rank.
  const long stretch = cell >= 0 ? cell / 11 : (cell - 10) / 11;
  const auto rank = [&](std::uint64_t field) {
    return 0.5f + 0.5f * lattice(mix_seeds({field, options_.seed}), stretch, 0);
  };
  if (rank(kTown) < static_cast<float>(options_.countryside)) return Zone::kCountry;
  const float quarter = rank(kQuarter);
  return quarter < 0.45f ? Zone::kCentre : quarter < 0.85f ? Zone::kSuburb : Zone::kPark;
}

const Cell& World::cell(long index) {
  if (const auto known = cells_.find(index); known != cells_.end()) {
    recent_.splice(recent_.begin(), recent_, known->second);
    return known->second->second;
  }
  if (recent_.size() >= kMaxCachedCells) {
    cells_.erase(recent_.back().first);
    recent_.pop_back();
  }
  recent_.emplace_front(index, make(index));
  cells_[index] = recent_.begin();
  return recent_.front().second;
}

Cell World::make(long index) const {
  Cell cell;
  cell.zone = zone(index);
  Random plan = shape(index, 0, kPlan);
  cell.crossing = cell.zone != Zone::kCountry && plan.uniform() < 0.09;
  for (const int side : {0, 1}) {
    static const std::array<Colour, 5> kGrowth{
        {{52, 118, 84}, {70, 150, 120}, {96, 186, 206}, {70, 100, 120}, {60, 136, 96}}};
    Random fields = shape((index + 4096 * 8) / 8, side, kFields);
    Colour growth = kGrowth[fields.below(kGrowth.size())];
    if (look_.leaves == 1) growth = growth * 0.55f + Colour(40, 74, 92) * 0.5f;
    if (look_.leaves == 2) growth = growth * 0.3f + Colour(80, 100, 110) * 0.6f;
    cell.field[static_cast<std::size_t>(side)] = growth;
    switch (cell.zone) {
      case Zone::kCentre:
        centre(cell, index, side);
        break;
      case Zone::kSuburb:
        suburb(cell, index, side);
        break;
      case Zone::kPark:
      case Zone::kCountry:
        green(cell, index, side);
        break;
    }
    roadside(cell, index, side);
  }
  lay_ground(cell);
  std::sort(cell.things.begin(), cell.things.end(), [](const Thing& a, const Thing& b) {
    if (a.s != b.s) return a.s > b.s;
    return std::abs(a.lateral) > std::abs(b.lateral);
  });
  return cell;
}

void World::lay_ground(Cell& cell) const {
  const bool country = cell.zone == Zone::kCountry;
  const Colour snow{246, 241, 238}, asphalt = country ? Colour(98, 100, 104) : Colour(88, 88, 92);
  Colour lawn = cell.zone == Zone::kCentre ? Colour(112, 118, 122) : Colour(58, 132, 92);
  if (cell.zone != Zone::kCentre && look_.leaves == 1) lawn = {66, 128, 130};
  if (cell.zone != Zone::kCentre && look_.leaves == 2) lawn = {84, 116, 116};
  for (int k = 0; k < 2 * kGroundReach * kGroundSteps; ++k) {
    const float lateral = (static_cast<float>(k) + 0.5f) / kGroundSteps - kGroundReach, away = std::abs(lateral);
    Colour colour = lawn;
    float cover = look_.snow, mirrors = 0.15f;
    if (away < 3.5f) {
      const float track = std::abs(away - 1.7f);  // wheels run at 0.75 m of the lane's middle
      cover *= std::abs(track - 0.75f) < 0.3f ? 0.12f : 0.5f;
      colour = away > 3.2f && away < 3.36f ? Colour(210, 215, 215) : asphalt;
      mirrors = 1;
    } else if (!country && away < 3.75f) {
      colour = {150, 154, 156};
      mirrors = 0.6f;
    } else if (!country && away < 6.6f) {
      colour = Colour(134, 142, 148) * (static_cast<int>(away * 2) % 2 == 0 ? 1.f : 0.96f);
      cover *= 0.85f;
      mirrors = 0.7f;
    } else if (country && away > 6) {
      const float furrow = static_cast<int>(away * 1.2f) % 2 == 0 ? 1.f : 0.9f;
      colour = cell.field[lateral < 0 ? 0 : 1] * furrow;
    }
    colour += (snow - colour) * cover;
    if (look_.wet > 0) colour *= 0.72f;
    cell.ground.push_back({cv::saturate_cast<uchar>(colour[0]), cv::saturate_cast<uchar>(colour[1]),
                           cv::saturate_cast<uchar>(colour[2]), cv::saturate_cast<uchar>(1 + 254 * mirrors)});
  }
}

void World::centre(Cell& cell, long index, int side) const {
  const float hand = side == 0 ? -1.f : 1.f, s = static_cast<float>(index) * kCell;
  Random random = shape(index, side, kBuilding);
  if (random.uniform() < 0.12) {  // a side street, a yard
    Thing tree{Thing::kUpright, s + 6, 0, hand * in(random, 11, 16), 6, 0, in(random, 6, 9), 1, nullptr};
    tree.skin = painter_.tree(random);
    cell.things.push_back(tree);
    return;
  }
  const float front = in(random, 7.6, 9.2), height = random.uniform() < 0.15 ? in(random, 20, 28) : in(random, 8.5, 19);
  const float from = random.uniform() < 0.25 ? in(random, 0.5, 2.5) : 0.f;
  const Random look_of_it(random.next());
  Thing wall{Thing::kAlong, s + from, s + kCell, hand * front, hand * front, 0, height, 1, nullptr};
  wall.skin = painter_.building(kCell - from, height, look_of_it, mood(index, side, kBuilding));
  Thing end{
      Thing::kAcross, s + from, 0, hand * (front + 14), hand * front, 0, height, 1, painter_.gable(false, look_of_it)};
  cell.things.push_back(end);
  cell.things.push_back(wall);
  cell.front[static_cast<std::size_t>(side)] = front;
  cell.roof[static_cast<std::size_t>(side)] = height;
  if (random.uniform() < 0.3) {
    Thing tree{Thing::kUpright, s + in(random, 3, 9), 0, hand * in(random, 5.4, 6.2), 0, 0, in(random, 4.5, 7), 1,
               nullptr};
    tree.lateral_end = tree.top * 0.9f;
    tree.skin = painter_.tree(random);
    cell.things.push_back(tree);
  }
}

void World::suburb(Cell& cell, long index, int side) const {
  const float hand = side == 0 ? -1.f : 1.f, s = static_cast<float>(index) * kCell;
  Random random = shape(index, side, kBuilding);
  if (random.uniform() < 0.85) {
    const float front = in(random, 11, 15), width = in(random, 7.5, 11), height = in(random, 6, 9.5);
    const float from = in(random, 0.3, kCell - width);
    const Random look_of_it(random.next());
    cell.things.push_back({Thing::kAcross, s + from, 0, hand * (front + 8), hand * front, 0, height * 0.85f, 1,
                           painter_.gable(true, look_of_it)});
    Thing wall{Thing::kAlong, s + from, s + from + width, hand * front, hand * front, 0, height, 1, nullptr};
    wall.skin = painter_.house(width, height, look_of_it, mood(index, side, kBuilding));
    cell.things.push_back(wall);
    cell.front[static_cast<std::size_t>(side)] = front;
    cell.roof[static_cast<std::size_t>(side)] = height * 0.7f;
  }
  const double border = random.uniform();
  if (border < 0.75) {
    const bool hedge = border < 0.4;
    cell.things.push_back({Thing::kAlong, s + (random.uniform() < 0.5 ? 3.f : 0.f), s + kCell, hand * 6.6f, hand * 6.6f,
                           0, hedge ? in(random, 1, 1.7) : 1.1f, 1, hedge ? painter_.hedge() : painter_.fence()});
  }
  for (int tree = static_cast<int>(random.below(3)); tree-- > 0;) {
    Thing thing{Thing::kUpright,  s + in(random, 0, kCell), 0,      hand * in(random, 7.2, 11), 0, 0,
                in(random, 4, 9), in(random, 0.8, 1.1),     nullptr};
    thing.lateral_end = thing.top * 0.95f;
    thing.skin = painter_.tree(random);
    cell.things.push_back(thing);
  }
}

void World::green(Cell& cell, long index, int side) const {
  const float hand = side == 0 ? -1.f : 1.f, s = static_cast<float>(index) * kCell;
  const bool park = cell.zone == Zone::kPark;
  Random random = shape(index, side, kYard), fields = shape((index + 4096 * 8) / 8, side, kFields);
  fields.next();
  const double wooded = park ? 0.75 : fields.uniform();  // the stretch: open fields, scattered trees, forest
  const int trees = wooded > 0.66  ? 2 + static_cast<int>(random.below(4))
                    : wooded > 0.3 ? static_cast<int>(random.below(3))
                                   : static_cast<int>(random.below(5)) / 4;
  const bool needles = !park && fields.uniform() < 0.5;
  for (int tree = 0; tree < trees; ++tree) {
    const bool conifer = needles && random.uniform() < 0.8;
    const float near = tree == 0 ? 7.f : 9.f;
    Thing thing{Thing::kUpright,   s + in(random, 0, kCell), 0,      hand * in(random, near, near + 13), 0, 0,
                in(random, 6, 12), in(random, 0.75, 1.1),    nullptr};
    thing.lateral_end = thing.top * (conifer ? 0.55f : 0.95f);
    thing.skin = conifer ? painter_.conifer(random) : painter_.tree(random);
    cell.things.push_back(thing);
  }
  for (int bush = static_cast<int>(random.below(3)); bush-- > 0;) {
    const float size = in(random, 1, 2.2);
    cell.things.push_back({Thing::kUpright, s + in(random, 0, kCell), 0, hand * in(random, 5.8, 9), size * 1.6f, 0,
                           size, 1, painter_.bush(random)});
  }
  if (fields.uniform() < 0.4)
    cell.things.push_back({Thing::kAlong, s, s + kCell, hand * 5.8f, hand * 5.8f, 0, 1.1f, 1, painter_.fence()});
  if (!park && random.uniform() < 0.09) {
    const float front = in(random, 12, 24), width = in(random, 9, 11.5), height = in(random, 6.5, 9);
    const Random look_of_it(random.next());
    cell.things.push_back({Thing::kAcross, s, 0, hand * (front + 9), hand * front, 0, height * 0.85f, 1,
                           painter_.gable(true, look_of_it)});
    cell.things.push_back({Thing::kAlong, s, s + width, hand * front, hand * front, 0, height, 1,
                           painter_.house(width, height, look_of_it, mood(index, side, kBuilding))});
  }
}

void World::roadside(Cell& cell, long index, int side) const {
  const float hand = side == 0 ? -1.f : 1.f, s = static_cast<float>(index) * kCell;
  const bool country = cell.zone == Zone::kCountry;
  Random random = shape(index, side, kFurniture), mood_now = mood(index, side, kCars);
  if (!country && (index + side) % 2 == 0)
    cell.things.push_back({Thing::kUpright, s + 1, 0, hand * 4.1f, hand * 2.6f, 0, 6.2f, 1, painter_.lamp()});
  if (country && side == 1 && index % 3 == 0)
    cell.things.push_back({Thing::kUpright, s + 4, 0, hand * 5.2f, 1.9f, 0, 7.5f, 1, painter_.pole()});
  if (random.uniform() < (country ? 0.08 : 0.22))
    cell.things.push_back({Thing::kUpright, s + in(random, 2, 10), 0, hand * 4.2f, 0.8f, 0, in(random, 2.2, 3), 1,
                           painter_.sign(Random(random.next()))});
  if (random.uniform() < 0.03)
    cell.things.push_back(
        {Thing::kUpright, s + 8, 0, hand * in(random, 22, 34), 7, 0, in(random, 28, 40), 1, painter_.tower()});
  const double parked = country ? 0.02 : cell.zone == Zone::kPark ? 0.12 : 0.42;
  for (const float slot : {1.f, 7.f}) {
    if (mood_now.uniform() >= parked || cell.crossing) continue;
    const float from = s + slot + in(mood_now, 0, 0.8), inner = hand * 3.75f;
    const Random paint(mood_now.next());
    cell.things.push_back(
        {Thing::kAlong, from, from + 4.3f, inner, inner, 0, 1.45f, 1, painter_.car(Painter::View::kSide, paint)});
    cell.things.push_back({Thing::kAcross, from, 0, hand > 0 ? inner : inner - 1.75f, hand > 0 ? inner + 1.75f : inner,
                           0, 1.45f, 1, painter_.car(Painter::View::kBack, paint)});
  }
}

}  // namespace citylearn::drawn
