// SPDX-License-Identifier: Apache-2.0
// Frames and text out of a stream of bytes, as firmware/link/link.hpp finds them: COBS between 0x00, CRC-16 at the end.
// What is damaged is counted and dropped; it never becomes text or values.
import { WIRE } from "./tables.js";

const kLongestLine = 32768; // `get json` takes 15 kB; what is longer is noise, and cut

const kCrcTable = Uint16Array.from({ length: 256 }, (_, byte) => {
  let crc = byte << 8;
  for (let bit = 0; bit < 8; ++bit) crc = ((crc << 1) ^ (crc & 0x8000 ? 0x1021 : 0)) & 0xffff;
  return crc;
});

// CRC-16/CCITT-FALSE.
export function crc16(bytes) {
  let crc = 0xffff;
  for (const byte of bytes) crc = ((crc << 8) & 0xffff) ^ kCrcTable[(crc >> 8) ^ byte];
  return crc;
}

// Bytes without the delimiter; null: they are no COBS.
export function cobsDecode(bytes) {
  if (bytes.length === 0) return null;
  const out = [];
  for (let read = 0; read < bytes.length; ) {
    const code = bytes[read++];
    if (code === 0 || code - 1 > bytes.length - read) return null;
    for (let i = 1; i < code; ++i) {
      if (bytes[read] === 0) return null;
      out.push(bytes[read++]);
    }
    if (code !== 0xff && read < bytes.length) out.push(0);
  }
  return Uint8Array.from(out);
}

// One frame, from behind the delimiter before it up to and with its own; null: damaged.
export function openFrame(wire) {
  if (wire.length < WIRE.minWireBytes || wire.length > WIRE.maxWireBytes || wire[wire.length - 1] !== 0) return null;
  const payload = cobsDecode(wire.subarray(0, wire.length - 1));
  if (payload === null || payload.length !== wire.length - 2) return null;
  const crc = payload[payload.length - 2] | (payload[payload.length - 1] << 8);
  return crc16(payload.subarray(0, payload.length - 2)) === crc ? payload : null;
}

function reader(payload, fields) {
  const view = new DataView(payload.buffer, payload.byteOffset, payload.byteLength);
  const get = { u8: "getUint8", u16: "getUint16", u32: "getUint32", i16: "getInt16", i32: "getInt32" };
  return (name, index = 0) => {
    const [offset, type] = fields[name];
    return view[get[type]](offset + index * 2, true);
  };
}

// Null: of another kind, version or length than this page knows.
export function readStatus(payload) {
  if (payload[1] !== WIRE.kinds.status) return null;
  const ofHand = payload[0] === WIRE.handVersion;
  if (!ofHand && payload[0] !== WIRE.version) return null;
  if (payload.length !== (ofHand ? WIRE.handStatusBytes : WIRE.statusBytes)) return null;
  const fields = ofHand ? WIRE.handStatus : WIRE.status;
  const at = reader(payload, fields);
  const frame = { fingers: 0, healthy: 0, contact: 0 }; // version 1 does not tell
  for (const name of Object.keys(fields)) frame[name] = at(name);
  for (const [name, bit] of Object.entries(WIRE.flags)) frame[name] = ((frame.flags >> bit) & 1) === 1;
  // A state that this version does not know cannot be shown as one of the others.
  return frame.state < WIRE.states.length ? frame : null;
}

// What the verdict of the status frame of the same sequence stands on, with the keys of a device's `status json`; null:
// of another kind, version or length.
export function readEvidence(payload) {
  if (payload[0] !== WIRE.version || payload[1] !== WIRE.kinds.evidence) return null;
  if (payload.length !== WIRE.evidenceBytes) return null;
  const at = reader(payload, WIRE.evidence);
  const frame = {};
  for (const name of Object.keys(WIRE.evidence)) frame[name] = at(name);
  const tenths = (milli) => Math.round(milli / 100) / 10;
  frame.why = {
    contact: WIRE.contacts[frame.contact] ?? null,
    evidence: WIRE.evidences[frame.evidence] ?? "evidence of newer firmware",
    evidence_value: tenths(frame.value_milli),
    evidence_threshold: tenths(frame.threshold_milli),
    evidence_unit: WIRE.units[frame.unit] ?? "",
    evidence_frames: frame.run,
  };
  if (frame.why.contact === "UNKNOWN") frame.why.contact = null;
  return frame;
}

// The forces on the gel in the picture of that status frame; null: of another kind, version or length.
export function readLoad(payload) {
  if (payload[0] !== WIRE.version || payload[1] !== WIRE.kinds.load) return null;
  if (payload.length !== WIRE.loadBytes) return null;
  const at = reader(payload, WIRE.load);
  return {
    sequence: at("sequence"),
    finger: at("finger"),
    basis: WIRE.bases[at("basis")] ?? "?",
    within: (at("flags") & 1) === 1,
    shear_n: Math.hypot(at("shear_x_mn"), at("shear_y_mn")) / 1000,
    normal_n: at("normal_mn") / 1000,
    friction_use: at("friction_use_permille") / 1000,
  };
}

// Null: of another kind, version or length, or no lattice has such a marker. `list`: the markers in this frame as
// {index, x_um, y_um, valid}; `what`: "displacement" or "rest".
export function readMarkers(payload) {
  const { displacement, rest } = WIRE.kinds;
  if (payload[0] !== WIRE.version || payload.length !== WIRE.markerBytes) return null;
  if (payload[1] !== displacement && payload[1] !== rest) return null;
  const at = reader(payload, WIRE.marker);
  const frame = { what: payload[1] === rest ? "rest" : "displacement", list: [] };
  for (const name of ["sequence", "rows", "cols", "first"]) frame[name] = at(name);
  const count = frame.rows * frame.cols;
  if (frame.first >= count || count > WIRE.maxMarkers) return null;
  for (let k = 0; k < WIRE.markersPerFrame && frame.first + k < count; ++k) {
    const valid = ((at("valid") >> k) & 1) === 1;
    frame.list.push({ index: frame.first + k, x_um: at("x0_um", 2 * k), y_um: at("x0_um", 2 * k + 1), valid });
  }
  return frame;
}

// Finds frames between lines of text: push() any pieces, in order. Calls on.frame(payload), on.text(line without its
// end) and on.damaged().
export class Receiver {
  constructor(on) {
    this.on = on;
    this.buffer = new Uint8Array(WIRE.maxWireBytes);
    this.count = 0;
    this.place = "begun";
    this.line = [];
  }

  push(bytes) {
    for (const byte of bytes) this.take(byte);
  }

  take(byte) {
    if (byte === 0) return this.end();
    if (this.place === "lost") {
      if (byte === 10) this.place = "text";
      return;
    }
    if (this.place === "text") return this.text(byte);
    this.buffer[this.count++] = byte;
    if (this.count === 2 && byte > WIRE.lastVersion) {
      this.place = "text";
      this.text(this.buffer[0]);
      this.text(byte);
    } else if (this.count === WIRE.maxWireBytes) {
      this.place = "lost";
      this.on.damaged();
    }
  }

  end() {
    const count = this.place === "begun" ? this.count : 0;
    this.place = "begun";
    this.count = 0;
    // A byte alone between two delimiters is no frame, but may be an empty line.
    if (count === 1) this.text(this.buffer[0]);
    if (count <= 1) return;
    this.buffer[count] = 0;
    const payload = openFrame(this.buffer.subarray(0, count + 1));
    if (payload === null) this.on.damaged();
    else this.on.frame(payload);
  }

  text(byte) {
    if (byte === 10) {
      const line = new TextDecoder().decode(Uint8Array.from(this.line)).replace(/\r$/, "");
      this.line = [];
      this.on.text(line);
    } else if (this.line.length < kLongestLine) {
      this.line.push(byte);
    }
  }
}
