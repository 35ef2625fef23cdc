// SPDX-License-Identifier: Apache-2.0
// Drawings: histogram, latency, the strip behind the scrubber, and the plots over time. Their colours are in report.css.
import { WIRE } from "./tables.js";
import { shape } from "./gel.js";

export const kStateClass = WIRE.states.map((state) => state.name.toLowerCase());

export function minus(text) {
  return text.replace("-", "\u2212");
}

// About `count` ticks at 1, 2 or 5 times a power of ten.
function ticksOf(low, high, count) {
  const rough = Math.max(high - low, 1e-9) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((lead) => lead * power >= rough * 0.999) * power;
  const ticks = [];
  for (let v = Math.ceil(low / step - 1e-6) * step; v <= high + 1e-6 * step; v += step) ticks.push(v);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return ticks.map((v) => [v, minus((Math.abs(v) < step / 4 ? 0 : v).toFixed(decimals))]);
}

const kLeft = 26;
const kRight = 246;
const kTop = 8;
const kBottom = 92;

function bars(svg, counts, most, css) {
  const width = (kRight - kLeft) / counts.length;
  counts.forEach((count, i) => {
    if (count <= 0) return;
    const height = Math.max(((kBottom - kTop) * count) / most, 0.8);
    const x = kLeft + i * width + 0.75;
    shape(svg, "rect", { class: css, x, y: kBottom - height, width: Math.max(width - 1.5, 1), height });
  });
}

function text(svg, x, y, anchor, words) {
  shape(svg, "text", { x, y, "text-anchor": anchor }).textContent = words;
}

// `counts`: null draws the empty scale. Few scales, so that it seldom jumps from frame to frame.
export function drawHistogram(svg, counts, range_mm) {
  const most = [10, 20, 40, 70, 130].find((scale) => Math.max(0, ...(counts ?? [])) <= scale) ?? 260;
  svg.replaceChildren();
  for (const [v, words] of ticksOf(0, most, 3)) {
    const y = kBottom - ((kBottom - kTop) * v) / most;
    shape(svg, "path", { class: "grid", d: `M${kLeft} ${y}H${kRight}` });
    text(svg, kLeft - 5, y + 4, "end", words);
  }
  if (counts !== null) bars(svg, Array.from(counts), most, "bar");
  for (const bin of [0, 5, 10, 15]) {
    const words = range_mm > 0 ? String(Number(((range_mm * bin) / WIRE.bins).toPrecision(2))) : String(bin);
    const x = kLeft + ((kRight - kLeft) * bin) / WIRE.bins;
    text(svg, x, kBottom + 14, "middle", words + (bin === WIRE.bins ? "+" : ""));
  }
  const unit = range_mm > 0 ? "mm" : "bin";
  text(svg, (kLeft + kRight) / 2, kBottom + 29, "middle", `displacement (${unit}), markers`);
}

export function drawLatency(svg, latency, of_ms) {
  svg.replaceChildren();
  const most = Math.max(...latency.bins, 1);
  shape(svg, "path", { class: "axis", d: `M${kLeft} ${kBottom}H${kRight}` });
  bars(svg, latency.bins, most, "bar latency");
  const range_ms = latency.range_us / 1000;
  const x = (us) => kLeft + ((kRight - kLeft) * Math.min(us / latency.range_us, 1));
  for (const [name, us] of [["median", latency.p50_us], ["99 %", latency.p99_us]]) {
    shape(svg, "path", { class: "truth", d: `M${x(us)} ${kTop}V${kBottom}` }).setAttribute("data-quantile", name);
  }
  for (const [v, words] of ticksOf(0, range_ms, 4)) text(svg, x(v * 1000), kBottom + 14, "middle", words);
  text(svg, (kLeft + kRight) / 2, kBottom + 29, "middle", of_ms);
}

// Entropy, slip and state of all frames behind the scrubber, and marks of the truth: x goes by frame, as its thumb
// does.
export function drawOverview(svg, rows, marks) {
  svg.replaceChildren();
  if (rows.length === 0) return;
  const x = (i) => (1000 * i) / Math.max(rows.length - 1, 1);
  let most = 0.1;
  for (const row of rows) most = Math.max(most, row.entropy);
  const runs = (pick, draw) => {
    for (let i = 0; i < rows.length; ) {
      let end = i + 1;
      while (end < rows.length && pick(rows[end]) === pick(rows[i])) ++end;
      draw(pick(rows[i]), x(i), x(Math.min(end, rows.length - 1)));
      i = end;
    }
  };
  const box = (css, from, to, y, height) => {
    shape(svg, "rect", { class: css, x: from, y, width: Math.max(to - from, 1.5), height });
  };
  runs((row) => row.slip, (slip, from, to) => slip && box("shade", from, to, 0, 40));
  runs((row) => row.state, (state, from, to) => box(`state ${kStateClass[state]}`, from, to, 41, 7));
  for (const mark of marks) {
    const at = rows.findIndex((row) => row.t_s >= mark.t_s);
    if (at >= 0) shape(svg, "path", { class: "truth", d: `M${x(at)} 0V41`, "vector-effect": "non-scaling-stroke" });
  }
  // The extremes of each step of the drawing, when there are more frames than steps.
  const group = Math.max(1, Math.ceil(rows.length / 700));
  let d = "";
  let down = false;
  for (let i = 0; i < rows.length; i += group) {
    let low = null;
    let high = null;
    for (let k = i; k < Math.min(i + group, rows.length); ++k) {
      if (!rows[k].featuresValid) continue;
      low = low === null ? rows[k].entropy : Math.min(low, rows[k].entropy);
      high = high === null ? rows[k].entropy : Math.max(high, rows[k].entropy);
    }
    if (low === null) {
      down = false;
      continue;
    }
    const y = (value) => (38 - (34 * value) / most).toFixed(1);
    d += `${down ? "L" : "M"}${x(i).toFixed(1)} ${y(low)}` + (group > 1 ? `L${x(i).toFixed(1)} ${y(high)}` : "");
    down = true;
  }
  shape(svg, "path", { class: "a", d, "vector-effect": "non-scaling-stroke" });
}

const kPlotLeft = 62;
const kPlotRight = 1062;

// Over time: the last minute of a live session, drawn anew as it grows, or all of a recording.
export class Plots {
  constructor(svg) {
    this.svg = svg;
    this.from = 0;
    this.span = 10;
  }

  x(t_s) {
    return kPlotLeft + ((t_s - this.from) / this.span) * (kPlotRight - kPlotLeft);
  }
  timeAt(x) {
    return this.from + ((x - kPlotLeft) / (kPlotRight - kPlotLeft)) * this.span;
  }

  // `recorded`: the recording's data; null: live.
  draw(rows, recorded = null) {
    this.svg.replaceChildren();
    this.bottom = 20;
    if (rows.length === 0) return;
    const last = rows[rows.length - 1].t_s;
    if (recorded === null) {
      // The paper gets longer up to a minute, then it moves.
      this.span = [10, 20, 30].find((span) => last - rows[0].t_s <= span) ?? 60;
      this.from = Math.max(rows[0].t_s, last - this.span);
    } else {
      this.from = rows[0].t_s;
      this.span = Math.max(last - this.from + (rows.length > 1 ? last - rows[rows.length - 2].t_s : 0.04), 1e-6);
    }
    this.rows = rows;
    this.top = recorded !== null && recorded.marks.length > 0 ? 22 : 6;
    const heights = { e: 128, rate: 96, v: 118 };
    const shade = shape(this.svg, "g", {});
    let y = this.top;
    if (recorded !== null) y = this.why(y);
    y = this.panel(y, "Entropy E", "nat", heights.e, 0, [["a", "", (r) => (r.featuresValid ? r.entropy : null)]]);
    y = this.panel(y, "Entropy rate dE/dt", "nat/s", heights.rate, null, [
      ["a", "", (r) => (r.ratesValid ? r.rate : null)],
    ]);
    y = this.panel(y, "Mean marker speed", "mm/s", heights.v, null, [
      ["a", "Vx", (r) => (r.ratesValid ? r.vx : null)],
      ["b", "Vy", (r) => (r.ratesValid ? r.vy : null)],
    ]);
    if (recorded !== null) y = this.loads(y);
    if (recorded !== null && recorded.series !== null) {
      const { name, unit, points } = recorded.series;
      const truth = points.map(([t_s, v]) => ({ t_s, v }));
      y = this.panel(y, `Truth: ${name}`, unit, 84, 0, [["v", "", (p) => p.v, truth]]);
    }
    y = this.band(y, "State", 22, (r) => r.state, (r, x0, x1, at) => {
      shape(this.svg, "rect", { class: `state ${kStateClass[r.state]}`, x: x0, y: at, width: x1 - x0, height: 22 });
      const name = WIRE.states[r.state].name;
      if (x1 - x0 > 8.5 * name.length + 8) {
        const words = shape(this.svg, "text", { class: `in ${kStateClass[r.state]}`, x: (x0 + x1) / 2, y: at + 15 });
        words.textContent = name;
      }
    });
    y = this.levels(y, "GRIP_OK", 24, (r) => r.gripOk, true);
    y = this.alive(y);
    this.bottom = y - 6;
    this.runs((r) => r.slip, (r, x0, x1) => {
      const box = { class: "shade", x: x0, y: this.top, width: x1 - x0, height: this.bottom - this.top };
      if (r.slip) shape(this.svg, "rect", box, shade);
    });
    shape(this.svg, "path", { class: "axis", d: `M${kPlotLeft} ${this.bottom}H${kPlotRight}` });
    for (const [v, words] of ticksOf(this.from, this.from + this.span, 10)) {
      shape(this.svg, "path", { class: "axis", d: `M${this.x(v)} ${this.bottom}v5` });
      text(this.svg, this.x(v), this.bottom + 18, "middle", words);
    }
    text(this.svg, (kPlotLeft + kPlotRight) / 2, this.bottom + 34, "middle", `time ${recorded === null ? "since the first frame" : "of the recording"} (s)`);
    if (recorded !== null) this.marks(recorded.marks);
    this.svg.setAttribute("viewBox", `0 0 1080 ${this.bottom + 40}`);
    this.pointed = shape(this.svg, "path", { class: "hover" });
    this.cursor = shape(this.svg, "path", { class: "cursor" });
  }

  line(path, t_s) {
    path?.setAttribute("d", t_s === null ? "" : `M${this.x(t_s).toFixed(2)} ${this.top}V${this.bottom}`);
  }
  showCursor(t_s) {
    this.line(this.cursor, t_s);
  }
  // Where the pointer is; null: nowhere.
  showPointed(t_s) {
    this.line(this.pointed, t_s);
  }

  // What decides, with its threshold. Without a picture between the dots the markers do, whose figures follow below.
  why(y) {
    if (!this.rows.some((r) => r.why !== null && r.why.contact !== null)) return y;
    const threshold = this.rows.findLast((r) => r.why?.evidence === "imprint")?.why.evidence_threshold ?? 0;
    const curves = [
      ["a", "imprint", (r) => (r.featuresValid ? r.imprint : null)],
      ["b", "coarse", (r) => (r.featuresValid ? r.coarse : null)],
    ];
    return this.panel(y, "Imprint's motion against the gel within 0.16 s", "um", 128, 0, curves, threshold);
  }

  // The forces, and how much of the friction they use. Without a reading nothing.
  loads(y) {
    const basis = this.rows.findLast((r) => r.load)?.load.basis;
    if (basis === undefined) return y;
    const how = basis === "uncalibrated" ? ", uncalibrated" : "";
    const curves = [
      ["a", "shear", (r) => r.load?.shear_n ?? null],
      ["b", "normal", (r) => r.load?.normal_n ?? null],
    ];
    const use = (r) => (r.load && r.load.friction_use > 0 ? r.load.friction_use : null);
    const next = this.panel(y, "Load on the gel", `N${how}`, 96, 0, curves);
    return this.panel(next, "Friction use: shear over normal load", how.slice(2), 84, 0, [["a", "", use]]);
  }

  // The onset is named first, the others where there is room left: their lines stay, the summary names them.
  marks(marks) {
    const taken = [];
    for (const mark of [...marks].sort((a, b) => Number(b.onset) - Number(a.onset))) {
      const at = this.x(mark.t_s);
      if (!(at >= kPlotLeft && at <= kPlotRight)) continue;
      shape(this.svg, "path", { class: "truth", d: `M${at} ${this.top - 4}V${this.bottom}` });
      const width = 7 * mark.name.length;
      const left = at + width > 1080;
      const from = left ? at - width : at;
      if (taken.some((other) => from < other + width && other < from + width)) continue;
      taken.push(from);
      const words = { class: "mark", x: left ? at - 3 : at + 3, y: this.top - 8, "text-anchor": left ? "end" : "start" };
      shape(this.svg, "text", words).textContent = mark.name;
    }
  }

  name(y, words) {
    shape(this.svg, "text", { class: "name small", x: kPlotLeft - 7, y, "text-anchor": "end" }).textContent = words;
  }

  // A curve may have rows of its own. `threshold`: a line at this value; 0: none.
  panel(y, name, unit, height, floor, curves, threshold = 0) {
    let low = 0;
    let high = Math.max(0.1, threshold);
    for (const [, , value, rows = this.rows] of curves) {
      for (const row of rows) {
        const v = value(row);
        if (v === null) continue;
        low = Math.min(low, v);
        high = Math.max(high, v);
      }
    }
    const margin = 0.04 * (high - low);
    high += margin;
    if (floor === null) low -= margin;
    const top = y + 20;
    const at = (v) => top + height - ((v - low) / (high - low)) * height;
    for (const [v, words] of ticksOf(low, high, Math.max(2, height / 26))) {
      const zero = Math.abs(v) < 1e-9;
      shape(this.svg, "path", { class: zero ? "zero" : "grid", d: `M${kPlotLeft} ${at(v)}H${kPlotRight}` });
      text(this.svg, kPlotLeft - 7, at(v) + 4, "end", words);
    }
    shape(this.svg, "text", { class: "name", x: kPlotLeft, y: y + 13 }).textContent = unit === "" ? name : `${name} (${unit})`;
    if (threshold > 0) {
      shape(this.svg, "path", { class: "truth", d: `M${kPlotLeft} ${at(threshold)}H${kPlotRight}` });
      text(this.svg, kPlotRight - 3, at(threshold) - 4, "end", `threshold ${threshold.toFixed(0)}`);
    }
    curves.forEach(([css, label, value, rows = this.rows], i) => {
      const dense = rows.length > kPlotRight - kPlotLeft ? " dense" : "";
      shape(this.svg, "path", { class: css + dense, d: this.path(rows, value, at) });
      if (label === "") return;
      const x = kPlotRight - 56 * (curves.length - i);
      shape(this.svg, "path", { class: css, d: `M${x} ${y + 9}h22` });
      text(this.svg, x + 27, y + 13, "start", label);
    });
    return top + height + 16;
  }

  // A line through all points, or through the extremes of each step of the drawing when there are too many to see.
  path(rows, value, at) {
    const dense = rows.length > 2 * (kPlotRight - kPlotLeft);
    const step = (row) => Math.floor(this.x(row.t_s));
    let d = "";
    let down = false;
    for (let i = 0; i < rows.length; ) {
      const from = i;
      let low = null;
      let high = null;
      do {
        const v = value(rows[i]);
        if (v !== null && (low === null || v < value(rows[low]))) low = i;
        if (v !== null && (high === null || v > value(rows[high]))) high = i;
        ++i;
      } while (dense && i < rows.length && step(rows[i]) === step(rows[from]));
      for (const k of low === null ? [] : [...new Set([Math.min(low, high), Math.max(low, high)])]) {
        d += `${down ? "L" : "M"}${this.x(rows[k].t_s).toFixed(1)} ${at(value(rows[k])).toFixed(1)}`;
        down = true;
      }
      if (low === null) down = false;
    }
    return d;
  }

  runs(pick, draw) {
    const { rows } = this;
    for (let i = 0; i < rows.length; ) {
      let end = i + 1;
      while (end < rows.length && pick(rows[end]) === pick(rows[i])) ++end;
      draw(rows[i], this.x(rows[i].t_s), this.x(rows[Math.min(end, rows.length - 1)].t_s));
      i = end;
    }
  }

  band(y, name, height, pick, draw) {
    this.name(y + height / 2 + 4, name);
    this.runs(pick, (row, x0, x1) => draw(row, x0, x1, y));
    return y + height + 10;
  }

  // Its edges, or, once they run together, where the last one is young enough (as in the report).
  alive(y) {
    if (this.rows.length <= 400) return this.levels(y, "ALIVE", 20, (r) => r.alive, false);
    return this.band(y, "ALIVE", 20, (r) => r.fresh, (r, x0, x1, at) => {
      if (r.fresh) shape(this.svg, "rect", { class: "fresh", x: x0, y: at + 1, width: x1 - x0, height: 19 });
    });
  }

  levels(y, name, height, pick, filled) {
    this.name(y + height / 2 + 4, name);
    let d = "";
    this.runs(pick, (row, x0, x1) => {
      const at = pick(row) ? y + 1 : y + height;
      const box = { class: "high", x: x0, y: at, width: x1 - x0, height: height - 1 };
      if (pick(row) && filled) shape(this.svg, "rect", box);
      d += d === "" ? `M${x0.toFixed(1)} ${at}` : `V${at}`;
      d += `H${x1.toFixed(1)}`;
    });
    shape(this.svg, "path", { class: "io", d });
    return y + height + 10;
  }
}
