#!/bin/sh
# OpenCV computes an ONNX AveragePool by the name of the program that wrote the file. count_include_pad, which the
# standard has for it (0: padding is left out of the mean), is not read: files of 'pytorch' count padding, others do not.
# Installs onnx, onnxruntime and OpenCV, runs one valid graph under two names. Status 1: this has changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.17.0 onnxruntime==1.20.1 "numpy==1.26.4" opencv-python-headless==4.6.0.66
"$folder/venv/bin/python" - <<'END'
import sys
import cv2
import numpy as np
import onnxruntime
from onnx import TensorProto, helper

ones = np.ones((1, 1, 3, 3), np.float32)
print("OpenCV", cv2.__version__, "ONNX Runtime", onnxruntime.__version__)
print("mean of 3 x 3 ones at a corner, with one place of padding: 1 without the padding, 4/9 with it")
seen = {}
for counts in (0, 1):
    node = helper.make_node("AveragePool", ["x"], ["y"], kernel_shape=[3, 3], pads=[1, 1, 1, 1], count_include_pad=counts)
    sides = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 1, 3, 3])
    result = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 1, 3, 3])
    graph = helper.make_graph([node], "graph", [sides], [result])
    for producer in ("pytorch", "tf2onnx"):
        model = helper.make_model(graph, producer_name=producer, opset_imports=[helper.make_opsetid("", 11)])
        model.ir_version = 6
        file = model.SerializeToString()
        right = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"]).run(None, {"x": ones})[0]
        net = cv2.dnn.readNetFromONNX(np.frombuffer(file, np.uint8))
        net.setInput(ones)
        seen[counts, producer] = [round(float(y[0, 0, 0, 0]), 3) for y in (right, net.forward())]
        print(f"count_include_pad={counts} producer={producer}: ONNX Runtime, OpenCV", seen[counts, producer])
expected = {(0, "pytorch"): [1, 0.444], (0, "tf2onnx"): [1, 1], (1, "pytorch"): [0.444, 0.444], (1, "tf2onnx"): [0.444, 1]}
sys.exit(seen != expected)
END
