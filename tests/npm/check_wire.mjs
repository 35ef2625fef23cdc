// SPDX-License-Identifier: Apache-2.0
// The page's decoder (toolchain/page/wire.js) by itself, on bytes of a recorded session:
//   node check_wire.mjs [--bin DIR]       where session_bytes is (build/sim/bin)
// The last line is "N passed".
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { Receiver, cobsDecode, crc16, openFrame, readEvidence, readLoad, readMarkers, readStatus } from "../../toolchain/page/wire.js";
import { WIRE } from "../../toolchain/page/tables.js";

const root = resolve(dirname(fileURLToPath(import.meta.url)), "../..");
const bin = process.argv[2] === "--bin" ? resolve(process.argv[3]) : join(root, "build/sim/bin");
const work = mkdtempSync(join(tmpdir(), "holdfast_wire_"));
process.on("exit", () => rmSync(work, { recursive: true, force: true }));
execFileSync(join(bin, "session_bytes"), [join(root, "tests/scenes/sphere_slip.json"), join(work, "bytes"), join(work, "values")]);
const bytes = new Uint8Array(readFileSync(join(work, "bytes")));
const values = JSON.parse(readFileSync(join(work, "values"), "utf8"));
let checks = 0;
function check(name, act) {
  act();
  ++checks;
  console.log(`ok   ${name}`);
}

function receive(pieces) {
  const got = { status: [], evidence: [], loads: [], markers: [], text: [], wires: [], damaged: 0 };
  const receiver = new Receiver({
    frame: (payload) => {
      const status = readStatus(payload);
      const evidence = readEvidence(payload);
      const load = readLoad(payload);
      if (status !== null) got.status.push(status);
      else if (evidence !== null) got.evidence.push({ behind: got.status.at(-1)?.sequence, ...evidence });
      else if (load !== null) got.loads.push(load);
      else got.markers.push(readMarkers(payload));
    },
    text: (line) => got.text.push(line),
    damaged: () => ++got.damaged,
  });
  for (const piece of pieces) receiver.push(piece);
  return got;
}

function inPieces(size) {
  const pieces = [];
  for (let at = 0; at < bytes.length; at += size) pieces.push(bytes.subarray(at, at + size));
  return pieces;
}

// Sound frames as they stand in the stream, each with its end.
const wires = [];
for (let from = 0; from < bytes.length; ) {
  const end = bytes.indexOf(0, from);
  if (end < 0) break;
  const wire = bytes.subarray(from, end + 1);
  if (openFrame(wire) !== null) wires.push(wire);
  from = end + 1;
}

check("CRC-16 of the catalogue's check value", () => assert.equal(crc16(new TextEncoder().encode("123456789")), 0x29b1));
check("COBS: the examples of its paper, and what is none", () => {
  const cases = [["01", ""], ["0101", "00"], ["010101", "0000"], ["0311220233", "11220033"], ["0511223344", "11223344"]];
  for (const [wire, plain] of cases) assert.equal(Buffer.from(cobsDecode(Buffer.from(wire, "hex"))).toString("hex"), plain);
  for (const wire of ["", "05112233", "0511002233", "00"]) assert.equal(cobsDecode(Buffer.from(wire, "hex")), null);
});
check("every value of the firmware's decoder, in pieces of any size", () => {
  for (const size of [1, 2, 3, 7, 61, 64, 255, 4096, bytes.length]) {
    const got = receive(inPieces(size));
    assert.equal(got.damaged, values.damaged);
    assert.equal(got.status.length, values.status.length);
    got.status.forEach((status, i) => {
      const want = values.status[i];
      for (const [name, value] of Object.entries(want)) {
        const words = { state: WIRE.states, reason: WIRE.reasons }[name];
        const shown = words === undefined ? status[name] : words.find((row) => row.number === status[name]).name;
        assert.equal(shown, value, `frame ${i}, ${name}`);
      }
    });
    assert.deepEqual(got.text, values.texts);
  }
});
check("every load of the firmware", () => {
  const { loads } = receive([bytes]);
  assert.equal(loads.length, values.loads.length);
  assert.ok(loads.length > 10);
  loads.forEach((load, i) => {
    const want = values.loads[i];
    assert.deepEqual(load, {
      sequence: want.sequence,
      finger: want.finger,
      basis: want.basis,
      within: want.flags % 2 === 1,
      shear_n: Math.hypot(want.shear_x_mn, want.shear_y_mn) / 1000,
      normal_n: want.normal_mn / 1000,
      friction_use: want.friction_use_permille / 1000,
    });
  });
});
check("every evidence of the firmware, behind its status frame", () => {
  const { evidence } = receive([bytes]);
  assert.equal(evidence.length, values.evidence.length);
  const kinds = new Set();
  let alone = 0;
  evidence.forEach((frame, i) => {
    const want = values.evidence[i];
    kinds.add(want.evidence);
    if (frame.behind !== frame.sequence) ++alone;
    const words = { contact: WIRE.contacts[frame.contact], evidence: WIRE.evidences[frame.evidence], unit: WIRE.units[frame.unit] };
    for (const [name, value] of Object.entries(want)) assert.equal(words[name] ?? frame[name], value, `evidence ${i}, ${name}`);
    assert.deepEqual(frame.why, {
      contact: want.contact,
      evidence: want.evidence,
      evidence_value: Number((want.value_milli / 1000).toFixed(1)),
      evidence_threshold: Number((want.threshold_milli / 1000).toFixed(1)),
      evidence_unit: want.unit,
      evidence_frames: want.run,
    });
  });
  assert.equal(alone, 1); // behind the damaged status frame
  assert.ok(kinds.size > 1, [...kinds].join(" "));
});
check("every displacement of the firmware", () => {
  const told = new Map();
  for (const frame of receive([bytes]).markers) {
    if (frame.what !== "displacement") continue;
    for (const m of frame.list) told.set(`${frame.sequence} ${m.index}`, m);
  }
  let missing = 0;
  for (const field of values.fields) {
    field.um.forEach((want, i) => {
      const m = told.get(`${field.sequence} ${i}`);
      if (m === undefined) ++missing;
      else assert.deepEqual(m.valid ? [m.x_um, m.y_um] : null, want);
    });
  }
  // Of the damaged frame only.
  assert.equal(missing, WIRE.markersPerFrame);
});
check("every frame with one byte damaged is refused", () => {
  let damaged = 0;
  for (const wire of wires.slice(0, 12)) {
    for (let at = 0; at < wire.length; ++at) {
      for (let value = 0; value < 256; ++value) {
        if (value === wire[at]) continue;
        const copy = wire.slice();
        copy[at] = value;
        assert.equal(openFrame(copy), null);
        ++damaged;
      }
    }
  }
  console.log(`     ${damaged} damaged frames`);
});
check("and in the stream as well: no wrong value, no text", () => {
  const head = new TextEncoder().encode("hello\r\n");
  for (const wire of [wires[0], wires[20]]) {
    for (let at = 0; at < wire.length - 1; ++at) {
      for (let value = 0; value < 256; ++value) {
        if (value === wire[at]) continue;
        const copy = wire.slice();
        copy[at] = value;
        const got = receive([head, [0], copy, head]);
        assert.equal(got.status.length + got.evidence.length + got.markers.length, 0);
        assert.ok(got.text[0] === "hello");
      }
    }
  }
});
check("an unknown kind, version or state is passed over", () => {
  const status = new Uint8Array(WIRE.statusBytes);
  status[0] = WIRE.version;
  status[1] = WIRE.kinds.status;
  assert.notEqual(readStatus(status), null);
  for (const [at, value] of [[0, 2], [1, 9], [WIRE.status.state[0], WIRE.states.length]]) {
    const other = status.slice();
    other[at] = value;
    assert.equal(readStatus(other), null);
    assert.equal(readMarkers(other), null);
    assert.equal(readEvidence(other), null);
    assert.equal(readLoad(other), null);
  }
});
check("version 2 of a status tells of each finger, version 1 of none", () => {
  // Packed from the byte table of LINK.md, given its CRC and split at its zeros by a few lines of Python.
  const hex = "1402010102040302019c0103620d3f24fafffffa" + "0101010102020102040106030203975f00";
  const wire = Uint8Array.from(hex.match(/../g), (byte) => parseInt(byte, 16));
  assert.equal(wire.length, WIRE.maxWireBytes);
  const frame = readStatus(openFrame(wire));
  assert.deepEqual([frame.version, frame.fingers, frame.healthy, frame.contact], [2, 3, 2, 3]);
  assert.deepEqual([frame.sequence, frame.slip, frame.vx_um_s, frame.entropy_rate_nat_s_q8], [513, true, -1500, 1024]);
  const status = new Uint8Array(WIRE.statusBytes);
  status[0] = WIRE.version;
  status[1] = WIRE.kinds.status;
  assert.equal(readStatus(status).fingers, 0);
});
check("evidence of newer firmware is not taken for another, and where nobody can tell there is no contact", () => {
  const payload = new Uint8Array(WIRE.evidenceBytes);
  payload[0] = WIRE.version;
  payload[1] = WIRE.kinds.evidence;
  payload[WIRE.evidence.contact[0]] = 255;
  payload[WIRE.evidence.evidence[0]] = 9;
  const { why } = readEvidence(payload);
  assert.deepEqual([why.contact, why.evidence], [null, "evidence of newer firmware"]);
  for (const [at, value] of [[0, 2], [1, 9]]) {
    const other = payload.slice();
    other[at] = value;
    assert.equal(readEvidence(other), null);
  }
  assert.equal(readEvidence(payload.subarray(1)), null);
});
console.log(`${checks} passed`);
