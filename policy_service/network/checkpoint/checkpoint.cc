// SPDX-License-Identifier: Apache-2.0
#include "checkpoint.h"

#include <openssl/sha.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <vector>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "policy_service/network/belief/motion.h"

namespace citylearn {
namespace {

static_assert(std::endian::native == std::endian::little, "checkpoints are written as they lie in memory");

constexpr std::string_view kMagic = "CLKPT\r\n\x1a";
constexpr std::uint32_t kVersion = 1;
constexpr const char* kRemedy = "use an older one";
constexpr std::string_view kPrefix = "checkpoint-", kSuffix = ".clk";

template <class T>
void append(std::string& bytes, T value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

std::string digest(std::string_view bytes) {
  unsigned char hash[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), hash);
  return {reinterpret_cast<const char*>(hash), sizeof hash};
}

/// Takes from the front of a file's bytes.
class Reader {
 public:
  Reader(std::string_view bytes, std::string path) : rest_(bytes), path_(std::move(path)) {}
  std::string_view take(std::uint64_t count) {
    if (count > rest_.size()) throw damaged("is cut short");
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }
  template <class T>
  T number() {
    T value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::size_t left() const { return rest_.size(); }
  Error damaged(const std::string& what) const { return Error("the checkpoint " + what, path_, kRemedy); }

 private:
  std::string_view rest_;
  std::string path_;
};

/// Returns the update of a checkpoint's file name.
std::optional<std::uint64_t> update_of(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  if (!name.starts_with(kPrefix) || !name.ends_with(kSuffix)) return std::nullopt;
  const char* begin = name.data() + kPrefix.size();
  const char* end = name.data() + name.size() - kSuffix.size();
  std::uint64_t update = 0;
  const auto [stop, problem] = std::from_chars(begin, end, update);
  if (problem != std::errc() || stop != end) return std::nullopt;
  return update;
}

/// Returns the checkpoints, the newest first.
std::vector<std::pair<std::uint64_t, std::filesystem::path>> checkpoints_in(const std::string& folder) {
  std::vector<std::pair<std::uint64_t, std::filesystem::path>> found;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none))
    if (const auto update = update_of(entry.path())) found.emplace_back(*update, entry.path());
  std::sort(found.rbegin(), found.rend());
  return found;
}

}  // namespace

void write_checkpoint(const std::string& path, const Checkpoint& checkpoint) {
  nlohmann::json header = checkpoint.header;
  nlohmann::json& list = header["tensors"] = nlohmann::json::array();
  std::size_t floats = 0;
  for (const auto& [name, tensor] : checkpoint.tensors) {
    list.push_back({{"name", name}, {"rows", tensor.rows()}, {"cols", tensor.cols()}});
    floats += static_cast<std::size_t>(tensor.size());
  }
  const std::string text = header.dump();
  std::string bytes;
  bytes.reserve(kMagic.size() + 12 + text.size() + floats * sizeof(float) + SHA256_DIGEST_LENGTH);
  bytes += kMagic;
  append(bytes, kVersion);
  append(bytes, static_cast<std::uint64_t>(text.size()));
  bytes += text;
  for (const auto& [name, tensor] : checkpoint.tensors)
    bytes.append(reinterpret_cast<const char*>(tensor.data()), static_cast<std::size_t>(tensor.size()) * sizeof(float));
  bytes += digest(bytes);
  write_file(path, bytes);
}

Checkpoint read_checkpoint(const std::string& path) {
  if (std::filesystem::is_directory(path)) throw Error("is a folder", path, "name a .clk file");
  const std::string bytes = read_file(path);
  Reader reader(bytes, path);
  if (!bytes.starts_with(kMagic)) {
    if (kMagic.starts_with(bytes)) throw reader.damaged("is cut short");
    throw Error("is not a checkpoint", path);
  }
  reader.take(kMagic.size());
  const auto version = reader.number<std::uint32_t>();
  if (version > kVersion)
    throw Error(
        "is a checkpoint of version " + std::to_string(version) + ", this program knows " + std::to_string(kVersion),
        path, "use the newer program");
  if (bytes.size() < kMagic.size() + 12 + SHA256_DIGEST_LENGTH) throw reader.damaged("is cut short");
  const std::string_view body(bytes.data(), bytes.size() - SHA256_DIGEST_LENGTH);
  if (digest(body) != std::string_view(bytes).substr(body.size())) throw reader.damaged("is damaged or cut short");

  Checkpoint checkpoint;
  try {
    checkpoint.header = parse_json(reader.take(reader.number<std::uint64_t>()), path, kRemedy);
    for (const nlohmann::json& entry : checkpoint.header.at("tensors")) {
      const auto rows = entry.at("rows").get<std::uint64_t>(), cols = entry.at("cols").get<std::uint64_t>();
      if (rows > bytes.size() || cols > bytes.size()) throw reader.damaged("is damaged");
      Matrix<float> tensor(static_cast<std::ptrdiff_t>(rows), static_cast<std::ptrdiff_t>(cols));
      const std::string_view raw = reader.take(rows * cols * sizeof(float));
      if (!raw.empty()) std::memcpy(tensor.data(), raw.data(), raw.size());
      checkpoint.tensors.emplace(entry.at("name").get<std::string>(), std::move(tensor));
    }
  } catch (const nlohmann::json::exception& problem) {
    throw reader.damaged("has a bad header: " + std::string(problem.what()));
  }
  if (reader.left() != SHA256_DIGEST_LENGTH) throw reader.damaged("is damaged");
  return checkpoint;
}

std::string write_checkpoint_of_update(const std::string& folder, std::uint64_t update, const Checkpoint& checkpoint,
                                       int keep) {
  create_folder(folder);
  std::string path =
      (std::filesystem::path(folder) / (std::string(kPrefix) + std::to_string(update) + std::string(kSuffix))).string();
  write_checkpoint(path, checkpoint);
  const auto all = checkpoints_in(folder);
  std::error_code ignored;
  for (std::size_t i = static_cast<std::size_t>(keep); i < all.size(); ++i)
    std::filesystem::remove(all[i].second, ignored);  // one that stays does no harm
  return path;
}

std::optional<std::string> newest_checkpoint(const std::string& folder) {
  const auto all = checkpoints_in(folder);
  if (!all.empty()) return all.front().second.string();
  const std::filesystem::path best = std::filesystem::path(folder) / kBestCheckpoint;
  std::error_code none;
  return std::filesystem::exists(best, none) ? std::optional(best.string()) : std::nullopt;
}

TrainedAgent unbuilt_agent(const Checkpoint& checkpoint) {
  TrainedAgent agent;
  try {
    const nlohmann::json& header = checkpoint.header;
    agent.name = header.at("agent").get<std::string>();
    if (agent.name == "place_memory")
      throw Error("is of the agent place_memory, which exists up to version 0.1 only", "checkpoint",
                  "train place_filter on the same data, or use version 0.1");
    agent.task.features = header.at("task").at("features").get<int>();
    agent.task.frames = header.at("task").at("frames").get<int>();
    agent.first_frame = header.at("task").at("first_frame").get<int>();
    agent.places = agent.task.goals = header.at("task").value("places", 0);
    agent.task.reference = checkpoint.tensors.at("reference");
    agent.network_parameters = header.at("network").get<std::map<std::string, double>>();
    if (agent.name == "place_filter") agent.network_parameters.emplace(kSlipsLimitTempering, 0);  // it was so before
    agent.parameters = checkpoint.tensors.at("learner.parameters").reshaped();
    if (const auto data = header.find("data"); data != header.end())
      agent.data = TrainingData::parse(data->dump(), "checkpoint");
    agent.update = header.value("progress", nlohmann::json::object()).value("updates", std::uint64_t{0});
  } catch (const nlohmann::json::exception& problem) {
    throw Error("the header lacks something: " + std::string(problem.what()), "checkpoint");
  } catch (const std::out_of_range&) {
    throw Error("a tensor is missing", "checkpoint");
  }
  return agent;
}

TrainedAgent trained_agent(const Checkpoint& checkpoint) {
  TrainedAgent agent = unbuilt_agent(checkpoint);
  agent.build_network(agent.task);
  return agent;
}

void TrainedAgent::build_network(std::shared_ptr<const StateMap> streets, const Matrix<float>& reference,
                                 float goal_radius) {
  NetworkTask on{.features = task.features, .frames = streets->states(), .reference = reference};
  on.goal_radius = goal_radius;
  on.streets = std::move(streets);
  build_network(std::move(on));
}

void TrainedAgent::build_network(NetworkTask on) {
  task = std::move(on);
  const auto& entry = NetworkRegistry<float>::instance().find("network", name);
  network = entry.create(Parameters("network " + name, entry.parameters, network_parameters), task);
  if (parameters.size() != network->parameter_count())
    throw Error("has " + std::to_string(parameters.size()) + " parameters, network '" + name + "' needs " +
                    std::to_string(network->parameter_count()),
                "checkpoint");
}

}  // namespace citylearn
