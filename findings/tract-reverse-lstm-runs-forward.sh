#!/usr/bin/env bash
# tract 0.23.9 runs an ONNX LSTM, GRU or RNN of `direction` "reverse" from the first step to the last, as if it said
# "forward"; both halves of a "bidirectional" one are right. It also leaves `activations` and `clip` out. One would
# expect the right numbers or an error, which it raises for other things that it cannot do; here it says nothing.
# It hurts those who run a trained recurrent policy or sequence encoder in Rust: shapes and sizes of the numbers are
# plausible. Turn the sequence round with Slice before a "forward" layer and back behind it.
# Seen, h of three steps with x = 1, 0, 0 and all weights 1, by hand and ONNX Runtime 1.32.0: forward 0.3696 0.2908
# 0.2507, reverse 0.3696 0 0, Relu in place of Tanh 0.5344 0.5031 0.5053, clip at 0.5 0.1743 0.1331 0.1073; tract gives
# the forward numbers four times. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 tract==0.23.9 numpy==2.4.6
"$folder/venv/bin/python" - "$folder/model.onnx" <<'END'
import sys
import numpy as np
import onnx
import onnxruntime
import tract
from onnx import TensorProto, helper

def by_hand(direction="forward", activations=("Sigmoid", "Tanh", "Tanh"), clip=np.inf):
    squash = np.tanh if activations[1] == "Tanh" else lambda value: max(value, 0)
    h = c = 0.0
    steps = np.zeros(3)
    for step in (0, 1, 2) if direction == "forward" else (2, 1, 0):
        seen = np.clip((step == 0) + h, -clip, clip)  # all gates and the new cell see x + h
        gate = 1 / (1 + np.exp(-seen))
        c = gate * c + gate * squash(seen)
        steps[step] = h = gate * squash(c)
    return steps

x = np.array([1, 0, 0], np.float32).reshape(3, 1, 1)
weights = [helper.make_tensor(name, TensorProto.FLOAT, (1, 4, 1), np.ones(4)) for name in "wr"]
ends = [[helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)] for name, shape in
        (("x", (3, 1, 1)), ("y", (3, 1, 1, 1)))]
forward = by_hand()
for case in {}, {"direction": "reverse"}, {"activations": ["Sigmoid", "Relu", "Relu"]}, {"clip": 0.5}:
    node = helper.make_node("LSTM", ["x", "w", "r"], ["y"], hidden_size=1, **case)
    model = helper.make_model(helper.make_graph([node], "steps", *ends, weights),
                              opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, sys.argv[1])
    session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
    by_onnxruntime = session.run(None, {"x": x})[0].ravel()
    by_tract = tract.onnx().load(sys.argv[1]).into_model().into_runnable().run([x])[0].to_numpy().ravel()
    print(case or "plain", "by hand", by_hand(**case).round(4), "ONNX Runtime", by_onnxruntime.round(4),
          "tract", by_tract.round(4))
    assert np.allclose(by_onnxruntime, by_hand(**case), atol=1e-5) and np.allclose(by_tract, forward, atol=1e-4)
    assert not case or np.abs(by_onnxruntime - forward).max() > 0.05
END
