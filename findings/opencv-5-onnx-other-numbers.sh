#!/bin/sh
# OpenCV 5.0.0.93 reads valid ONNX nodes and computes other numbers without a word: auto_pad SAME_LOWER is taken for
# SAME_UPPER, Softmax before opset 13 sums along one side, PRelu's slopes along the width are read by channel, Resize
# goes by the ratio of sides instead of by `scales` and leaves `antialias` out, Swish leaves `alpha` out, and an
# AveragePool that counts padding also counts what ceil_mode adds beyond it.
# Installs onnx, onnxruntime and OpenCV, and compares both with numbers worked out by hand. Status 1: this has changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 opencv-python-headless==5.0.0.93
"$folder/venv/bin/python" - <<'END'
import sys
import cv2
import numpy as np
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

print("OpenCV", cv2.__version__, "ONNX Runtime", onnxruntime.__version__)
# What is tried: operator, attributes, inputs beside the picture, opset, picture (a row per channel), numbers by hand.
CASES = [
    ("Conv", {"auto_pad": "SAME_LOWER"}, [np.ones((1, 1, 1, 2))], 20, [[1, 2]], [1, 3]),
    ("Softmax", {"axis": 1}, [], 11, [[0, 0], [0, 0]], [0.25] * 4),
    ("PRelu", {}, [np.array([1, 2])], 20, [[-1, -1], [-1, -1]], [-1, -2, -1, -2]),
    ("Resize", {"mode": "linear"}, [None, np.array([1, 1, 1, 0.7])], 20, [[0, 1, 2]], [0.2143, 1.6429]),
    ("Resize", {"mode": "linear", "antialias": 1}, [None, np.array([1, 1, 1, 0.5])], 20, [[0, 0, 4, 0]], [0.5, 1.5]),
    ("Swish", {"alpha": 0.5}, [], 24, [[2]], [1.4621]),
    ("AveragePool", {"kernel_shape": [1, 2], "strides": [1, 2], "ceil_mode": 1, "count_include_pad": 1}, [], 20, [[1, 1, 1]],
     [1, 1]),
]
seen = []
for operator, attributes, inputs, opset, rows, by_hand in CASES:
    picture = np.float32(rows)[None, :, None, :]
    names = ["x"] + ["" if given is None else f"input{i}" for i, given in enumerate(inputs)]
    constants = [numpy_helper.from_array(np.float32(given), f"input{i}") for i, given in enumerate(inputs) if given is not None]
    sides = [1, len(rows), 1, len(by_hand) // len(rows)]
    graph = helper.make_graph([helper.make_node(operator, names, ["y"], **attributes)], "graph",
                              [helper.make_tensor_value_info("x", TensorProto.FLOAT, picture.shape)],
                              [helper.make_tensor_value_info("y", TensorProto.FLOAT, sides)], constants)
    file = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=10).SerializeToString()
    runtime = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"]).run(None, {"x": picture})[0]
    net = cv2.dnn.readNetFromONNX(np.frombuffer(file, np.uint8))
    net.setInput(picture)
    found = [np.round(np.ravel(y).astype(float), 4).tolist() for y in (runtime, net.forward())]
    print(operator, attributes, "opset", opset, "of", rows, "\n  by hand", by_hand, "ONNX Runtime", found[0], "OpenCV", found[1])
    seen.append((np.allclose(found[0], by_hand, atol=2e-4), np.allclose(found[1], by_hand, atol=2e-4)))
sys.exit(seen != [(True, False)] * len(CASES))
END
