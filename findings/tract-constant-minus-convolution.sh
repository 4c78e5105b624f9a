#!/usr/bin/env bash
# tract 0.23.9 folds an ONNX Sub behind a Conv into the Conv's weights also where the Conv is what is taken away: of
# "constant - Conv", with a constant for each channel, it makes "constant + Conv". One would expect the right numbers,
# as for "Conv - constant" and for a constant that is one number. It says nothing.
# It hurts those who run in Rust an encoder or a policy that mirrors what a layer gives, "1 - x" with 1 as a channel's
# constant: shapes are right. Write it as Neg and Add, or give the Conv negative weights.
# Seen, of 3 x 3 pixels of 1, weights 1 and -0.5 and constants 1 and 10, the middle pixel by hand and ONNX Runtime
# 1.32.0: -8 and 14.5; by tract 10 and 5.5. Needs python3.
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
from onnx import TensorProto, helper, numpy_helper

pixels = np.ones((1, 1, 3, 3), np.float32)
weights = np.ones((2, 1, 3, 3), np.float32) * np.float32([1, -0.5]).reshape(2, 1, 1, 1)
each = np.float32([1, 10]).reshape(1, 2, 1, 1)
x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, channels, 3, 3])
        for name, channels in (("x", 1), ("y", 2)))
for terms, constant in (("constant", "conv"), each), (("conv", "constant"), each), (("constant", "conv"), each[:, :1]):
    nodes = [helper.make_node("Conv", ["x", "weights"], ["conv"], pads=[1, 1, 1, 1]),
             helper.make_node("Sub", terms, ["y"])]
    given = [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(constant, "constant")]
    model = helper.make_model(helper.make_graph(nodes, "mirror", [x], [y], given),
                              opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, sys.argv[1])
    session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
    right = session.run(None, {"x": pixels})[0][0, :, 1, 1]
    seen = tract.onnx().load(sys.argv[1]).into_model().into_runnable().run([pixels])[0].to_numpy()[0, :, 1, 1]
    by_hand = (constant.ravel() - np.float32([9, -4.5])) * (1 if terms[0] == "constant" else -1)
    print(" - ".join(terms), constant.ravel(), "by hand", by_hand, "ONNX Runtime", right, "tract", seen)
    told = [10, 5.5] if terms[0] == "constant" and constant.size == 2 else by_hand
    assert np.allclose(right, by_hand) and np.allclose(seen, told)
END
