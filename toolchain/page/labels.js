// SPDX-License-Identifier: Apache-2.0
// What happens in a recording, frame by frame, as a person marks it; and the label file that `holdfast dataset`, `train`
// and `evaluate` read (toolchain/learn/labels.hpp has its columns).

// In the order in which they are shown. `once`: a clip has one of them, and marking it again moves it.
export const kLabels = [
  { kind: "slip", key: "s", name: "Slip", help: "the object moves against the gel", once: true },
  { kind: "hold", key: "h", name: "Hold", help: "held and nothing slips, shaken or not" },
  { kind: "empty", key: "e", name: "Empty", help: "nothing touches the gel" },
  { kind: "contact", key: "c", name: "Contact", help: "from the first touch to the last", once: true },
];

export class Labels {
  constructor() {
    this.list = []; // {kind, from, to}; `to` null: begun, and not ended
  }

  // The first time it begins at this frame, the second time it ends there, whichever comes first in the clip.
  mark(kind, frame) {
    const { once } = kLabels.find((one) => one.kind === kind);
    const open = this.list.find((label) => label.kind === kind && label.to === null);
    if (open !== undefined) {
      [open.from, open.to] = [Math.min(open.from, frame), Math.max(open.from, frame)];
      return;
    }
    if (once) this.list = this.list.filter((label) => label.kind !== kind);
    this.list.push({ kind, from: frame, to: null });
  }

  remove(label) {
    this.list = this.list.filter((one) => one !== label);
  }

  get open() {
    return this.list.filter((label) => label.to === null);
  }

  of(kind) {
    return this.list.filter((label) => label.kind === kind && label.to !== null).sort((a, b) => a.from - b.from);
  }

  // Why there can be no file yet; empty: there can.
  get problem() {
    if (this.open.length > 0) return `${this.open[0].kind} begins at frame ${this.open[0].from} and has no end yet`;
    if (this.list.length === 0) return "nothing is marked yet";
    const [slip] = this.of("slip");
    for (const kind of ["hold", "empty"]) {
      const both = slip === undefined ? undefined : this.of(kind).find((one) => one.from <= slip.to && one.to >= slip.from);
      if (both !== undefined) return `frames ${both.from} to ${both.to} are ${kind} and slip at once`;
    }
    const both = this.of("hold").find((a) => this.of("empty").some((b) => a.from <= b.to && a.to >= b.from));
    return both === undefined ? "" : `frames ${both.from} to ${both.to} are hold and empty at once`;
  }

  // The onset is in the clip where something that does not slip is marked before it.
  csv(clip) {
    const [slip] = this.of("slip");
    const [contact] = this.of("contact");
    const holds = this.of("hold");
    const onset = slip !== undefined && [...holds, ...this.of("empty")].some((one) => one.to < slip.from);
    const columns = {
      clip,
      contact_start: contact?.from ?? "",
      contact_end: contact?.to ?? "",
      slip_start: slip?.from ?? "",
      slip_end: slip?.to ?? "",
      onset_recorded: onset ? 1 : 0,
      silent_intervals: holds.map((one) => `${one.from}-${one.to}:high`).join(";"),
      empty_intervals: this.of("empty").map((one) => `${one.from}-${one.to}`).join(";"),
      confidence: "high",
    };
    const cell = (value) => (/[",\n]/.test(String(value)) ? `"${String(value).replaceAll('"', '""')}"` : value);
    return `${Object.keys(columns).join(",")}\n${Object.values(columns).map(cell).join(",")}\n`;
  }
}
