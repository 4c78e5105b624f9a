// node run.mjs ENCODER: runs ENCODER/agent.onnx in ONNX Runtime on pictures.bin, and compares its actions with those of
// the services in episodes.json (tests/onnx/sample.cc).
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import * as ort from "onnxruntime-web";

const folder = process.argv[2] + "/";
ort.env.wasm.numThreads = 1;
const { frames, steps } = JSON.parse(await readFile(folder + "episodes.json", "utf8"));
const pictures = await readFile(folder + "pictures.bin");
const agent = await ort.InferenceSession.create(new Uint8Array(await readFile(folder + "agent.onnx")));

const shapes = Object.fromEntries(agent.inputMetadata.map((input) => [input.name, input.shape]));
const zeros = (name) => new ort.Tensor("float32", new Float32Array(shapes[name][1]), shapes[name]);
const row = (numbers) => new ort.Tensor("float32", Float32Array.from(numbers), [1, numbers.length]);
const size = pictures.length / frames;
const picture = (frame) =>
  new ort.Tensor("float32", Float32Array.from(pictures.subarray(frame * size, (frame + 1) * size)), shapes.picture);

const kept = { state: zeros("state"), condition: zeros("condition") };
const run = (step, seen) =>
  agent.run({
    picture: picture(step.frame),
    goal: row([step.goal]),
    previous_action: row([0, 1, 2].map((action) => (step.previous === action ? 1 : 0))),
    allowed: row([0, 1, 2].map((action) => (step.allowed >> action) & 1)),
    first: row([step.first ? 1 : 0]),
    seen,
    ...kept,
  });

// The encoder_service takes the frames in their order, whatever the agent does.
const seen = [zeros("seen")];
for (let frame = 0; frame < frames; frame++)
  seen.push((await run({ frame, goal: 0, previous: -1, allowed: 7, first: true }, seen[frame])).next_seen);

/** Draws from softmax(logits) by a number 0 .. 1. */
function drawn(logits, random) {
  const most = Math.max(...logits);
  const weights = Array.from(logits, (logit) => Math.exp(logit - most));
  let left = random * weights.reduce((sum, weight) => sum + weight, 0);
  return weights.findIndex((weight) => weight > 0 && (left -= weight) < 0);
}

let longest = 0, length = 0;
for (const [number, step] of steps.entries()) {
  const found = await run(step, seen[step.frame]);
  const logits = found.logits.data;
  assert.equal(drawn(logits, step.random), step.action, `step ${number}`);
  assert.equal(found.action.data[0], logits.indexOf(Math.max(...logits)), `step ${number}`);
  kept.state = found.next_state;
  kept.condition = found.next_condition;
  length = step.first ? 1 : length + 1;
  longest = Math.max(longest, length);
}
assert.ok(longest >= 30);
console.log(`${steps.length} actions are those of the services; the longest episode has ${longest} steps`);
