// SPDX-License-Identifier: Apache-2.0
// `holdfast live` end to end in Debian's Chromium: a scene is played before the camera, the firmware decides, the page
// shows, and what it showed is held against what the same run recorded.
//   node check_live.mjs [--bin DIR] [--shots DIR]
// The last line is "N passed"; exit status 77 when Chromium or node_modules is missing.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { request } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { McapStreamReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { barriers, drawn, folders, launch, near, root, scrub } from "./browser.mjs";

const { bin, shots } = folders();
const work = mkdtempSync(join(tmpdir(), "holdfast_live_"));

let checks = 0;
async function check(name, act) {
  await act();
  ++checks;
  console.log(`ok   ${name}`);
}

// --- the desk ---

const chrome = await launch();
const recording = join(work, "live.mcap");
const scene = join(root, "tests/scenes/sphere_slip.json");
const desk = spawn(join(bin, "holdfast"), ["live", "--play", scene, "--port", "0", "--record", recording]);
const ended = new Promise((done) => desk.on("exit", done));
process.on("exit", () => {
  desk.kill("SIGKILL");
  rmSync(work, { recursive: true, force: true });
});
let said = "";
desk.stdout.on("data", (bytes) => (said += bytes));
desk.stderr.on("data", (bytes) => (said += bytes));
const until = async (what, test, seconds = 30) => {
  for (const end = Date.now() + seconds * 1000; Date.now() < end; ) {
    const found = await test();
    if (found) return found;
    await new Promise((next) => setTimeout(next, 20));
  }
  throw new Error(`${what}: not within ${seconds} s. It said:\n${said}`);
};
const [control, view] = await until("the addresses", () => {
  const found = [...said.matchAll(/http:\/\/127\.0\.0\.1:\d+\/#[0-9a-f]{32}/g)].map((m) => m[0]);
  return found.length === 2 ? found : null;
});
const { origin, port, hash } = new URL(control);

// --- who may do what ---

// As fetch() will not: with any Host and Origin.
const status = (path, headers = {}, body = null) =>
  new Promise((done, failed) => {
    const asked = request({ host: "127.0.0.1", port, path, headers, method: body === null ? "GET" : "POST" }, (answer) => {
      answer.destroy();
      done(answer.statusCode);
    });
    asked.on("error", failed);
    asked.end(body);
  });
const bearer = (address) => ({ Authorization: `Bearer ${new URL(address).hash.slice(1)}` });

await check("the stream, the picture and the console want a token; a page of another origin gets nothing", async () => {
  for (const path of ["/stream", "/picture", "/picture?after=0"]) {
    assert.equal(await status(path), 401);
    assert.equal(await status(path, { Authorization: `Bearer ${"0".repeat(32)}` }), 401);
  }
  assert.equal(await status("/send", {}, "status"), 401);
  assert.equal(await status("/send", bearer(view), "status"), 403);
  assert.equal(await status("/", { Host: "example.com" }), 403);
  assert.equal(await status("/stream", { ...bearer(control), Host: `example.com:${port}` }), 403);
  assert.equal(await status("/send", { ...bearer(control), Origin: "http://example.com" }, "status"), 403);
  assert.equal(await status("/send", bearer(control), "status\r\ndefaults"), 400);
  assert.equal(await status("/send", bearer(control), "x".repeat(5000)), 413);
  assert.equal(await status("/nowhere", bearer(control)), 404);
});

// --- the page ---

const browser = await chrome.newContext({ viewport: { width: 1400, height: 900 } });
async function open(address) {
  const page = await browser.newPage();
  page.said = [];
  page.asked = [];
  page.on("console", (message) => ["error", "warning"].includes(message.type()) && page.said.push(message.text()));
  page.on("pageerror", (error) => page.said.push(String(error)));
  page.on("request", (asked) => page.asked.push(asked.url()));
  await page.goto(address);
  return page;
}
const text = (page, id) => page.locator(`#${id}`).textContent();
const page = await open(control);
const kFactor = 10; // of the arrows

await check("it connects by itself, shows the picture, and says what the verdict stands on", async () => {
  await page.waitForFunction(() => document.getElementById("live-state").textContent === "Connected");
  await page.waitForFunction(() => document.getElementById("shot").naturalWidth === 410);
  await page.waitForFunction(() => /^Contact (EMPTY|TOUCHING|HELD)\. Evidence: \w+ [\d.]+ of [\d.]+ um/.test(document.getElementById("why").textContent));
  await page.waitForFunction(() => document.getElementById("state").textContent === "SLIP");
});

await check("its console answers, changes what it may, and asks for no unlock", async () => {
  await page.locator("#line").fill("set raise_frames 3");
  await page.locator("#line").press("Enter");
  await page.waitForFunction(() => /> set raise_frames 3[^]*OK/.test(document.getElementById("console").textContent));
  await page.locator("#ask-parameters").click();
  await page.waitForFunction(() => document.querySelector('#parameters input[aria-label="raise_frames"]')?.value === "3");
  const field = page.locator('#parameters input[aria-label="raise_frames"]');
  await field.fill("2");
  await field.press("Tab");
  await page.waitForFunction(() => /> set raise_frames 2[^]*OK/.test(document.getElementById("console").textContent));
  assert.doesNotMatch(await text(page, "console"), /ERR|evidence_value|pitch_px/);
});

await check("a second page may look and not touch", async () => {
  const other = await open(view);
  await other.waitForFunction(() => document.getElementById("live-state").textContent === "Connected, to look only");
  await other.waitForFunction(() => document.getElementById("shot").naturalWidth === 410);
  assert.ok(await other.locator("#line").isDisabled());
  assert.ok(await other.locator("#tare").isDisabled());
  assert.deepEqual(other.said, []);
  await other.close();
});

await check("at 390 and 1400 px, light and dark: no sideways scroll, nothing said, nothing asked elsewhere", async () => {
  for (const width of [390, 1400]) {
    for (const colorScheme of ["light", "dark"]) {
      await page.setViewportSize({ width, height: 900 });
      await page.emulateMedia({ colorScheme });
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      assert.equal(wide, 0, `${width} px: ${wide} px too wide`);
      assert.deepEqual(await barriers(page), []);
      if (shots !== null) await page.screenshot({ path: join(shots, `live_${width}_${colorScheme}.png`), fullPage: true });
    }
  }
  assert.deepEqual(page.said, []);
  assert.deepEqual(page.asked.filter((url) => !url.startsWith(`${origin}/`) && !url.startsWith("blob:")), []);
  assert.ok(page.asked.every((url) => !url.includes(hash.slice(1))), "the token stands in no request's address");
});

// What the page shows of some frames, standing still; held below against the recording of the same run.
const shown = [];
await until("three arrows' worth of a round", async () => Number(await page.locator("#scrub").getAttribute("max")) > 120);
await page.locator("#play").click();
await page.locator("#factor").evaluate((input) => {
  input.value = 10;
  input.dispatchEvent(new Event("input", { bubbles: true }));
});
const last = Number(await page.locator("#scrub").getAttribute("max"));
for (let at = 1; at < last; ++at) {
  await scrub(page, at);
  if ((await text(page, "shot-note")).includes("arrows of")) continue;
  // A status frame that tells of an overdue picture, a second after the last field: the recording holds pictures only.
  if ((await text(page, "gel-note")) === "no markers in this frame") continue;
  const [, frame] = (await text(page, "when")).match(/^frame (\d+) /);
  shown.push({ frame: Number(frame), state: await text(page, "state"), ...(await drawn(page)) });
}

await check("the end of the desk is told, and what was received stays", async () => {
  desk.kill("SIGINT");
  assert.equal(await ended, 0);
  await page.waitForFunction(() => document.getElementById("live-state").textContent.startsWith("holdfast live has ended"));
  assert.equal(Number(await page.locator("#scrub").getAttribute("max")), last);
});

await check("arrows and states on the page are those of the recording, frame by frame", async () => {
  const reader = new McapStreamReader();
  reader.append(readFileSync(recording));
  const schemas = new Map();
  const channels = new Map();
  const markers = new Map();
  const states = new Map();
  let about = null;
  for (let record = reader.nextRecord(); record !== undefined; record = reader.nextRecord()) {
    if (record.type === "Schema") schemas.set(record.id, new MessageReader(parse(new TextDecoder().decode(record.data), { ros2: true })));
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type === "Metadata") about = Object.fromEntries(record.metadata);
    if (record.type !== "Message") continue;
    const { topic, schemaId } = channels.get(record.channelId);
    if (topic === "/holdfast/camera" || topic === "/holdfast/annotations") continue;
    const message = schemas.get(schemaId).readMessage(record.data);
    (topic === "/holdfast/markers" ? markers : states).set(message.frame, message);
  }
  assert.match(about.source, /sphere_slip\.json/);
  assert.match(about.pictures, /encoded as JPEG/);
  near(Number(about.started_unix_ns) / 1e9, Date.now() / 1000, 120, "the wall clock");
  assert.ok(shown.length >= 10, `${shown.length} fields were shown`);
  let compared = 0;
  for (const { frame, state, width, arrows } of shown) {
    // The recording numbers its frames as the status frames are.
    const want = markers.get(frame);
    assert.ok(want !== undefined, `frame ${frame} is recorded`);
    assert.equal(state, states.get(frame).state_name);
    const px = width / 410; // of the drawing, for each of the working picture
    arrows.forEach((arrow, i) => {
      assert.equal(arrow !== null, want.valid[i] === 1);
      if (arrow === null) return;
      const dx = arrow.to[0] - arrow.from[0];
      const dy = arrow.to[1] - arrow.from[1];
      const [wantDx, wantDy] = [want.dx_px[i] * px * kFactor, want.dy_px[i] * px * kFactor];
      // An arrow shorter than a unit is not drawn. The link rounds to a micrometre, 0.2 units; pitch_px to 1/3000.
      if (dx === 0 && dy === 0) return near(Math.hypot(wantDx, wantDy), 0, 1.3, `frame ${frame}, marker ${i}`);
      near(dx, wantDx, 0.3 + 0.001 * Math.abs(wantDx), `frame ${frame}, marker ${i}, dx`);
      near(dy, wantDy, 0.3 + 0.001 * Math.abs(wantDy), `frame ${frame}, marker ${i}, dy`);
      near(arrow.from[0], (want.x_px[i] - want.dx_px[i] + 0.5) * px, 0.2, `frame ${frame}, marker ${i}, x`);
      near(arrow.from[1], (want.y_px[i] - want.dy_px[i] + 0.5) * px, 0.2, `frame ${frame}, marker ${i}, y`);
      ++compared;
    });
  }
  assert.ok(compared > 500, `${compared} arrows were compared`);
});

await chrome.close();
console.log(`${checks} passed`);
