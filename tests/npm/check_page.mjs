// SPDX-License-Identifier: Apache-2.0
// The page of a session in Debian's Chromium: of a simulated slip, and live through a port that plays recorded bytes.
//   node check_page.mjs [--bin DIR] [--shots DIR]
// --bin: where holdfast and session_bytes are (build/sim/bin). --shots: keep pictures of the page there.
// The last line is "N passed"; exit status 77 when Chromium or node_modules is missing.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { copyFileSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import { barriers, drawn, folders, launch, near, root, scrub } from "./browser.mjs";

const { bin, shots } = folders();
const work = mkdtempSync(join(tmpdir(), "holdfast_page_"));
process.on("exit", () => rmSync(work, { recursive: true, force: true }));

// --- what is shown: made by the tool, and by the firmware ---

const scene = join(root, "tests/scenes/sphere_slip.json");
const names = ["report.html", "markers.csv", "features.csv", "live.html", "bytes", "values"];
const files = Object.fromEntries(names.map((name) => [name, join(work, name)]));
const hostile = join(work, `"><img src=x onerror=alert(1)> & 'x'.json`);
const run = (name, ...args) => execFileSync(join(bin, name), args, { stdio: ["ignore", "ignore", "inherit"] });
const tables = ["--markers", files["markers.csv"], "--features", files["features.csv"]];
run("holdfast", "sim", scene, "--report", files["report.html"], ...tables);
copyFileSync(scene, hostile);
run("holdfast", "sim", hostile, "--report", join(work, "hostile.html"));
run("holdfast", "page", files["live.html"]);
run("session_bytes", scene, files.bytes, files.values);

function table(path) {
  const [head, ...lines] = readFileSync(path, "utf8").trim().split("\n");
  const names = head.split(",");
  return lines.map((line) => Object.fromEntries(line.split(",").map((cell, i) => [names[i], cell])));
}
const markersOf = new Map();
for (const m of table(files["markers.csv"])) {
  if (!markersOf.has(m.frame)) markersOf.set(m.frame, []);
  markersOf.get(m.frame).push(m);
}
const features = table(files["features.csv"]);
const values = JSON.parse(readFileSync(files.values, "utf8"));

// --- the browser ---

const chrome = await launch();
const browser = await chrome.newContext({ viewport: { width: 1280, height: 900 }, acceptDownloads: true });
let checks = 0;

// A page of its own; what it says to the console and asks of the network is counted.
async function open(path, { serial = null, width = 1280, dark = false } = {}) {
  const page = await browser.newPage();
  page.said = [];
  page.asked = [];
  page.on("console", (message) => ["error", "warning"].includes(message.type()) && page.said.push(message.text()));
  page.on("pageerror", (error) => page.said.push(String(error)));
  page.on("request", (request) => page.asked.push(request.url()));
  await page.setViewportSize({ width, height: 900 });
  await page.emulateMedia({ colorScheme: dark ? "dark" : "light" });
  if (serial === "none") await page.addInitScript(() => delete Navigator.prototype.serial);
  if (serial === "mock") await page.addInitScript(mockSerial, [...readFileSync(files.bytes)]);
  await page.goto(pathToFileURL(path).href);
  return page;
}

// A port that plays bytes in pieces of odd sizes. window.port: what the test tells it, and what it was told.
function mockSerial(bytes) {
  const sizes = [1, 7, 33, 64, 5, 255, 2, 129, 16];
  const mock = { sent: "", opened: null, closed: 0, controller: null, at: 0 };
  window.port = mock;
  mock.play = (upTo) => {
    for (let i = 0; mock.at < Math.min(upTo, bytes.length); ++i) {
      const piece = bytes.slice(mock.at, Math.min(mock.at + sizes[i % sizes.length], upTo));
      mock.at += piece.length;
      mock.controller.enqueue(Uint8Array.from(piece));
    }
  };
  mock.pull = () => {
    port.readable = port.writable = null;
    mock.controller.error(new DOMException("The device has been lost.", "NetworkError"));
  };
  // As Chromium does when a byte was garbled: the stream ends in an error, and the port has a new one.
  mock.garble = () => {
    const { controller } = mock;
    port.readable = new ReadableStream({ start: (next) => (mock.controller = next) });
    controller.error(new DOMException("Framing error", "FramingError"));
  };
  const port = {
    open: async (options) => {
      mock.opened = options;
      port.readable = new ReadableStream({ start: (controller) => (mock.controller = controller) });
      port.writable = new WritableStream({ write: (chunk) => void (mock.sent += new TextDecoder().decode(chunk)) });
    },
    close: async () => {
      ++mock.closed;
      port.readable = port.writable = null;
    },
    readable: null,
    writable: null,
  };
  Object.defineProperty(Navigator.prototype, "serial", { configurable: true, get: () => ({ requestPort: async () => port }) });
}

async function check(name, act) {
  await act();
  ++checks;
  console.log(`ok   ${name}`);
}
async function shoot(page, name) {
  if (shots === null) return;
  const size = page.viewportSize();
  await page.screenshot({ path: join(shots, `${name}_first.png`) });
  // As high as the page: what sticks to an edge of the window is then where it belongs.
  await page.setViewportSize({ width: size.width, height: await page.evaluate(() => document.documentElement.scrollHeight) });
  await page.screenshot({ path: join(shots, `${name}.png`) });
  await page.setViewportSize(size);
}
const text = (page, id) => page.locator(`#${id}`).textContent();
const clean = (words) => words.replace("\u2212", "-");
// --- a recording ---

const report = await open(files["report.html"]);
const kWidth = 3280; // of the scene's camera

await check("the report loads from disk: nothing said, nothing asked of the network", async () => {
  assert.ok(await report.locator("#picture").isVisible());
  assert.deepEqual(report.said, []);
  const outside = report.asked.filter((url) => !url.startsWith("file:") && !url.startsWith("blob:"));
  assert.deepEqual(outside, []);
  assert.equal(report.asked.filter((url) => url.startsWith("file:")).length, 1);
});

await check("it opens at the first slip", async () => {
  const first = features.findIndex((row) => row.slip === "1");
  assert.equal(await report.locator("#scrub").inputValue(), String(first));
  assert.equal(await text(report, "state"), "SLIP");
});

await check("the scrubber moves the arrows: every marker of every frame as in the markers CSV", async () => {
  await report.locator("#factor").evaluate((input) => {
    input.value = 7;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  });
  let arrows = 0;
  for (let i = 0; i < features.length; ++i) {
    await scrub(report, i);
    const got = await drawn(report);
    const want = markersOf.get(features[i].frame);
    if (want === undefined || want.every((m) => m.x_px === "")) {
      assert.equal(got, null, `frame ${i}`);
      continue;
    }
    const scale = got.width / kWidth;
    want.forEach((m, k) => {
      if (m.valid === "0") return assert.equal(got.arrows[k], null);
      const [x, y, dx, dy] = [m.x_px, m.y_px, m.dx_px, m.dy_px].map(Number);
      const rest = [(x - dx + 0.5) * scale, (y - dy + 0.5) * scale];
      // The file keeps 1/64 px of a picture 320 wide; an arrow shorter than a unit of the drawing is none.
      for (const axis of [0, 1]) {
        near(got.arrows[k].from[axis], rest[axis], 0.03, `frame ${i}, marker ${k}, rest`);
        const length = Math.hypot(dx, dy) * 7 * scale;
        const tip = rest[axis] + 7 * scale * (axis === 0 ? dx : dy);
        near(got.arrows[k].to[axis], tip, length < 1.3 ? 1.3 : 0.2, `frame ${i}, marker ${k}, tip`);
      }
      ++arrows;
    });
  }
  console.log(`     ${arrows} arrows of ${features.length} frames`);
  assert.ok(arrows > 3000);
});

await check("state, reason, lines, values and evidence are those of the features CSV", async () => {
  let reasons = 0;
  for (let i = 0; i < features.length; i += 3) {
    const want = features[i];
    await scrub(report, i);
    assert.equal(await text(report, "state"), want.state);
    const shown = {};
    for (const id of ["e", "rate", "vx", "vy", "markers"]) shown[id] = clean(await text(report, `value-${id}`));
    if (want.entropy_nat !== "") {
      near(Number(shown.e), Number(want.entropy_nat), 0.0006, "E");
      assert.equal(shown.markers, want.markers);
    } else {
      assert.equal(shown.e, "\u2013");
    }
    if (want.vx_mm_s !== "" && shown.vx !== "\u2013") near(Number(shown.vx), Number(want.vx_mm_s), 0.006, "Vx");
    const why = (await text(report, "why")).match(/^Contact (\w+)\. (?:No evidence yet|Evidence: (\w+) ([\d.]+) of ([\d.]+) (.*), (\d+) frames? in a row.*)\.$/);
    if (want.contact_phase !== "") {
      assert.ok(why !== null, `frame ${i}: '${await text(report, "why")}'`);
      assert.equal(why[1], want.contact_phase);
      assert.equal(why[2] ?? "", want.evidence);
      if (want.evidence !== "") {
        near(Number(why[3]), Number(want.evidence_value), 0.11, "evidence");
        near(Number(why[4]), Number(want.evidence_threshold), 0.11, "threshold");
        assert.deepEqual([why[5], why[6]], [want.evidence_unit, want.evidence_frames]);
        ++reasons;
      }
    }
    assert.ok((await text(report, "lamp-grip")).includes(want.grip_ok === "1" ? "HIGH" : "LOW"));
    assert.ok((await text(report, "lamp-decision")).includes(want.slip === "1" ? "slip" : "hold"));
  }
  assert.ok(reasons > 15, `${reasons} frames said why`);
});

await check("the cursor stands at the frame's time in the plots", async () => {
  const times = features.map((row) => Number(row.t_s));
  const [t0, last] = [times[0], times.at(-1)];
  const scale = 1000 / (2 * last - times.at(-2) - t0); // a frame's room behind the last one
  for (const i of [0, 40, features.length - 1]) {
    await scrub(report, i);
    const at = (await report.locator("#plots .cursor").getAttribute("d")).match(/M([\d.]+)/)[1];
    near(Number(at), 62 + (times[i] - t0) * scale, 0.02, "cursor");
    assert.ok((await text(report, "readout")).startsWith(`frame ${features[i].frame} `));
  }
});

await check("a press in the plots sets the frame", async () => {
  const plots = report.locator("#plots");
  await plots.scrollIntoViewIfNeeded();
  const box = await plots.boundingBox();
  await plots.click({ position: { x: box.width / 2, y: box.height / 2 } });
  const middle = Number(await report.locator("#scrub").inputValue());
  near(middle, features.length / 2, 3, "frame");
});

await check("keys: a frame, ten frames, the next slip, the first and the last frame", async () => {
  const value = () => report.locator("#scrub").inputValue().then(Number);
  await scrub(report, 10);
  await report.locator("#scrub").focus();
  await report.keyboard.press("ArrowRight");
  assert.equal(await value(), 11);
  await report.keyboard.press("Shift+ArrowRight");
  assert.equal(await value(), 21);
  await report.keyboard.press("ArrowLeft");
  assert.equal(await value(), 20);
  await report.keyboard.press("n");
  assert.equal(await value(), features.findIndex((row) => row.slip === "1"));
  await report.keyboard.press("End");
  assert.equal(await value(), features.length - 1);
  await report.keyboard.press("Home");
  assert.equal(await value(), 0);
  const label = await report.locator("#scrub").getAttribute("aria-valuetext");
  assert.ok(label.includes("frame 0"), label);
});

await check("it plays at its own speed, and pauses", async () => {
  await scrub(report, 0);
  await report.locator("#speed").selectOption("5");
  await report.locator("#play").click();
  await report.waitForFunction((last) => Number(document.getElementById("scrub").value) === last, features.length - 1, { timeout: 20000 });
  assert.equal(await report.locator("#play").getAttribute("aria-label"), "Play");
  await scrub(report, 0);
  await report.locator("#speed").selectOption("0.1");
  await report.keyboard.press("Escape");
  await report.locator("#play").click();
  await report.waitForTimeout(300);
  await report.locator("#play").click();
  const paused = Number(await report.locator("#scrub").inputValue());
  await report.waitForTimeout(300);
  assert.equal(Number(await report.locator("#scrub").inputValue()), paused);
  assert.ok(paused < 20, `frame ${paused} after 0.3 s at a tenth of the speed`);
});

await check("the picture is the frame's, or says whose it is", async () => {
  await scrub(report, 50);
  assert.ok(await report.locator("#shot").evaluate((img) => img.decode().then(() => img.naturalWidth)) >= 400);
  await report.locator("#show-picture").uncheck();
  assert.ok(!(await report.locator("#shot").isVisible()));
  await report.locator("#show-picture").check();
  const note = await text(report, "shot-note");
  const thinned = JSON.parse(await report.locator("#data").textContent()).every[2] > 1;
  assert.ok(thinned || note.trim() === "", note);
});

await check("latency is said to be unknown in virtual time", async () => {
  assert.ok((await text(report, "latency-note")).startsWith("Not known"));
});

await check("a distribution that is known is drawn, and what is thinned is said", async () => {
  const latency = { count: 83, p50_us: 4200, p99_us: 9900, max_us: 10300, range_us: 20000, bins: [0, 5, 40, 30, 8] };
  const told = readFileSync(files["report.html"], "utf8")
    .replace('"latency":null', `"latency":${JSON.stringify(latency)}`)
    .replace(/"every":\[\d+,\d+,\d+\]/, '"every":[2,4,8]');
  writeFileSync(join(work, "told.html"), told);
  const page = await open(join(work, "told.html"));
  assert.equal(await text(page, "latency-note"), "median 4.20, 99 % 9.90, most 10.3 ms");
  assert.equal(await page.locator("#latency rect").count(), 4);
  assert.ok((await text(page, "thinned")).includes("values of every second, markers of every 4th, pictures of every 8th frame"));
  assert.deepEqual(page.said, []);
  await shoot(page, "replay_latency_1280_light");
  await page.close();
});

await check("every control has a name", async () => {
  const nameless = await report.evaluate(() =>
    [...document.querySelectorAll("button, input, select, svg[role=img]")]
      .filter((e) => !(e.getAttribute("aria-label") || e.textContent.trim() || e.closest("label")))
      .map((e) => e.outerHTML.slice(0, 80)),
  );
  assert.deepEqual(nameless, []);
});

await check("the file is small", () => {
  const bytes = statSync(files["report.html"]).size;
  console.log(`     ${bytes} bytes`);
  assert.ok(bytes < 4e6);
});

await check("without a script verdict, alarms and tables are there", async () => {
  const plain = await chrome.newContext({ javaScriptEnabled: false });
  const page = await plain.newPage();
  await page.goto(pathToFileURL(files["report.html"]).href);
  for (const words of ["Over time", "Summary", "Reasons given", "Notes"]) {
    assert.ok(await page.getByRole("heading", { name: words }).isVisible(), words);
  }
  assert.ok(!(await page.locator("#picture").isVisible()));
  await plain.close();
});

await check("a hostile file name stays text", async () => {
  const page = await open(join(work, "hostile.html"));
  assert.deepEqual(page.said, []);
  assert.equal(await page.locator("img").count(), 1);
  assert.ok((await page.locator("header .sub").textContent()).includes("<img src=x onerror=alert(1)>"));
  await page.close();
});

await check("runs without pictures, without markers, with a camera that fails", async () => {
  for (const name of ["features_slip", "twist_hold", "fault_unplugged", "fault_torn", "lost_markers"]) {
    const path = join(work, `${name}.html`);
    run("holdfast", "sim", join(root, `tests/scenes/${name}.json`), "--report", path);
    const page = await open(path);
    const last = Number(await page.locator("#scrub").getAttribute("max"));
    for (let i = 0; i <= last; i += 5) await scrub(page, i);
    assert.deepEqual(page.said, [], name);
    const arrows = await drawn(page);
    const lit = await page.locator("#picture").evaluate((picture) => picture.clientHeight / picture.clientWidth);
    assert.ok(lit > 0.3 && lit < 1.5, `${name}: ${lit}`);
    assert.equal(arrows === null, name === "features_slip", name);
    await page.close();
  }
});

for (const dark of [false, true]) {
  for (const width of [1280, 800]) {
    const page = await open(files["report.html"], { width, dark });
    const name = (what) => `replay_${what}_${width}_${dark ? "dark" : "light"}`;
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `wider than ${width}`);
    await shoot(page, name("slip"));
    await scrub(page, 15);
    await shoot(page, name("rest"));
    await page.close();
  }
}

// --- labels: of a recording, not of a scene ---

run("holdfast", "sim", scene, "--mcap", join(work, "grasp, 1.mcap"));
run("holdfast", "replay", join(work, "grasp, 1.mcap"), "--reference", "first", "--report", join(work, "replay.html"));
const labelled = await open(join(work, "replay.html"));

await check("labels: a scene has none to mark; a recording is marked by keys, and says what is missing", async () => {
  assert.ok(await report.locator("#labelling").isHidden());
  const at = async (frame, key) => {
    await scrub(labelled, frame);
    await labelled.keyboard.press(key);
  };
  await labelled.locator("#scrub").focus();
  assert.ok(await labelled.locator("#export-labels").isDisabled());
  await at(30, "h");
  assert.ok((await text(labelled, "labels-problem")).startsWith("hold begins at frame 30 and has no end yet"));
  await at(36, "h");
  await at(12, "e"); // the end may come first
  await at(2, "e");
  await at(34, "s");
  await at(60, "s");
  assert.ok((await text(labelled, "labels-problem")).includes("hold and slip at once"));
  assert.ok(await labelled.locator("#export-labels").isDisabled());
  await at(39, "s"); // once a clip: marked again, it moves
  await at(70, "s");
  await labelled.locator('button[data-kind="contact"]').click();
  await scrub(labelled, 20);
  await labelled.locator('button[data-kind="contact"]').click();
  assert.equal(await labelled.locator("#labels li").count(), 4);
});

await check("labels: the file is what the tool reads", async () => {
  const [download] = await Promise.all([labelled.waitForEvent("download"), labelled.locator("#export-labels").click()]);
  assert.equal(download.suggestedFilename(), "labels.csv");
  const path = join(work, "labels.csv");
  await download.saveAs(path);
  const want = '"grasp, 1.mcap",20,70,39,70,1,30-36:high,2-12,high';
  assert.equal(readFileSync(path, "utf8").split("\n")[1], want);
  run("holdfast", "dataset", "--recordings", path, "--out", join(work, "samples.csv"));
  await labelled.locator("#labels li").nth(0).locator("button").last().click();
  assert.equal(await labelled.locator("#labels li").count(), 3);
});

await check("nothing keeps anybody out who sees or points differently, light and dark", async () => {
  for (const page of [report, labelled]) {
    for (const colorScheme of ["light", "dark"]) {
      await page.emulateMedia({ colorScheme });
      assert.deepEqual(await barriers(page), []);
    }
  }
});

await check("a link to a frame opens there; ? shows the keys", async () => {
  await labelled.waitForFunction(() => /#frame=\d+$/.test(location.href));
  const linked = await browser.newPage();
  await linked.goto(`${pathToFileURL(join(work, "replay.html")).href}#frame=33`);
  assert.ok((await text(linked, "when")).startsWith("frame 33 "));
  assert.ok(!(await linked.locator("#keys-help").isVisible()));
  await linked.keyboard.press("?");
  assert.ok(await linked.locator("#keys-help").isVisible());
  await linked.close();
  assert.deepEqual(labelled.said, []);
});

// --- live ---

const live = await open(files["live.html"], { serial: "mock" });
const total = readFileSync(files.bytes).length;
const play = (page, upTo) => page.evaluate((n) => window.port.play(n), upTo);
const count = (page, n) =>
  page.waitForFunction((want) => Number(document.getElementById("scrub").max) === want - 1, n, { timeout: 20000 });

await check("live: Connect opens the port at 115200 and asks for the frames", async () => {
  assert.ok((await text(live, "live-state")).startsWith("Plug the board in"));
  await live.locator("#connect").click();
  await live.waitForFunction(() => window.port.sent !== "");
  assert.deepEqual(await live.evaluate(() => window.port.opened), { baudRate: 115200 });
  await live.waitForFunction(() => document.getElementById("live-state").textContent.startsWith("Connected, but no frame for 2 s"));
  assert.equal(await live.evaluate(() => window.port.sent), "watch on\r\n");
  assert.equal(await text(live, "connect"), "Disconnect");
});

await check("live: the view follows the newest frame", async () => {
  await play(live, Math.floor(total / 4));
  await live.waitForFunction(() => Number(document.getElementById("scrub").max) > 15);
  await live.evaluate(() => window.port.garble());
  await live.waitForTimeout(100);
  await play(live, Math.floor(total / 2));
  await live.waitForFunction(() => Number(document.getElementById("scrub").max) > 30);
  assert.equal(await live.locator("#scrub").inputValue(), await live.locator("#scrub").getAttribute("max"));
  await shoot(live, "live_half_1280_light");
});

await check("live: while it is paused what is shown stands still, and it follows again", async () => {
  await live.locator("#play").click();
  const before = [await text(live, "when"), await text(live, "value-e")];
  await play(live, total);
  await live.waitForTimeout(300);
  assert.deepEqual([await text(live, "when"), await text(live, "value-e")], before);
  await live.locator("#play").click();
  await count(live, values.status.length);
});

await check("live: every shown value is what the firmware's decoder says", async () => {
  for (let i = 0; i < values.status.length; ++i) {
    const want = values.status[i];
    await scrub(live, i);
    assert.ok((await text(live, "when")).startsWith(`frame ${want.sequence} `));
    assert.equal(await text(live, "state"), want.state);
    const shown = async (id) => clean(await text(live, `value-${id}`));
    const number = (value, digits) => (want.features_valid ? value.toFixed(digits) : "\u2013");
    assert.equal(await shown("e"), number(want.entropy_nat_q16 / 65536, 3));
    assert.equal(await shown("rate"), number(want.entropy_rate_nat_s_q8 / 256, 2));
    assert.equal(await shown("vx"), number(want.vx_um_s / 1000, 2));
    assert.equal(await shown("vy"), number(want.vy_um_s / 1000, 2));
    assert.equal(await shown("markers"), want.features_valid ? String(want.markers) : "\u2013");
    assert.ok((await text(live, "lamp-decision")).includes(want.slip ? "slip" : "hold"));
    assert.ok((await text(live, "lamp-grip")).includes(want.grip_ok ? "HIGH" : "LOW"));
    assert.ok((await text(live, "lamp-alive")).includes(want.alive ? "HIGH" : "LOW"));
  }
});

await check("live: a board says what the verdict stands on, in each frame that has features", async () => {
  const told = new Map(values.evidence.map((one) => [one.sequence, one]));
  for (let i = 0; i < values.status.length; ++i) {
    await scrub(live, i);
    const want = told.get(values.status[i].sequence);
    assert.equal(await live.locator("#why").isVisible(), want !== undefined);
    if (want === undefined) continue;
    const why = (await text(live, "why")).match(/^Contact (\w+)\. Evidence: (\w+) ([\d.]+) of ([\d.]+) (.*?), (\d+) frames? in a row.*\.$/);
    assert.deepEqual([why[1], why[2], why[5], why[6]], [want.contact, want.evidence, want.unit, String(want.run)]);
    near(Number(why[3]), want.value_milli / 1000, 0.051, "evidence");
    near(Number(why[4]), want.threshold_milli / 1000, 0.051, "threshold");
  }
});

await check("live: arrows are the displacements of the firmware, and the damaged field is left out", async () => {
  let arrows = 0;
  await live.locator("#factor").evaluate((input) => {
    input.value = 1;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  });
  for (const field of values.fields) {
    const at = values.status.findIndex((status) => status.sequence === field.sequence);
    if (at < 0) continue;
    await scrub(live, at);
    const note = await text(live, "shot-note");
    assert.equal(note.startsWith("arrows of"), field.damaged, `sequence ${field.sequence}: '${note}'`);
    if (field.damaged) continue;
    const got = await drawn(live);
    const um = got.width / (10 * 2020);
    field.um.forEach((want, i) => {
      if (want === null) return assert.equal(got.arrows[i], null);
      const { from, to } = got.arrows[i];
      const short = Math.hypot(...want) * um < 1.1;
      const what = `sequence ${field.sequence}, marker ${i}`;
      for (const axis of [0, 1]) near(to[axis] - from[axis], want[axis] * um, short ? 1.1 : 0.02, what);
      ++arrows;
    });
  }
  console.log(`     ${arrows} arrows of ${values.fields.length} fields`);
  assert.ok(arrows > 500);
});

await check("live: damage and loss are counted, lines of text are kept apart", async () => {
  const cells = (lines) => lines.map((line) => [...line.cells].map((cell) => cell.textContent));
  const rows = Object.fromEntries(await live.locator("#live-table tr").evaluateAll(cells));
  assert.equal(rows["Status frames"], String(values.status.length));
  assert.equal(rows["Damaged on the way"], String(values.damaged));
  assert.equal(rows["Missing in the sequence"], "1");
  assert.equal(await text(live, "console"), values.texts.filter((line) => line !== "").join("\n"));
});

await check("live: Save gives a table of the session", async () => {
  const [download] = await Promise.all([live.waitForEvent("download"), live.locator("#save").click()]);
  const path = join(work, "saved.csv");
  await download.saveAs(path);
  const rows = table(path);
  assert.equal(rows.length, values.status.length);
  rows.forEach((row, i) => {
    const want = values.status[i];
    for (const name of ["sequence", "timestamp_us", "state", "reason"]) assert.equal(row[name], String(want[name]));
    assert.equal(row.slip, want.slip ? "1" : "0");
    assert.equal(row.entropy_nat, want.features_valid ? (want.entropy_nat_q16 / 65536).toFixed(6) : "");
    const field = values.fields.find((f) => f.sequence === want.sequence && !f.damaged);
    (field?.um ?? []).forEach((xy, k) => {
      assert.deepEqual([row[`dx_um_${k}`], row[`dy_um_${k}`]], xy === null ? ["", ""] : xy.map(String));
    });
  });
});

await check("live: a cable that is pulled is told, and the frames stay", async () => {
  const words = await text(live, "lamp-grip");
  assert.ok(words !== "");
  await live.evaluate(() => window.port.pull());
  await live.waitForFunction(() => document.getElementById("connect").textContent === "Connect");
  assert.ok((await text(live, "live-state")).startsWith("The port is gone"));
  assert.equal(await live.locator("#scrub").getAttribute("max"), String(values.status.length - 1));
  assert.equal(await live.evaluate(() => window.port.closed), 1);
});

await check("live: another Connect begins anew; Disconnect says `watch off`", async () => {
  await live.locator("#connect").click();
  await live.waitForFunction(() => window.port.sent.endsWith("watch on\r\n") && window.port.sent.length > 10);
  await live.evaluate(() => (window.port.at = 0));
  await play(live, total);
  await count(live, values.status.length);
  await live.locator("#connect").click();
  await live.waitForFunction(() => window.port.closed === 2);
  assert.ok((await live.evaluate(() => window.port.sent)).endsWith("watch off\r\n"));
  assert.ok((await text(live, "live-state")).startsWith("Disconnected"));
  assert.deepEqual(live.said, []);
});

await check("live: in the report's page, too, and back to the recording", async () => {
  const page = await open(files["report.html"], { serial: "mock" });
  await page.locator("#mode-live").click();
  await page.locator("#connect").click();
  await page.waitForFunction(() => window.port.sent !== "");
  await play(page, total);
  await count(page, values.status.length);
  assert.ok(!(await page.locator("#plots").isVisible()));
  await page.locator("#mode-recording").click();
  assert.ok(await page.locator("#plots").isVisible());
  assert.equal(await text(page, "state"), "SLIP");
  assert.deepEqual(page.said, []);
  await page.close();
});

await check("live: without the API a sentence says why", async () => {
  const page = await open(files["live.html"], { serial: "none" });
  assert.ok(!(await page.locator("#connect").isVisible()));
  assert.ok((await text(page, "live-state")).includes("Web Serial"));
  assert.deepEqual(page.said, []);
  await page.close();
});

const firstSlip = values.status.findIndex((status) => status.slip);
for (const dark of [false, true]) {
  for (const width of [1280, 800]) {
    const page = await open(files["live.html"], { serial: "mock", width, dark });
    const name = (what) => `live_${what}_${width}_${dark ? "dark" : "light"}`;
    await shoot(page, name("empty"));
    await page.locator("#connect").click();
    await page.waitForFunction(() => window.port.sent !== "");
    await play(page, total);
    await count(page, values.status.length);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), `wider than ${width}`);
    await shoot(page, name("end"));
    await scrub(page, firstSlip + 4);
    await shoot(page, name("slip"));
    await page.close();
  }
}

await chrome.close();
console.log(`${checks} passed`);
