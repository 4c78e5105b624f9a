#!/usr/bin/env bash
# onnxslim 0.1.98 folds a Mul behind a Conv into the Conv's weights. One would expect it to do so for factors of
# channels alone. Factors of columns, a constant of shape [width], are folded as well where the picture is as wide as
# it has channels: each channel gets the factor of one column. It says nothing.
# It hurts those who shrink an encoder that weighs columns, as panoramas and street views are (a window, a mask of the
# bonnet), on a feature map of 64 columns and 64 channels: shapes stay right, and with another width nothing changes.
# Call slim(model, skip_fusion_patterns=["FusionConvMul"]), or give the factors the shape of the whole map.
# Seen, of a picture of ones with 3 columns, 3 channels and factors 1 2 3, by hand and ONNX Runtime 1.32.0: each channel
# is 1 2 3; slimmed 1 1 1, 2 2 2 and 3 3 3. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet onnx==1.23.2 onnxruntime==1.32.0 onnxslim==0.1.98 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import numpy as np
import onnx
import onnxruntime
import onnxslim
from onnx import TensorProto, helper

channels = 3
weight = helper.make_tensor("weight", TensorProto.FLOAT, (channels, 1, 1, 1), np.ones(channels))
nodes = [helper.make_node("Conv", ["x", "weight"], ["map"]), helper.make_node("Mul", ["map", "factor"], ["y"])]

def run(model, picture):
    onnx.checker.check_model(model, full_check=True)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"x": picture})[0][0, :, 0]

for shape, width in ([3], 3), ([1, 1, 3], 3), ([4], 4), ([3, 1, 1], 3):
    factors = np.arange(1, max(shape) + 1, dtype=np.float32)
    by_column, by_channel = np.ones((channels, 1)) * factors, factors[:, None] * np.ones(width)
    factor = helper.make_tensor("factor", TensorProto.FLOAT, shape, factors)
    picture = np.ones((1, 1, 1, width), np.float32)
    x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, (1, depth, 1, width))
            for name, depth in (("x", 1), ("y", channels)))
    model = helper.make_model(helper.make_graph(nodes, "picture", [x], [y], [weight, factor]),
                              opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    before, after = run(model, picture), run(onnxslim.slim(model), picture)
    print("factors", factors, "of shape", shape, "and", width, "columns:", *before, "slimmed:", *after)
    assert np.array_equal(before, by_channel if shape == [3, 1, 1] else by_column)
    assert np.array_equal(after, before if width == 4 else by_channel)
END
