// SPDX-License-Identifier: Apache-2.0
// The layouts for Foxglove and PlotJuggler name only what a log has, and our definition of ImageAnnotations is Foxglove's.
//   node tests/npm/check_layouts.mjs FILE.mcap FILE.csv
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { parse } from "@foxglove/rosmsg";
import { foxgloveMessageSchemas, generateRosMsgDefinition } from "@foxglove/schemas/internal.js";
import { McapStreamReader } from "@mcap/core";

const layouts = new URL("../../toolchain/log/layouts/", import.meta.url);
const [mcap, csv] = process.argv.slice(2);
const reader = new McapStreamReader();
reader.append(readFileSync(mcap));
const schemas = new Map();
const topics = new Map();
for (let record; (record = reader.nextRecord()) !== undefined; ) {
  if (record.type === "Schema") schemas.set(record.id, parse(new TextDecoder().decode(record.data), { ros2: true }));
  if (record.type === "Channel") topics.set(record.topic, schemas.get(record.schemaId));
}

// Every topic, and every field behind one, of the layout's own words.
const layout = JSON.parse(readFileSync(new URL("foxglove.json", layouts), "utf8"));
let paths = 0;
JSON.stringify(layout, (key, value) => {
  for (const text of [key, value]) {
    if (typeof text !== "string" || !text.startsWith("/")) continue;
    const [topic, field] = text.split(".");
    assert.ok(topics.has(topic), `foxglove.json: ${topic} is no topic of a log`);
    const [message] = topics.get(topic);
    if (field !== undefined) assert.ok(message.definitions.some((one) => one.name === field), `foxglove.json: ${topic} has no ${field}`);
    ++paths;
  }
  return value;
});
assert.ok(paths >= 10, `${paths} paths`);
const panels = new Set();
JSON.stringify(layout.layout, (key, value) => {
  if (key === "first" || key === "second") typeof value === "string" && panels.add(value);
  return value;
});
assert.deepEqual([...panels].sort(), Object.keys(layout.configById).sort());

const columns = readFileSync(csv, "utf8").split("\n")[0].split(",");
const curves = [...readFileSync(new URL("plotjuggler.xml", layouts), "utf8").matchAll(/<curve name="([^"]+)"/g)].map((m) => m[1]);
assert.ok(curves.length >= 8);
for (const curve of curves) assert.ok(columns.includes(curve), `plotjuggler.xml: ${curve} is no column of --log`);

// Newer versions of Foxglove's schemas have more fields behind ours; what is there must be theirs, in their order.
const plain = ({ type, name, isArray }) => `${type} ${name} ${isArray ? "[]" : ""}`;
let messages = 0;
for (const { name, definitions } of topics.get("/holdfast/annotations")) {
  const short = (name ?? "foxglove_msgs/ImageAnnotations").split("/").at(-1);
  if (!(short in foxgloveMessageSchemas)) continue;
  const theirs = generateRosMsgDefinition(foxgloveMessageSchemas[short], { rosVersion: 2 }).fields.filter((field) => !field.isConstant);
  assert.deepEqual(definitions.map(plain), theirs.slice(0, definitions.length).map(plain), short);
  ++messages;
}
assert.ok(messages >= 6, `${messages} messages`);
console.log(`layouts: ${paths} paths and ${curves.length} curves are in a log; ${messages} messages are as Foxglove defines them`);
