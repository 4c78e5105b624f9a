// node read.mjs FILE.mcap: reads it by its indexes and from its beginning to its end, decodes each message by the schema in
// the file, and compares all with FILE.mcap.json, which says what was written (tests/mcap/sample.cc).
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import { parseIDL } from "@foxglove/omgidl-parser";
import { MessageReader } from "@foxglove/omgidl-serialization";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";

const path = process.argv[2];
const bytes = new Uint8Array(await readFile(path));
const wanted = JSON.parse(await readFile(`${path}.json`, "utf8"));

const decoders = new Map();
function decode(schema, data) {
  assert.equal(schema.encoding, "omgidl");
  let decoder = decoders.get(schema.name);
  if (!decoder) {
    decoder = new MessageReader(schema.name, parseIDL(new TextDecoder().decode(schema.data)));
    decoders.set(schema.name, decoder);
  }
  return decoder.readMessage(data);
}

function check(message, channel, schema, expected) {
  const where = `${expected.topic} at ${expected.time}`;
  assert.equal(channel.topic, expected.topic, where);
  assert.equal(schema.name, expected.type, where);
  assert.equal(channel.messageEncoding, "cdr", where);
  assert.equal(message.logTime, BigInt(expected.time), where);
  assert.equal(Buffer.from(message.data).toString("hex"), expected.data, where);
  const decoded = decode(schema, message.data);
  assert.equal(decoded.header.session, expected.run, where);
  assert.equal(decoded.header.sender, expected.sender, where);
  assert.equal(decoded.header.incarnation, BigInt(expected.incarnation), where);
  for (const [name, value] of Object.entries(expected.fields)) assert.equal(String(decoded[name]), value, `${where}: ${name}`);
}

// By its indexes: schemas, channels and statistics of the summary, messages through the indexes of chunks.
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, size) => bytes.slice(Number(offset), Number(offset + size)),
};
const indexed = await McapIndexedReader.Initialize({ readable });
assert.match(indexed.header.library, /^citylearn /);
assert.equal(indexed.statistics.messageCount, BigInt(wanted.messages.length));
assert.equal(indexed.statistics.chunkCount, indexed.chunkIndexes.length);
assert.ok(indexed.chunkIndexes.length > 1);
let read = 0;
for await (const message of indexed.readMessages()) {
  const channel = indexed.channelsById.get(message.channelId);
  check(message, channel, indexed.schemasById.get(channel.schemaId), wanted.messages[read++]);
}
assert.equal(read, wanted.messages.length);
const topic = wanted.messages[0].topic;
let ofTopic = 0;
for await (const message of indexed.readMessages({ topics: [topic] })) {
  assert.equal(indexed.channelsById.get(message.channelId).topic, topic);
  ofTopic++;
}
assert.equal(ofTopic, wanted.messages.filter((message) => message.topic === topic).length);
let abouts = 0;
for await (const about of indexed.readMetadata({ name: "recording" })) {
  assert.equal(about.metadata.get("run"), "demo");
  abouts++;
}
assert.equal(abouts, 1);

// From its beginning to its end; checksums of chunks are compared.
const stream = new McapStreamReader({ validateCrcs: true });
stream.append(bytes);
const schemas = new Map(), channels = new Map();
let streamed = 0;
for (let record; (record = stream.nextRecord()); ) {
  if (record.type === "Schema") schemas.set(record.id, record);
  if (record.type === "Channel") channels.set(record.id, record);
  if (record.type !== "Message") continue;
  const channel = channels.get(record.channelId);
  check(record, channel, schemas.get(channel.schemaId), wanted.messages[streamed++]);
}
assert.ok(stream.done());
assert.equal(streamed, wanted.messages.length);
assert.equal(decoders.size, wanted.types);
console.log(`${read} messages of ${decoders.size} types, in ${indexed.chunkIndexes.length} chunks`);
