// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/safetensors.h"

#include <algorithm>

#include "core/files/files.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr const char* kReference = "reference";

Safetensors::Tensor tensor_of(const RowMajor& numbers) {
  return {{static_cast<std::uint64_t>(numbers.rows()), static_cast<std::uint64_t>(numbers.cols())},
          {numbers.data(), numbers.data() + numbers.size()}};
}

}  // namespace

Safetensors parameters_of(const TrainedAgent& agent, const std::map<std::string, std::string>& metadata) {
  Safetensors file;
  file.metadata = metadata;
  for (const Tensor& tensor : agent.network->tensors())
    file.tensors[tensor.name] =
        tensor_of(Eigen::Map<const Matrix<float>>(agent.parameters.data() + tensor.offset, tensor.rows, tensor.cols));
  if (agent.task.reference.size() > 0) file.tensors[kReference] = tensor_of(agent.task.reference.transpose());
  return file;
}

void load_parameters(const std::string& path, TrainedAgent& agent) {
  const Safetensors file = Safetensors::parse(read_file(path), path);
  const auto made_for = file.metadata.find("agent");
  if (made_for != file.metadata.end() && made_for->second != agent.name)
    throw Error("has parameters of network '" + made_for->second + "', the agent is '" + agent.name + "'", path);
  Vector<float> loaded = agent.parameters;
  std::size_t used = file.tensors.contains(kReference) ? 1 : 0;
  for (const Tensor& tensor : agent.network->tensors()) {
    const auto found = file.tensors.find(tensor.name);
    if (found == file.tensors.end()) throw Error("has no tensor '" + tensor.name + "'", path);
    const auto rows = static_cast<std::uint64_t>(tensor.rows), cols = static_cast<std::uint64_t>(tensor.cols);
    const std::vector<std::uint64_t>& shape = found->second.shape;
    if (shape != std::vector{rows, cols} && !(cols == 1 && shape == std::vector{rows}))
      throw Error("tensor '" + tensor.name + "' has shape " + shape_text(shape) + ", network '" + agent.name +
                      "' needs " + shape_text({rows, cols}),
                  path);
    const Eigen::Map<const RowMajor> numbers(found->second.numbers.data(), tensor.rows, tensor.cols);
    if (!numbers.allFinite()) throw Error("tensor '" + tensor.name + "' has numbers that are not finite", path);
    Eigen::Map<Matrix<float>>(loaded.data() + tensor.offset, tensor.rows, tensor.cols) = numbers;
    ++used;
  }
  if (used != file.tensors.size())
    for (const auto& [name, tensor] : file.tensors) {
      const auto& known = agent.network->tensors();
      if (name != kReference &&
          std::none_of(known.begin(), known.end(), [&name = name](const Tensor& one) { return one.name == name; }))
        throw Error("has tensor '" + name + "', which network '" + agent.name + "' does not know", path);
    }
  agent.parameters = std::move(loaded);
}

}  // namespace citylearn
