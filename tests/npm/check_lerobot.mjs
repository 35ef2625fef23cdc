// SPDX-License-Identifier: Apache-2.0
// A dataset that toolchain/python writes of recordings (holdfast.lerobot), read by others: Parquet by hyparquet, the
// recordings by the official MCAP reader, and the folder by LeRobot's own rules of layout v2.1: paths by the templates of
// info.json, features by name, type and shape, times at exactly 1/fps (its tolerance is 0.1 ms), running numbers.
//   node tests/npm/check_lerobot.mjs --bin FOLDER
// The last line is "N passed"; status 77: something is not installed.
import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const top = resolve(dirname(fileURLToPath(import.meta.url)), "../..");
const bin = resolve(process.argv[process.argv.indexOf("--bin") + 1] ?? "");
if (process.argv.indexOf("--bin") < 0 || !existsSync(join(bin, "holdfast"))) {
  console.error(`error: no holdfast in ${bin} (not built, or --bin was forgotten). Next: --bin build/sim/bin`);
  process.exit(1);
}
const skip = (what, next) => {
  console.log(`SKIPPED: no ${what}. Next: ${next}`);
  process.exit(77);
};
const parquet = await import("hyparquet").catch(() => skip("tests/npm/node_modules/hyparquet", "npm ci in tests/npm"));
const { McapIndexedReader } = await import("@mcap/core");
const { parse } = await import("@foxglove/rosmsg");
const { MessageReader } = await import("@foxglove/rosmsg2-serialization");
try {
  execFileSync("python3", ["-c", ""]);
} catch {
  skip("python3", "apt-get install python3");
}

let passed = 0;
const same = (what, got, wanted) => {
  const [a, b] = [got, wanted].map((value) => JSON.stringify(value));
  if (a !== b) {
    console.error(`error: ${what}: ${a}, not ${b} (our writer). Next: look at toolchain/python/holdfast/lerobot.py`);
    process.exit(1);
  }
  passed += 1;
};
const work = mkdtempSync(join(tmpdir(), "holdfast-"));
process.on("exit", () => rmSync(work, { recursive: true }));

// Messages of a topic by the official reader.
async function messages(path, topic) {
  const bytes = readFileSync(path);
  const read = async (offset, size) => new Uint8Array(bytes.subarray(Number(offset), Number(offset + size)));
  const reader = await McapIndexedReader.Initialize({ readable: { size: async () => BigInt(bytes.length), read } });
  const found = [];
  let decoder;
  for await (const message of reader.readMessages({ topics: [topic] })) {
    const schema = reader.schemasById.get(reader.channelsById.get(message.channelId).schemaId);
    decoder ??= new MessageReader(parse(new TextDecoder().decode(schema.data), { ros2: true }));
    found.push(decoder.readMessage(message.data));
  }
  return found;
}
const rows = async (path) => {
  const bytes = readFileSync(path);
  return parquet.parquetReadObjects({ file: bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length) });
};
const lines = (path) => readFileSync(path, "utf8").trimEnd().split("\n").map((line) => JSON.parse(line));

// Two recordings of different lengths, of which one slips.
const scenes = ["sphere_slip", "bumps_hold"];
const logs = scenes.map((scene) => join(work, `${scene}.mcap`));
scenes.forEach((scene, k) =>
  execFileSync(join(bin, "holdfast"), ["sim", join(top, `tests/scenes/${scene}.json`), "--mcap", logs[k]], { stdio: "ignore" }),
);
const out = join(work, "dataset");
const run = ["-m", "holdfast.lerobot", out, ...logs, "--task", "hold the ball"];
execFileSync("python3", run, { env: { ...process.env, PYTHONPATH: join(top, "toolchain/python"), PYTHONDONTWRITEBYTECODE: "1" } });

const info = JSON.parse(readFileSync(join(out, "meta/info.json"), "utf8"));
const episodes = lines(join(out, "meta/episodes.jsonl"));
const stats = lines(join(out, "meta/episodes_stats.jsonl"));
same("version", info.codebase_version, "v2.1");
same("fps", info.fps, 25);
same("tasks", lines(join(out, "meta/tasks.jsonl")), [{ task_index: 0, task: "hold the ball" }]);
same("split", info.splits, { train: `0:${scenes.length}` });
const indices = ["timestamp", "frame_index", "episode_index", "index", "task_index"];
same("features", Object.keys(info.features), ["observation.state", "observation.markers", ...indices]);
const names = info.features["observation.state"].names;

let index = 0;
for (const [episode, log] of logs.entries()) {
  const path = info.data_path
    .replace("{episode_chunk:03d}", String(Math.floor(episode / info.chunks_size)).padStart(3, "0"))
    .replace("{episode_index:06d}", String(episode).padStart(6, "0"));
  const found = await rows(join(out, path));
  const slip = await messages(log, "/holdfast/slip");
  const fields = new Map((await messages(log, "/holdfast/markers")).map((field) => [field.frame, field]));
  same("rows: a simulated grasp has no gap", found.length, slip.length);
  same("length", episodes[episode], { episode_index: episode, tasks: ["hold the ball"], length: found.length });
  same("columns", Object.keys(found[0]), Object.keys(info.features));
  let worst = 0;
  for (const [k, row] of found.entries()) {
    for (const [name, feature] of Object.entries(info.features)) {
      if ((row[name].length ?? 1) !== feature.shape[0]) same(`shape of ${name}`, row[name].length, feature.shape[0]);
    }
    const numbers = [row.frame_index, row.episode_index, row.index, row.task_index].map(Number);
    const wanted = [k, episode, index + k, 0];
    if (numbers.some((n, i) => n !== wanted[i])) same("numbers of a row", numbers, wanted);
    worst = Math.max(worst, Math.abs(row.timestamp - k / info.fps));
    const state = names.map((name) => Math.fround(Number(slip[k][name])));
    if (state.some((value, i) => value !== row["observation.state"][i])) same(`state of row ${k}`, row["observation.state"], state);
    const field = fields.get(slip[k].frame);
    const seen = (i, values) => (field?.valid[i] ? values[i] : 0);
    const markers = Array.from({ length: 63 }, (_, i) => [seen(i, field?.dx_px), seen(i, field?.dy_px)]).flat();
    if (markers.some((value, i) => value !== row["observation.markers"][i])) same(`markers of row ${k}`, row["observation.markers"], markers);
  }
  same("times within a tenth of LeRobot's tolerance", worst < 1e-5, true);
  passed += found.length;
  // Statistics from the cells that were read: of the speed of entropy, and of a scalar.
  const rate = found.map((row) => row["observation.state"][names.indexOf("entropy_rate_nat_s")]);
  const said = stats[episode].stats;
  const mean = rate.reduce((a, b) => a + b, 0) / rate.length;
  const std = Math.sqrt(rate.reduce((a, b) => a + (b - mean) ** 2, 0) / rate.length);
  const at = (key) => said["observation.state"][key][names.indexOf("entropy_rate_nat_s")];
  // 1e-6: the cells are float32, the statistics of doubles.
  const close = (a, b) => Math.abs(a - b) <= 1e-6 * Math.max(1, Math.abs(b));
  same("statistics", [close(at("mean"), mean), close(at("std"), std), close(at("min"), Math.min(...rate)), close(at("max"), Math.max(...rate))], [true, true, true, true]);
  same("statistics of a scalar", [said.frame_index.min, said.frame_index.max, said.frame_index.count], [[0], [found.length - 1], [found.length]]);
  index += found.length;
}
same("frames", [info.total_frames, info.total_episodes, info.total_chunks], [index, logs.length, 1]);
same("the grasp that slips does", (await rows(join(out, "data/chunk-000/episode_000000.parquet"))).some((row) => row["observation.state"][names.indexOf("slip")] === 1), true);
console.log(`${passed} passed`);
