// SPDX-License-Identifier: Apache-2.0
// A session as the views see it, recorded or live: rows in order of time, and for each of them markers and a picture,
// or those of the nearest row before it.
import { WIRE } from "./tables.js";
import { Receiver, readEvidence, readLoad, readStatus, readMarkers } from "./wire.js";

const kLost = -32768; // track.cpp

function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
}

// Last of `list` whose index is at most `index`; -1: none.
function lastUpTo(list, index) {
  let low = 0;
  let high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].index <= index) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

// Histogram of lengths over [0, range), the last bin takes the rest: as firmware/tactile/features.hpp counts.
export function histogramOf(field, range) {
  const bins = new Array(WIRE.bins).fill(0);
  for (let i = 0; i < field.ok.length; ++i) {
    if (!field.ok[i]) continue;
    const length = Math.floor(Math.hypot(field.d[2 * i], field.d[2 * i + 1]));
    ++bins[Math.min(WIRE.bins - 1, Math.floor((length * WIRE.bins) / range))];
  }
  return bins;
}

// Of any values, as track.cpp counts those of a recording.
export function latencyOf(values) {
  if (values.length === 0) return null;
  const us = Float64Array.from(values).sort();
  const quantile = (share) => us[Math.floor(share * (us.length - 1))];
  const most = us[us.length - 1];
  const scale = Math.max(most, 1000);
  const power = 10 ** Math.floor(Math.log10(scale));
  const range = [1, 2, 5, 10].find((lead) => lead * power >= scale * 0.999999) * power;
  const bins = new Array(30).fill(0);
  for (const value of us) ++bins[Math.min(29, Math.floor((value / range) * 30))];
  return { count: us.length, p50_us: quantile(0.5), p99_us: quantile(0.99), max_us: most, range_us: range, bins };
}

// A length of the arrows at which the longest spans about a pitch and a half.
function factorFor(fields) {
  if (fields.length === 0) return 1;
  const { rest } = fields[fields.length >> 1];
  let pitch = Infinity;
  for (let i = 2; i < rest.length; i += 2) {
    pitch = Math.min(pitch, Math.hypot(rest[i] - rest[0], rest[i + 1] - rest[1]));
  }
  let longest = 0;
  for (const { d } of fields) {
    for (let i = 0; i < d.length; i += 2) longest = Math.max(longest, Math.hypot(d[i], d[i + 1]));
  }
  const fits = [50, 40, 30, 25, 20, 15, 10, 8, 6, 5, 4, 3, 2].find((factor) => factor * longest <= 1.5 * pitch);
  return fits ?? 1;
}

// What toolchain/session/track.cpp wrote.
export class Recording {
  constructor(data) {
    this.live = false;
    this.data = data;
    this.range_mm = data.histogram_range_mm;
    this.latency = data.latency;
    this.box = { left: -0.5, top: -0.5, width: data.width_px, height: data.height_px };
    this.rows = this.readRows(bytesOf(data.rows));
    this.fields = this.readFields(bytesOf(data.markers), data.marker_unit_px);
    this.pictures = this.readPictures(bytesOf(data.pictures));
    this.factor = factorFor(this.fields);
  }

  readRows(bytes) {
    const view = new DataView(bytes.buffer);
    const rows = [];
    for (let at = 0; at < bytes.length; at += 88) {
      const flags = view.getUint8(at + 18);
      const flag = (bit) => ((flags >> bit) & 1) === 1;
      const row = {
        index: view.getUint32(at, true),
        frame: view.getUint32(at + 4, true),
        t_s: view.getFloat64(at + 8, true),
        state: view.getUint8(at + 16),
        reason: view.getUint8(at + 17),
        slip: flag(0),
        gripOk: flag(1),
        accepted: flag(2),
        featuresValid: flag(3),
        ratesValid: flag(4),
        alive: flag(5),
        fresh: flag(6),
        markers: view.getUint8(at + 19),
        entropy: view.getFloat32(at + 20, true),
        rate: view.getFloat32(at + 24, true),
        vx: view.getFloat32(at + 28, true),
        vy: view.getFloat32(at + 32, true),
        decided_us: view.getFloat32(at + 36, true),
        histogram: bytes.subarray(at + 40, at + 55),
        imprint: view.getFloat32(at + 66, true),
        coarse: view.getFloat32(at + 70, true),
      };
      row.why = row.featuresValid ? this.whyOf(view, at + 55, row.slip) : null;
      row.load = row.featuresValid ? this.loadOf(view, at + 74) : null;
      rows.push(row);
    }
    return rows;
  }

  // As `status json` of a device says it.
  whyOf(view, at, slip) {
    const round = (value) => Number(value.toFixed(1));
    const evidence = view.getUint8(at + 1);
    const [name, unit] = evidence === 0 ? ["none", ""] : this.data.evidences[evidence - 1];
    return {
      slip,
      contact: this.data.contacts[view.getUint8(at)] ?? null,
      evidence: name,
      evidence_value: round(view.getFloat32(at + 2, true)),
      evidence_threshold: round(view.getFloat32(at + 6, true)),
      evidence_unit: unit,
      evidence_frames: view.getUint8(at + 10),
    };
  }

  loadOf(view, at) {
    const basis = view.getUint8(at);
    if (basis === 0) return null;
    return {
      basis: WIRE.bases[basis],
      within: view.getUint8(at + 1) === 1,
      shear_n: view.getFloat32(at + 2, true),
      normal_n: view.getFloat32(at + 6, true),
      friction_use: view.getFloat32(at + 10, true),
    };
  }

  readFields(bytes, unit) {
    const view = new DataView(bytes.buffer);
    const fields = [];
    for (let at = 0; at < bytes.length; ) {
      const count = view.getUint32(at + 4, true);
      const field = {
        index: view.getUint32(at, true),
        rest: new Float32Array(2 * count),
        d: new Float32Array(2 * count),
        ok: new Uint8Array(count),
      };
      at += 8;
      for (let i = 0; i < count; ++i, at += 8) {
        const dx = view.getInt16(at + 4, true);
        field.ok[i] = dx === kLost ? 0 : 1;
        field.rest[2 * i] = view.getInt16(at, true) * unit;
        field.rest[2 * i + 1] = view.getInt16(at + 2, true) * unit;
        field.d[2 * i] = field.ok[i] ? dx * unit : 0;
        field.d[2 * i + 1] = field.ok[i] ? view.getInt16(at + 6, true) * unit : 0;
      }
      fields.push(field);
    }
    return fields;
  }

  readPictures(bytes) {
    const view = new DataView(bytes.buffer);
    const pictures = [];
    for (let at = 0; at < bytes.length; ) {
      const size = view.getUint32(at + 4, true);
      const jpeg = bytes.subarray(at + 8, at + 8 + size);
      const url = URL.createObjectURL(new Blob([jpeg], { type: "image/jpeg" }));
      pictures.push({ index: view.getUint32(at, true), url });
      at += 8 + size;
    }
    return pictures;
  }

  // A rejected frame has no markers; the last ones that were seen are not its own.
  fieldAt(row) {
    if (!row.accepted) return null;
    const at = lastUpTo(this.fields, row.index);
    return at < 0 ? null : this.fields[at];
  }
  pictureAt(row) {
    const at = lastUpTo(this.pictures, row.index);
    return at < 0 ? null : this.pictures[at];
  }
  rowOf(index) {
    return this.rows[Math.max(0, lastUpTo(this.rows, index))];
  }
  histogramAt(row) {
    return row.featuresValid ? row.histogram : null;
  }
}

const kRingSeconds = 60;
const kKeptPictures = 500;
const kKeptRows = 200000; // for the CSV: more than two hours at 25 fps

// What comes over the port. Time: when the board sent each frame, counted from the first one.
export class LiveSession {
  constructor() {
    this.live = true;
    this.factor = 3;
    this.range_mm = WIRE.histogramRangeUm / 1000;
    this.served = false; // by `holdfast live`, which asks for what no frame carries
    this.parameters = null;
    this.clear();
  }

  clear() {
    this.receiver = new Receiver({
      frame: (payload) => this.take(payload),
      text: (line) => this.text(line),
      damaged: () => ++this.damaged,
    });
    this.rows = []; // the last minute
    this.kept = [];
    this.forgotten = 0;
    this.lines = [];
    this.frames = this.damaged = this.restarts = this.unknown = this.missing = this.fields = this.slips = 0;
    this.stateCounts = new Array(WIRE.states.length).fill(0);
    this.rest = null;
    this.grid = null;
    this.partial = null;
    this.waiting = null;
    this.aliveChanged_ms = -Infinity;
    this.pictureBox = null;
    for (const picture of this.pictures ?? []) URL.revokeObjectURL(picture.url);
    this.pictures = [];
    this.setGrid(7, 9);
  }

  // `now_ms`: when they arrived.
  push(bytes, now_ms) {
    this.now_ms = now_ms;
    this.receiver.push(bytes);
  }

  text(line) {
    if (this.served && this.answered(line)) return;
    if (line !== "") this.lines.push(line);
    if (this.lines.length > 300) this.lines.shift();
  }

  // What `holdfast live`, or this page, asked for: the answer's line and its OK are not for people.
  answered(line) {
    if (line === "OK" && this.asked) return !(this.asked = false);
    if (!line.startsWith("{")) return false;
    let answer;
    try {
      answer = JSON.parse(line);
    } catch {
      return false;
    }
    const reference = answer.left ?? answer; // of a hand: the finger whose markers come
    if ("pitch_px" in reference) this.takeReference(reference);
    else if ("parameters" in answer) this.parameters = answer.parameters;
    else return false;
    this.asked = true;
    return true;
  }

  // Where the working picture lies on the gel: markers count from the middle of their rest positions.
  takeReference(answer) {
    if (!answer.known || !(answer.pitch_px > 0) || answer.middle_x_px === null) return;
    const um = answer.pitch_printed_um / answer.pitch_px;
    this.pictureBox = {
      left: (-0.5 - answer.middle_x_px) * um,
      top: (-0.5 - answer.middle_y_px) * um,
      width: answer.width_px * um,
      height: answer.height_px * um,
    };
    this.box = this.pictureBox;
  }

  takePicture(sequence, blob) {
    const picture = { sequence, row: null, url: URL.createObjectURL(blob) };
    this.pictures.push(picture);
    for (let i = this.rows.length - 1; i >= Math.max(0, this.rows.length - 50); --i) {
      if (this.rows[i].frame === sequence) this.give(picture, this.rows[i]);
    }
    while (this.pictures.length > kKeptPictures) {
      const old = this.pictures.shift();
      if (old.row !== null) old.row.picture = null;
      URL.revokeObjectURL(old.url);
    }
  }

  give(picture, row) {
    picture.row = row;
    row.picture = { index: row.index, url: picture.url };
  }

  take(payload) {
    const status = readStatus(payload);
    if (status !== null) return this.takeStatus(status);
    const markers = readMarkers(payload);
    if (markers !== null) return this.takeMarkers(markers);
    const evidence = readEvidence(payload);
    if (evidence !== null) return this.takeEvidence(evidence);
    const load = readLoad(payload);
    if (load !== null) return this.takeLoad(load);
    ++this.unknown;
  }

  takeStatus(status) {
    const before = this.rows[this.rows.length - 1];
    if (before !== undefined && before.alive !== status.alive) this.aliveChanged_ms = this.now_ms;
    const row = {
      index: this.frames++,
      frame: status.sequence,
      t_s: before === undefined ? 0 : before.t_s + this.stepFrom(before, status),
      arrived_ms: this.now_ms,
      timestamp_us: status.timestamp_us,
      age_100us: status.age_100us,
      state: status.state,
      reason: status.reason,
      slip: status.slip,
      gripOk: status.grip_ok,
      accepted: before === undefined ? status.alive : before.alive !== status.alive,
      featuresValid: status.features_valid,
      ratesValid: status.features_valid,
      alive: status.alive,
      fresh: this.now_ms - this.aliveChanged_ms <= WIRE.freshMs,
      markers: status.markers,
      entropy: status.entropy_nat_q16 / 65536,
      rate: status.entropy_rate_nat_s_q8 / 256,
      vx: status.vx_um_s / 1000,
      vy: status.vy_um_s / 1000,
      field: null,
      picture: null,
      why: null,
      load: null,
    };
    const gap = before === undefined ? 0 : (status.sequence - before.frame - 1) & 0xffff;
    if (gap < 1000) this.missing += gap;
    else ++this.restarts;
    if (row.slip && !(before !== undefined && before.slip)) ++this.slips;
    ++this.stateCounts[row.state];
    if (this.waiting !== null && this.waiting.sequence === row.frame) {
      row.field = this.waiting.field;
      this.waiting = null;
    }
    const picture = this.pictures[this.pictures.length - 1];
    if (picture !== undefined && picture.row === null && picture.sequence === row.frame) this.give(picture, row);
    this.rows.push(row);
    this.kept.push(row);
    while (row.t_s - this.rows[0].t_s > kRingSeconds) this.rows.shift();
    if (this.kept.length > kKeptRows) {
      this.kept.splice(0, kKeptRows / 10);
      this.forgotten += kKeptRows / 10;
    }
  }

  // Behind its status frame; of a status frame that was lost nothing can be said.
  takeEvidence(evidence) {
    const row = this.rows[this.rows.length - 1];
    if (row !== undefined && row.frame === evidence.sequence) row.why = { slip: row.slip, ...evidence.why };
  }

  takeLoad(load) {
    const row = this.rows[this.rows.length - 1];
    if (row !== undefined && row.frame === load.sequence) row.load = load.basis === "none" ? null : load;
  }

  // By the board's clock as long as that goes on steadily; after a restart by our own.
  stepFrom(before, status) {
    const known = before.age_100us !== WIRE.oldestAge && status.age_100us !== WIRE.oldestAge;
    const step_us = ((status.timestamp_us - before.timestamp_us) | 0) + (status.age_100us - before.age_100us) * 100;
    if (known && step_us > 0 && step_us <= 2e6) return step_us * 1e-6;
    return Math.max(this.now_ms - before.arrived_ms, 1) * 1e-3;
  }

  takeMarkers(markers) {
    const count = markers.rows * markers.cols;
    if (this.grid.rows !== markers.rows || this.grid.cols !== markers.cols) this.setGrid(markers.rows, markers.cols);
    if (markers.what === "rest") {
      for (const m of markers.list) {
        if (m.valid) this.rest.set([m.x_um, m.y_um], 2 * m.index);
      }
      return;
    }
    if (this.partial === null || this.partial.sequence !== markers.sequence || this.partial.field.ok.length !== count) {
      const field = { rest: this.rest, d: new Float32Array(2 * count), ok: new Uint8Array(count) };
      field.told = new Uint8Array(count);
      this.partial = { sequence: markers.sequence, left: count, field };
    }
    const { field } = this.partial;
    for (const m of markers.list) {
      if (field.told[m.index]) continue;
      field.told[m.index] = 1;
      --this.partial.left;
      field.ok[m.index] = m.valid ? 1 : 0;
      if (m.valid) field.d.set([m.x_um, m.y_um], 2 * m.index);
    }
    // A field of which a piece was lost is not shown: what is missing would look like lost markers.
    if (this.partial.left === 0) this.attach(this.partial);
  }

  attach(done) {
    this.partial = null;
    ++this.fields;
    for (let i = this.rows.length - 1; i >= Math.max(0, this.rows.length - 50); --i) {
      if (this.rows[i].frame !== done.sequence) continue;
      this.rows[i].field = done.field;
      return;
    }
    this.waiting = done;
  }

  // As printed, until the board says where they rest.
  setGrid(rows, cols) {
    this.grid = { rows, cols };
    this.rest = new Float32Array(2 * rows * cols);
    for (let i = 0; i < rows * cols; ++i) {
      this.rest[2 * i] = ((i % cols) - (cols - 1) / 2) * WIRE.pitchUm;
      this.rest[2 * i + 1] = (Math.floor(i / cols) - (rows - 1) / 2) * WIRE.pitchUm;
    }
    const width = (cols + 1) * WIRE.pitchUm;
    const height = (rows + 1) * WIRE.pitchUm;
    this.box = this.pictureBox ?? { left: -width / 2, top: -height / 2, width, height };
  }

  // At most a second old.
  fieldAt(row) {
    for (let i = row.index - this.forgotten; i >= 0 && row.t_s - this.kept[i].t_s <= 1; --i) {
      if (this.kept[i].field !== null) return { index: this.kept[i].index, ...this.kept[i].field };
    }
    return null;
  }
  pictureAt(row) {
    for (let i = row.index - this.forgotten; i >= 0 && row.t_s - this.kept[i].t_s <= 1; --i) {
      if (this.kept[i].picture !== null) return this.kept[i].picture;
    }
    return null;
  }
  rowOf(index) {
    return this.kept[Math.max(0, index - this.forgotten)];
  }
  histogramAt(row) {
    const field = this.fieldAt(row);
    return field === null ? null : histogramOf(field, WIRE.histogramRangeUm);
  }
  get latency() {
    return latencyOf(this.rows.filter((r) => r.age_100us !== WIRE.oldestAge).map((r) => r.age_100us * 100));
  }

  // Displacements stand in the rows whose picture they are of.
  csv() {
    const count = this.grid.rows * this.grid.cols;
    const head = "t_s,sequence,timestamp_us,age_ms,state,reason,slip,grip_ok,alive,markers,vx_mm_s,vy_mm_s";
    const names = ["entropy_nat", "entropy_rate_nat_s"];
    for (let i = 0; i < count; ++i) names.push(`dx_um_${i}`, `dy_um_${i}`);
    const lines = [`${head},${names.join(",")}`];
    for (const r of this.kept) {
      const features = r.featuresValid
        ? [r.markers, r.vx.toFixed(3), r.vy.toFixed(3), r.entropy.toFixed(6), r.rate.toFixed(6)]
        : ["", "", "", "", ""];
      const age = r.age_100us === WIRE.oldestAge ? "" : (r.age_100us / 10).toFixed(1);
      const cells = [r.t_s.toFixed(6), r.frame, r.timestamp_us, age];
      cells.push(WIRE.states[r.state].name, reasonOf(r.reason).name);
      cells.push(r.slip ? 1 : 0, r.gripOk ? 1 : 0, r.alive ? 1 : 0, ...features);
      for (let i = 0; i < 2 * count; ++i) {
        const known = r.field !== null && r.field.ok.length === count && r.field.ok[i >> 1];
        cells.push(known ? r.field.d[i] : "");
      }
      lines.push(cells.join(","));
    }
    return lines.join("\n") + "\n";
  }
}

const kReasons = new Map(WIRE.reasons.map((reason) => [reason.number, reason]));

export function reasonOf(number) {
  const next = "write this page anew with the board's version";
  const newer = { number, name: `reason_${number}`, what: `reason ${number}`, cause: "newer firmware", next };
  return kReasons.get(number) ?? newer;
}
