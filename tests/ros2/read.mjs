// SPDX-License-Identifier: Apache-2.0
// node read.mjs FILE.mcap EXPECTED.json: reads a file of profile ros2 and decodes each message by the schema in the file. All
// must be as EXPECTED.json says (tests/ros2/sample.cc), and the schemas as ROS 2's own definitions are.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import { parse } from "@foxglove/rosmsg";
import { ros2humble } from "@foxglove/rosmsg-msgs-common";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";

const bytes = new Uint8Array(await readFile(process.argv[2]));
const expected = JSON.parse(await readFile(process.argv[3], "utf8"));

const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, size) => bytes.slice(Number(offset), Number(offset + size)),
};
const file = await McapIndexedReader.Initialize({ readable });
assert.equal(file.header.profile, "ros2");

// Fields and constants in their order; defaults are not on the wire.
const shape = (definition) =>
  definition.definitions.map(({ type, name, isArray, arrayLength, isConstant, value }) =>
    isConstant ? `${type} ${name}=${value}` : `${type}${isArray ? `[${arrayLength ?? ""}]` : ""} ${name}`);
const decoders = new Map();
for (const schema of file.schemasById.values()) {
  assert.equal(schema.encoding, "ros2msg");
  assert.match(schema.name, /^[a-z_]+\/msg\/[A-Z]\w*$/);
  const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
  definitions[0].name ??= schema.name.replace("/msg/", "/");
  for (const definition of definitions) {
    const official = ros2humble[definition.name];
    assert.ok(official, `${definition.name} is not a type of ROS 2`);
    assert.deepEqual(shape(definition), shape(official), definition.name);
  }
  decoders.set(schema.id, new MessageReader(definitions));
}

// As JSON has it.
function plain(value) {
  if (typeof value === "number") return Number.isNaN(value) ? null : value;
  if (ArrayBuffer.isView(value)) return Array.from(value, plain);
  if (typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([name, field]) => [name === "nsec" ? "nanosec" : name, plain(field)]));
}
const byTopic = (messages) => messages.sort((a, b) => (a.topic < b.topic ? -1 : a.topic > b.topic ? 1 : a.time < b.time ? -1 : 1));

const read = [];
for await (const message of file.readMessages()) {
  const channel = file.channelsById.get(message.channelId);
  assert.equal(channel.messageEncoding, "cdr");
  assert.ok(channel.metadata.has("offered_qos_profiles"));
  assert.match(channel.metadata.get("topic_type_hash"), /^RIHS01_[0-9a-f]{64}$/);
  const fields = plain(decoders.get(channel.schemaId).readMessage(message.data));
  read.push({ topic: channel.topic, type: file.schemasById.get(channel.schemaId).name, time: String(message.logTime), fields });
}
assert.equal(file.statistics.messageCount, BigInt(read.length));
assert.deepEqual(byTopic(read), byTopic(expected));
console.log(`${read.length} messages of ${new Set(read.map(({ type }) => type)).size} types on ${file.channelsById.size} topics`);
