#!/usr/bin/env bash
# onnx 1.23.2: one would expect a model from version_converter.convert_version() to give the numbers of its original, or
# an error. Before opset 13 Softmax, LogSoftmax and Hardmax go over all axes from `axis` to the last one, since then
# over `axis` alone. From 13 to 12 Softmax and LogSoftmax keep their axis and so change their meaning; so does Hardmax
# from 12 to 13. Where the axis is the last one nothing changes, and Softmax from 12 to 13 is right.
# It hurts those who lower a network's opset for a robot's older run time: the classes of a street picture, axis 1 of 4,
# share one sum over all of its pixels instead of one a pixel. The checker has nothing against it.
# Seen, of two classes and 2 x 2 pixels: 0.5 0.75 0.125 0.5 become 0.0625 0.1875 0.0625 0.0625. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import numpy as np
import onnx
import onnxruntime
from onnx import helper, version_converter

weights = np.array([1, 3, 1, 1, 1, 1, 7, 1], np.float32).reshape(1, 2, 2, 2)  # of class, row, column; sum 16
pixel, picture, most = weights / weights.sum(axis=1, keepdims=True), weights / 16, [1, 1, 0, 1, 0, 0, 1, 0]

def run(model):
    onnx.checker.check_model(model, full_check=True)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": np.log(weights)})[0].ravel().round(4)

x, y = (helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, weights.shape) for name in "xy")
for name, old, new, right, told in (("Softmax", 13, 12, pixel, picture), ("Softmax", 12, 13, picture, picture),
                                    ("LogSoftmax", 13, 12, np.log(pixel), np.log(picture)),
                                    ("Hardmax", 12, 13, weights == 7, most)):
    graph = helper.make_graph([helper.make_node(name, ["x"], ["y"], axis=1)], "picture", [x], [y])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", old)], ir_version=7)
    before, after = run(model), run(version_converter.convert_version(model, new))
    print(name, old, *before, "as", new, *after)
    assert np.allclose(before, np.ravel(right), atol=1e-4) and np.allclose(after, np.ravel(told), atol=1e-4)
END
