// SPDX-License-Identifier: Apache-2.0
// Reads an MCAP file with the official reader, from its index and as a stream, and decodes every message by the schema
// that the file itself carries. Prints what it found as JSON; the first thing that is wrong is one line on stderr.
//   node tests/npm/check_mcap.mjs FILE.mcap [PICTURES.mjpg]
// PICTURES.mjpg: the pictures of /holdfast/camera must be those of this file, byte for byte and in its order.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { crc32 } from "@foxglove/crc";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

function fail(what, cause, next) {
  console.error(`error: ${what} (${cause}). Next: ${next}`);
  process.exit(1);
}
const wrong = (what) => fail(what, "our writer, or the file was changed", "look at it with holdfast log info");
const same = (what, a, b) => {
  if (a !== b) wrong(`${what}: ${a} and ${b}`);
};
const hash = (bytes) => createHash("sha256").update(bytes).digest("hex");

// A picture begins with FF D8 FF, which entropy-coded bytes cannot hold.
function picturesOf(bytes) {
  const starts = [];
  for (let i = 0; i + 2 < bytes.length; ++i) {
    if (bytes[i] === 0xff && bytes[i + 1] === 0xd8 && bytes[i + 2] === 0xff) starts.push(i);
  }
  return starts.map((start, i) => hash(bytes.subarray(start, starts[i + 1] ?? bytes.length)));
}

// One message of a channel: what both ways of reading must agree on, and what it says.
class Decoder {
  constructor() {
    this.readers = new Map();
  }
  read(channel, schema, message) {
    if (!this.readers.has(channel.id)) {
      same(`${channel.topic}: encodings`, `${schema.encoding} ${channel.messageEncoding}`, "ros2msg cdr");
      const definitions = parse(new TextDecoder("utf-8", { fatal: true }).decode(schema.data), { ros2: true });
      this.readers.set(channel.id, new MessageReader(definitions));
    }
    const said = this.readers.get(channel.id).readMessage(message.data);
    const { sec, nanosec, nsec } = said.header?.stamp ?? said.texts[0].timestamp;
    const stamp = BigInt(sec) * 1000000000n + BigInt(nanosec ?? nsec);
    same(`${channel.topic}: time and stamp`, message.logTime, stamp);
    return said;
  }
}

const [file, pictures] = process.argv.slice(2);
if (file === undefined) fail("no file given", "something left out", "node tests/npm/check_mcap.mjs FILE.mcap [PICTURES.mjpg]");
const bytes = readFileSync(file);
const reader = await McapIndexedReader.Initialize({
  readable: {
    size: async () => BigInt(bytes.length),
    read: async (offset, size) => new Uint8Array(bytes.subarray(Number(offset), Number(offset + size))),
  },
}).catch((error) => wrong(`${file}: ${error.message}`));

// By the index. CRCs of chunks are checked here as well.
const decoder = new Decoder();
const topics = new Map();
const listed = [];
const found = [];
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  const said = decoder.read(channel, schema, message);
  const topic = topics.get(channel.topic) ?? { schema: schema.name, messages: 0, first_ns: message.logTime, last_ns: message.logTime };
  topic.messages += 1;
  topic.last_ns = message.logTime;
  topics.set(channel.topic, topic);
  listed.push(`${channel.topic} ${message.sequence} ${message.logTime} ${hash(message.data)}`);
  if (schema.name === "sensor_msgs/msg/CompressedImage") {
    const jpeg = said.data;
    same("format of a picture", said.format, "jpeg");
    same("SOI of a picture", `${jpeg[0]} ${jpeg[1]}`, "255 216");
    same("EOI of a picture", `${jpeg.at(-2)} ${jpeg.at(-1)}`, "255 217");
    found.push(hash(jpeg));
  } else if (schema.name === "holdfast_msgs/msg/SlipState") {
    topic.slips = (topic.slips ?? 0) + (said.slip ? 1 : 0);
    topic.accepted = (topic.accepted ?? 0) + (said.accepted ? 1 : 0);
    topic.states = { ...topic.states, [said.state_name]: said.state };
    same("markers and the sum of the histogram", said.features_valid ? said.markers : 0, said.histogram.reduce((a, b) => a + b, 0));
  } else if (schema.name === "holdfast_msgs/msg/MarkerField") {
    topic.markers = (topic.markers ?? 0) + said.x_px.length;
    for (const name of ["row", "col", "valid", "y_px", "dx_px", "dy_px"]) {
      same(`length of ${name} and x_px`, said[name].length, said.x_px.length);
    }
  }
}

// As a stream: the same messages, whatever the index says.
const stream = new McapStreamReader({ validateCrcs: true, includeChunks: true });
stream.append(bytes);
const schemas = new Map();
const channels = new Map();
const streamed = [];
let chunks = 0;
let dataEnd;
for (let record; (record = stream.nextRecord()) !== undefined; ) {
  if (record.type === "Schema") schemas.set(record.id, record);
  if (record.type === "Channel") channels.set(record.id, record);
  if (record.type === "Chunk") chunks += 1;
  if (record.type === "DataEnd") dataEnd = record;
  if (record.type !== "Message") continue;
  const channel = channels.get(record.channelId);
  decoder.read(channel, schemas.get(channel.schemaId), record);
  streamed.push(`${channel.topic} ${record.sequence} ${record.logTime} ${hash(record.data)}`);
}
same("read to its end", stream.done() && stream.bytesRemaining() === 0, true);
same("messages by index and as a stream", hash(listed.sort().join("\n")), hash(streamed.sort().join("\n")));

// What the reader does not check: the sum over the data, and the counts.
const statistics = reader.statistics ?? wrong("no statistics");
const end = Number(reader.footer.summaryStart) - (1 + 8 + 4);
same("sum over the data", dataEnd.dataSectionCrc, crc32(bytes.subarray(0, end)));
same("messages counted", statistics.messageCount, BigInt(listed.length));
same("chunks counted", statistics.chunkCount, chunks);
same("chunks indexed", reader.chunkIndexes.length, chunks);
same("channels counted", statistics.channelCount, channels.size);
same("schemas counted", statistics.schemaCount, schemas.size);
for (const channel of channels.values()) {
  same(`${channel.topic} counted`, statistics.channelMessageCounts.get(channel.id), BigInt(topics.get(channel.topic)?.messages ?? 0));
}
if (pictures !== undefined) {
  const sent = picturesOf(readFileSync(pictures));
  same("number of pictures and of those sent", found.length, sent.length);
  found.forEach((picture, i) => same(`picture ${i}`, picture, sent[i]));
}

const plain = (_, value) => (typeof value === "bigint" ? Number(value) : value);
const out = {
  profile: reader.header.profile,
  library: reader.header.library,
  bytes: bytes.length,
  chunks,
  messages: listed.length,
  first_ns: statistics.messageStartTime,
  last_ns: statistics.messageEndTime,
  pictures: found.length,
  channels: Object.fromEntries([...topics].sort(([a], [b]) => (a < b ? -1 : 1))),
};
console.log(JSON.stringify(out, plain));
