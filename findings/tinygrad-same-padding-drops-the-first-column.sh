#!/usr/bin/env bash
# tinygrad 0.14.0 runs an ONNX Conv with auto_pad SAME_UPPER whose stride is larger than its kernel, as the 1 x 1
# convolutions of stride 2 beside the blocks of a ResNet, on the wrong pixels. Such a layer needs no padding; tinygrad
# computes -1 of it and cuts the first row and column off where a side is even, so it takes every second pixel from the
# second one on. One would expect it to begin with the first one, as with SAME_LOWER, and as any padding at least 0.
# It hurts those who run an encoder that came from Keras or TensorFlow, where "same" is usual: shapes are right, and the
# shortcuts are a pixel beside the blocks that they are added to. Write the padding as `pads` of zeros before.
# Seen, of the pixels 1 to 8 by hand and ONNX Runtime 1.32.0: 1 3 5 7; by tinygrad 2 4 6 8. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet onnx==1.23.2 onnxruntime==1.32.0 tinygrad==0.14.0 numpy==2.4.6
DEV=PYTHON venv/bin/python - <<'END' # tinygrad's own interpreter, which needs no compiler
import numpy as np
import onnx
import onnxruntime
import tinygrad
from onnx import TensorProto, helper
from tinygrad.nn.onnx import OnnxRunner

pixels = np.arange(1, 9, dtype=np.float32).reshape(1, 1, 1, 8)
x, y = (helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 1, 1, width])
        for name, width in (("x", 8), ("y", 4)))
weight = helper.make_tensor("weight", TensorProto.FLOAT, (1, 1, 1, 1), [1])
for padding, told in (({"auto_pad": "SAME_UPPER"}, [2, 4, 6, 8]), ({"auto_pad": "SAME_LOWER"}, [1, 3, 5, 7]),
                      ({"pads": [0, 0, 0, 0]}, [1, 3, 5, 7])):
    node = helper.make_node("Conv", ["x", "weight"], ["y"], strides=[1, 2], **padding)
    model = helper.make_model(helper.make_graph([node], "picture", [x], [y], [weight]),
                              opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, "model.onnx")
    session = onnxruntime.InferenceSession("model.onnx", providers=["CPUExecutionProvider"])
    by_onnxruntime = session.run(None, {"x": pixels})[0].ravel()
    by_tinygrad = OnnxRunner("model.onnx")({"x": tinygrad.Tensor(pixels)})["y"].numpy().ravel()
    print(padding, "ONNX Runtime", by_onnxruntime, "tinygrad", by_tinygrad)
    assert by_onnxruntime.tolist() == [1, 3, 5, 7] and by_tinygrad.tolist() == told
END
