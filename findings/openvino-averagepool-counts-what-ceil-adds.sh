#!/usr/bin/env bash
# OpenVINO 2026.4.1 divides an ONNX AveragePool with ceil_mode and count_include_pad by the whole window even where
# ceil_mode lets the last window reach beyond the padding, for any opset. One would expect it to count the numbers and
# the padding, as PyTorch, which exports AvgPool2d(3, stride=2, padding=1, ceil_mode=True) as this, ONNX Runtime and
# the standard's own evaluator do. Without ceil_mode, or without count_include_pad, it is right.
# It hurts those who run an encoder by OpenVINO: the last column and row of its features are too small, by a third in
# this one and by more than half in the corner, and only for pictures whose sides make the last window reach beyond.
# Export with count_include_pad=False, or pad before.
# Seen, of 4 x 4 pixels of 1, by hand, PyTorch's rule, the standard's evaluator and ONNX Runtime 1.32.0: last row
# 0.3333 0.5 0.25; by OpenVINO 0.2222 0.3333 0.1111. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 openvino==2026.4.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import numpy as np
import onnx
import onnxruntime
import openvino
from onnx import TensorProto, helper
from onnx.reference import ReferenceEvaluator

def by_hand(ceil):  # windows of 3 begin at -1, 1 and, with ceil_mode, 3; pixels are at 0 to 3, padding at -1 and 4
    starts = [-1, 1, 3] if ceil else [-1, 1]
    sums = [sum(0 <= place <= 3 for place in range(start, start + 3)) for start in starts]
    counts = [sum(-1 <= place <= 4 for place in range(start, start + 3)) for start in starts]
    return np.outer(sums, sums) / np.outer(counts, counts), np.outer(sums, sums) / 9

pixels = np.ones((1, 1, 4, 4), np.float32)
for opset in 11, 17, 22:
    for ceil in 1, 0:
        node = helper.make_node("AveragePool", ["x"], ["y"], kernel_shape=[3, 3], strides=[2, 2], pads=[1, 1, 1, 1],
                                ceil_mode=ceil, count_include_pad=1)
        x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 1, side, side])
                for name, side in (("x", 4), ("y", 2 + ceil)))
        model = helper.make_model(helper.make_graph([node], "pool", [x], [y]),
                                  opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
        onnx.checker.check_model(model, full_check=True)
        session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
        core = openvino.Core()
        compiled = core.compile_model(core.read_model(model.SerializeToString()), "CPU",
                                      {"INFERENCE_PRECISION_HINT": "f32"})
        right, told = by_hand(ceil)
        by_openvino = compiled(pixels)[0][0, 0]
        print("opset", opset, "ceil_mode", ceil, "last row by hand", right[-1].round(4),
              "OpenVINO", by_openvino[-1].round(4))
        for run in session, ReferenceEvaluator(model):
            assert np.allclose(run.run(None, {"x": pixels})[0][0, 0], right, atol=1e-5)
        assert np.allclose(by_openvino, told if ceil else right, atol=1e-5)
        assert np.allclose(right, told) == (not ceil)
END
