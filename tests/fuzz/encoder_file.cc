// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/reduction.h"
#include "encoder_service/onnx/onnx_file.h"
#include "tests/fuzz/targets.h"

namespace citylearn::fuzz {

bool encoder_file(Input input) {
  if (input.empty()) return false;
  const Input file = input.subspan(1);
  if (std::to_integer<unsigned>(input[0]) % 2 == 1)
    return accepted([&] { require(read_onnx(file, "model").nodes >= 1, "a graph has nodes"); });
  return accepted([&] {
    const Reduction reduction = Reduction::load(file, "seed-1", "reduction");
    require(reduction.input_dimension() >= 1 && reduction.dimension() >= 1, "dimensions");
    const Eigen::MatrixXf features = reduction.apply(Eigen::MatrixXf::Ones(reduction.input_dimension(), 3));
    require(features.rows() == reduction.dimension() && features.cols() == 3, "shape");
    require(Reduction::load(reduction.save("seed-1"), "seed-1", "again").dimension() == reduction.dimension(),
            "saved and loaded");
  });
}

}  // namespace citylearn::fuzz
