#!/usr/bin/env bash
# OpenVINO 2026.4.1 computes an ONNX LSTM without its peepholes (the input P, through which the gates see the cell) and
# without `input_forget`, which couples the forget gate to the input gate as 1 - i. One would expect the right numbers
# or an error, which it raises for other things that it cannot do; here it says nothing.
# It hurts those who hand a trained recurrent policy over as ONNX: the agent acts, but not as it was trained to.
# Seen, h after a step with x = h = c = 1 and all weights 1, by hand and ONNX Runtime 1.32.0: plain 0.8271, peepholes
# 0.9342, input_forget 0.6588; by OpenVINO 0.8271 three times. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 openvino==2026.4.1 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import sys
import numpy as np
import onnxruntime
import openvino
from onnx import TensorProto, helper

def sigmoid(value):
    return 1 / (1 + np.exp(-value))

def by_hand(peephole=0, input_forget=0):  # all gates see x + h = 2, input and forget the old cell, output the new one
    gate = sigmoid(2 + peephole)
    cell = (1 - gate if input_forget else gate) + gate * np.tanh(2)
    return sigmoid(2 + peephole * cell) * np.tanh(cell)

seen = []
for case in {}, {"peephole": 1}, {"input_forget": 1}:
    shapes = {"w": (1, 4, 1), "r": (1, 4, 1), "h": (1, 1, 1), "c": (1, 1, 1)}
    if "peephole" in case:
        shapes["p"] = (1, 3)
    weights = [helper.make_tensor(name, TensorProto.FLOAT, shape, np.ones(shape)) for name, shape in shapes.items()]
    inputs = ["x", "w", "r", "", "", "h", "c"] + ["p"] * ("p" in shapes)
    node = helper.make_node("LSTM", inputs, ["", "y"], hidden_size=1, input_forget=case.get("input_forget", 0))
    ends = [[helper.make_tensor_value_info(name, TensorProto.FLOAT, (1, 1, 1))] for name in "xy"]
    graph = helper.make_graph([node], "step", *ends, weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8).SerializeToString()
    one = {"x": np.ones((1, 1, 1), np.float32)}
    by_onnxruntime = onnxruntime.InferenceSession(model).run(None, one)[0].item()
    core = openvino.Core()
    compiled = core.compile_model(core.read_model(model), "CPU", {"INFERENCE_PRECISION_HINT": "f32"})
    seen.append((by_hand(**case), by_onnxruntime, compiled(one)[0].item()))
    print(case or "plain", "h by hand %.4f, ONNX Runtime %.4f, OpenVINO %.4f" % seen[-1])
numbers = np.array(seen)
right = np.allclose(numbers[:, 0], numbers[:, 1], atol=1e-5) and np.ptp(numbers[:, 0]) > 0.1
sys.exit(not (right and np.allclose(numbers[:, 2], numbers[0, 0], atol=1e-5)))
END
