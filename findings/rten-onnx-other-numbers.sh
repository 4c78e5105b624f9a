#!/usr/bin/env bash
# rten 0.27.0 of crates.io reads valid ONNX nodes and computes other numbers. One would expect the right ones or an
# error, which it raises for other things that it cannot do; here it says nothing. Resize with mode "cubic" is linear;
# an LSTM or GRU reads on behind its `sequence_lens`; ArgMax and ArgMin take the last of equal numbers instead of the
# first; pools with SAME_LOWER pad as SAME_UPPER does; Softplus is infinite from 89 on.
# It hurts those who run encoders or policies in Rust: vision transformers resize their positions with "cubic", batches
# of episodes of several lengths end in states that padding has changed, and an agent with equal scores acts otherwise.
# Seen, by hand and ONNX Runtime 1.32.0 against rten: Resize of 0 0 1 0 to twice its width 0 -0.0352 -0.1055 0.2617 ...
# against 0 0 0 0.25 ...; h behind one step 0.3696 against 0.6505; ArgMax of 1 3 3 1 is 1 against 2; MaxPool of 1 2 3
# is 1 3 against 2 3; Softplus of 100 is 100 against inf. Needs python3 and cargo.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet onnx==1.23.2 onnxruntime==1.32.0 numpy==2.4.6
mkdir src
cat >Cargo.toml <<'END'
[package]
name = "other_numbers"
version = "1.0.0"
edition = "2021"
[dependencies]
rten = "=0.27.0"
rten-tensor = "=0.27.0"
END
cat >src/main.rs <<'END'
use rten::{Model, Value};
use rten_tensor::{prelude::*, Tensor};

fn main() { // arguments: model, sides as 1,1,1,4, numbers as 0,0,1,0
    let given: Vec<String> = std::env::args().collect();
    let sides: Vec<usize> = given[2].split(',').map(|side| side.parse().unwrap()).collect();
    let numbers: Vec<f32> = given[3].split(',').map(|number| number.parse().unwrap()).collect();
    let x = Tensor::from_data(sides.as_slice(), numbers);
    match Model::load_file(&given[1]).unwrap().run_one(x.view().into(), None).unwrap() {
        Value::FloatTensor(y) => y.iter().for_each(|number| print!("{number} ")),
        Value::Int32Tensor(y) => y.iter().for_each(|number| print!("{number} ")),
        _ => unreachable!(),
    }
}
END
cargo build --quiet
venv/bin/python - <<'END'
import subprocess
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

ONES = np.ones((1, 4, 1), np.float32)
# What is tried: operator, attributes, inputs behind x, outputs, x (sides and numbers), numbers by hand, those of rten.
CASES = [
    ("Resize", {"mode": "cubic"}, [None, np.float32([1, 1, 1, 2])], ["y"], ([1, 1, 1, 4], [0, 0, 1, 0]),
     [0, -0.0352, -0.1055, 0.2617, 0.8789, 0.8789, 0.2617, -0.1055], [0, 0, 0, 0.25, 0.75, 0.75, 0.25, 0]),
    ("LSTM", {"hidden_size": 1}, [ONES, ONES, None, np.int32([1])], ["", "y"], ([2, 1, 1], [1, 1]), [0.3696], [0.6505]),
    ("ArgMax", {"axis": 1}, [], ["y"], ([1, 4], [1, 3, 3, 1]), [1], [2]),
    ("ArgMin", {"axis": 1}, [], ["y"], ([1, 4], [1, 3, 3, 1]), [0], [3]),
    ("MaxPool", {"kernel_shape": [2], "strides": [2], "auto_pad": "SAME_LOWER"}, [], ["y"], ([1, 1, 3], [1, 2, 3]),
     [1, 3], [2, 3]),
    ("Softplus", {}, [], ["y"], ([1], [100]), [100], [np.inf]),
]
for operator, attributes, inputs, outputs, (sides, numbers), by_hand, by_rten in CASES:
    names = ["x"] + ["" if given is None else f"input{i}" for i, given in enumerate(inputs)]
    constants = [numpy_helper.from_array(given, f"input{i}") for i, given in enumerate(inputs) if given is not None]
    kind = TensorProto.INT64 if operator.startswith("Arg") else TensorProto.FLOAT
    y = helper.make_tensor_value_info("y", kind, [None] * (len(sides) if operator != "LSTM" else 3))
    graph = helper.make_graph([helper.make_node(operator, names, outputs, **attributes)], "graph",
                              [helper.make_tensor_value_info("x", TensorProto.FLOAT, sides)], [y], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, "model.onnx")
    runtime = onnxruntime.InferenceSession("model.onnx", providers=["CPUExecutionProvider"])
    right = runtime.run(None, {"x": np.float32(numbers).reshape(sides)})[0].ravel()
    texts = [",".join(map(str, row)) for row in (sides, numbers)]
    seen = np.array(subprocess.check_output(["target/debug/other_numbers", "model.onnx", *texts]).split(), float)
    print(operator, attributes, numbers, "by hand", by_hand, "ONNX Runtime", right.round(4), "rten", seen.round(4))
    assert np.allclose(right, by_hand, atol=1e-4) and np.allclose(seen, by_rten, atol=1e-4)
END
