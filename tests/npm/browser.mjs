// SPDX-License-Identifier: Apache-2.0
// Debian's Chromium for the checks of pages, and what they do with a page.
import assert from "node:assert/strict";
import { existsSync, mkdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const kChromium = "/usr/bin/chromium";
export const root = resolve(dirname(fileURLToPath(import.meta.url)), "../..");

function skip(why, next) {
  console.log(`SKIPPED: ${why}. Next: ${next}`);
  process.exit(77);
}

// Of the command line: --bin, where the programs are, and --shots, where pictures of the page are kept (null: nowhere).
export function folders() {
  const option = (name, otherwise) => {
    const at = process.argv.indexOf(name);
    return at < 0 ? otherwise : resolve(process.argv[at + 1]);
  };
  const shots = option("--shots", null);
  if (shots !== null) mkdirSync(shots, { recursive: true });
  return { bin: option("--bin", join(root, "build/sim/bin")), shots };
}

export async function launch() {
  if (!existsSync(kChromium)) skip("no Chromium here", "apt-get install chromium, or run tests/run.sh");
  const { chromium } = await import("playwright-core").catch(() => skip("no node_modules", "npm ci in tests/npm"));
  // A new profile each time: playwright makes it and takes it away.
  return chromium.launch({
    executablePath: kChromium,
    args: ["headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-background-networking"]
      .concat(["disable-component-update", "disable-sync"])
      .map((name) => `--${name}`),
  });
}

// The scrubber as a hand moves it.
export async function scrub(page, at) {
  await page.locator("#scrub").evaluate((input, value) => {
    input.value = value;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, at);
}
// Arrows as they are drawn, in the drawing's units: from, to; null: a cross.
export const drawn = (page) =>
  page.evaluate(() => {
    const svg = document.getElementById("arrows");
    if (svg.classList.contains("gone")) return null;
    const arrows = [...svg.querySelectorAll("g")].map((group) => {
      if (group.classList.contains("is-lost")) return null;
      const dot = group.querySelector("circle");
      const from = [Number(dot.getAttribute("cx")), Number(dot.getAttribute("cy"))];
      const d = group.querySelector(".the-arrow").getAttribute("d").match(/-?[\d.]+/g);
      return { from, to: d === null ? from : [Number(d[2]), Number(d[3])] };
    });
    return { width: svg.viewBox.baseVal.width, height: svg.viewBox.baseVal.height, arrows };
  });

export function near(a, b, tolerance, what) {
  assert.ok(Math.abs(a - b) <= tolerance, `${what}: ${a} is not ${b}`);
}

// What axe-core finds that keeps somebody out: of impact serious or critical. The page's own rules let no script in, so
// its text goes through the debugger.
export async function barriers(page) {
  await page.evaluate(readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8"));
  const found = await page.evaluate(() => window.axe.run(document, { resultTypes: ["violations"] }));
  return found.violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.target.join(" ")).slice(0, 4).join(", ")}`);
}
