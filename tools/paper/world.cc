// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/world.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/util/error.h"
#include "encoder_service/encoder_options.h"
#include "tools/lab/descriptors.h"

namespace citylearn::paper {
namespace {

const std::string kAsRead = "features";
const std::string kRaw = "raw84";

}  // namespace

struct World::Encoded {
  std::unique_ptr<Encoder> encoder;
  std::map<std::string, Eigen::MatrixXf> descriptors;  ///< D x F, by traversal
  std::map<std::string, Reduction> reductions;         ///< by representation
};

World::World(const WorldOptions& options) : options_(options) {
  const std::unique_ptr<Dataset> dataset = open_dataset(options.source);
  const std::string learned = chosen_traversal(*dataset, options.source);
  names_ = {learned};
  for (const std::string& name : dataset->names())
    if (name != learned) names_.push_back(name);
  Selection selection = options.source.selection;
  Traversal& reference = recordings_[learned] = select(*dataset, learned, selection);
  if (reference.frames > options.most_frames) {
    selection.end = selection.first + options.most_frames * selection.step;
    reference = select(*dataset, learned, selection);
  }
  selection.align = learned;
  selection_ = selection;
  for (std::size_t i = 1; i < names_.size();) {
    // Pictures cannot be aligned to features in the same folder: those are another recording.
    if ((dataset->load(names_[i]).images == nullptr) == (reference.images == nullptr)) {
      recordings_[names_[i]] = select(*dataset, names_[i], selection);
      ++i;
    } else {
      spdlog::warn("traversal '{}' is of another kind than '{}': left out", names_[i], learned);
      names_.erase(names_.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }
  if (!pictures() && !options_.encoder.empty())
    throw Error("dataset " + options.source.dataset + " has features already", "--encoder", "leave it out");
}

World::~World() = default;

bool World::pictures() const { return recordings_.at(train()).images != nullptr; }

int World::frames() const {
  int frames = recordings_.at(train()).frames;
  for (const auto& [name, recording] : recordings_) frames = std::min(frames, recording.frames);
  return frames;
}

const std::string& World::train() const { return names_.front(); }

std::vector<std::string> World::names() const { return names_; }

const Traversal& World::recording(const std::string& name) const { return recordings_.at(name); }

Json World::hashes(const std::vector<std::string>& names) {
  Json all = Json::object();
  for (const std::string& name : names) {
    const auto [known, fresh] = hashes_.try_emplace(name, 0);
    if (fresh) known->second = recordings_.at(name).hash();
    all[name] = fmt::format("{:016x}", known->second);
  }
  return all;
}

Json World::description() const {
  Json traversals = Json::array();
  for (const std::string& name : names_)
    traversals.push_back({{"name", name}, {"condition", recordings_.at(name).condition}});
  return {{"drawn", drawn()}, {"train", train()}, {"frames", frames()}, {"traversals", traversals}};
}

World::Encoded& World::encoded(const std::string& name) {
  std::unique_ptr<Encoded>& slot = encoded_[name];
  if (slot) return *slot;
  auto made = std::make_unique<Encoded>();
  const auto [entry, files] = choose_encoder(name, options_.files);
  made->encoder = entry.create(Parameters("encoder " + name, entry.parameters, {}), files);
  lab::fit_encoder(*made->encoder, recordings_.at(train()));
  slot = std::move(made);
  return *slot;
}

std::vector<std::string> World::representations(const std::vector<int>& dimensions) {
  if (!pictures()) return {kAsRead};
  std::vector<std::string> found;
  const std::string encoder = options_.encoder.empty() ? kDefaultEncoder : options_.encoder;
  for (const int dimension : dimensions)
    if (dimension <= std::min(encoder_dimension(encoder), recordings_.at(train()).frames - 1))
      found.push_back(encoder + "-" + std::to_string(dimension));
  found.push_back(kRaw);
  return found;
}

std::string World::common_representation() {
  for (const int dimension : {64, 32, 16, 8})
    if (std::string first = representations({dimension}).front(); first != kRaw) return first;
  return representations({}).front();
}

int World::features(const std::string& representation) const {
  if (representation == kAsRead) return recordings_.at(train()).dimension;
  const std::size_t dash = representation.rfind('-');
  return dash == std::string::npos ? 0 : std::stoi(representation.substr(dash + 1));
}

int World::encoder_dimension(const std::string& encoder) { return encoded(encoder).encoder->spec().dimension; }

const Traversal& World::traversal(const std::string& representation, const std::string& name) {
  if (representation == kAsRead) return recordings_.at(name);
  Traversal& result = traversals_[{representation, name}];
  if (result.frames > 0) return result;
  if (representation == kRaw) {
    Traversal route = recordings_.at(name);
    route.frames = std::min(options_.raw_frames, frames());
    return result = lab::with_features(route, lab::encode(*encoded(kRaw).encoder, route, kRaw, "").matrix);
  }
  const std::string encoder = encoder_of(representation);
  Encoded& parts = encoded(encoder);
  const auto descriptors = [&](const std::string& of) -> const Eigen::MatrixXf& {
    Eigen::MatrixXf& matrix = parts.descriptors[of];
    if (matrix.size() == 0)
      matrix = lab::encode(*parts.encoder, recordings_.at(of), encoder + " " + of, options_.store).matrix;
    return matrix;
  };
  const auto [reduction, fresh] = parts.reductions.try_emplace(representation);
  if (fresh) reduction->second = Reduction::learn(descriptors(train()), {.dimension = features(representation)});
  return result = lab::with_features(recordings_.at(name), reduction->second.apply(descriptors(name)));
}

std::string encoder_of(const std::string& representation) {
  return representation.substr(0, representation.rfind('-'));
}

}  // namespace citylearn::paper
