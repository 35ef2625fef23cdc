// SPDX-License-Identifier: Apache-2.0
// Where a live session's bytes come from: the board's port `host` through the Web Serial API, or `holdfast live`. Both
// ask for the frames, hand on every byte, and take their leave.

const kBaud = 115200;

export function serialOf() {
  return "serial" in navigator ? navigator.serial : null;
}

export function whyNoSerial() {
  const where = "in Chromium or Chrome on the machine that the board is plugged into";
  if (!isSecureContext) return `Live mode needs a page from disk. Next: save this page, and open it ${where}.`;
  return `Live mode needs the Web Serial API. Next: open this page ${where}.`;
}

export class Port {
  served = false;
  controls = true;

  // on.bytes(Uint8Array), on.state("open" | "closed", what and next as one text)
  constructor(on) {
    this.on = on;
    this.port = null;
    this.reader = null;
    this.leaving = false;
  }

  get open() {
    return this.port !== null;
  }

  async connect() {
    let port;
    try {
      port = await serialOf().requestPort();
    } catch {
      return this.on.state("closed", "No port was chosen. Next: Connect, and pick the board's port.");
    }
    try {
      await port.open({ baudRate: kBaud });
    } catch (error) {
      const next = "Likely cause: another program has it. Next: close that, then Connect.";
      return this.on.state("closed", `The port could not be opened (${error.message}). ${next}`);
    }
    this.port = port;
    this.leaving = false;
    this.on.state("open", "Connected");
    await this.send("watch on");
    await this.read();
  }

  // The end of the stream is either ours or the cable's. A byte that was garbled (framing, overrun, break) ends one
  // stream and begins another; a port that is gone has none.
  async read() {
    for (let failures = 0; !this.leaving && this.port.readable !== null && failures < 100; ++failures) {
      this.reader = this.port.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await this.reader.read();
          if (done) break;
          failures = 0;
          this.on.bytes(value);
        }
      } catch {
        continue;
      } finally {
        this.reader.releaseLock();
        this.reader = null;
      }
      break;
    }
    const cause = "Likely cause: the cable was pulled, or the board started anew. Next: plug it in, then Connect.";
    const left = "Disconnected. What was received can still be looked at.";
    const words = this.leaving ? left : `The port is gone. ${cause}`;
    await this.close();
    this.on.state("closed", words);
  }

  async send(line) {
    try {
      const writer = this.port.writable.getWriter();
      await writer.write(new TextEncoder().encode(`${line}\r\n`));
      writer.releaseLock();
    } catch {
      // A port that cannot be written to ends its reading, too.
    }
  }

  async leave() {
    if (this.port === null || this.leaving) return;
    this.leaving = true;
    await this.send("watch off");
    if (this.reader !== null) await this.reader.cancel().catch(() => {});
  }

  async close() {
    const { port } = this;
    this.port = null;
    if (port !== null) await port.close().catch(() => {});
  }
}

const kAgain_ms = 2000;

function later(ms) {
  return new Promise((resolve) => setTimeout(resolve, ms));
}

// `holdfast live` on this computer: the bytes of its console's port over HTTP, and the newest picture. The token is in
// the address behind the #, which no browser sends.
export class Served {
  served = true;

  // on: as Port's, and on.picture(sequence of its status frame, its blob)
  constructor(on) {
    this.on = on;
    this.token = location.hash.slice(1);
    this.stream = null;
    this.controls = false;
  }

  get open() {
    return this.stream !== null;
  }

  ask(what, more = {}) {
    return fetch(what, { ...more, headers: { Authorization: `Bearer ${this.token}` } });
  }

  async connect() {
    const stream = new AbortController();
    this.stream = stream;
    let words = "holdfast live has ended, or never began here. Next: start it, and open the address that it prints.";
    try {
      const response = await this.ask("stream", { signal: stream.signal });
      if (response.ok) {
        this.controls = response.headers.get("X-Holdfast-Controls") === "yes";
        this.on.state("open", this.controls ? "Connected" : "Connected, to look only");
        this.lookAtPictures(stream);
        await this.read(response.body.getReader());
      } else {
        words = `Refused: ${await response.text()}.`;
      }
    } catch {
      // As a stream that ends: whoever left is gone on purpose, the others are told.
    }
    const left = stream.signal.aborted;
    this.stream = null;
    this.on.state("closed", left ? "Disconnected. What was received can still be looked at." : words);
  }

  async read(reader) {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) return;
      this.on.bytes(value);
    }
  }

  // One after the other, as fast as the browser shows them; none while nobody looks.
  async lookAtPictures(stream) {
    let after = 0;
    while (!stream.signal.aborted && this.stream === stream) {
      if (document.hidden) {
        await later(500);
        continue;
      }
      try {
        const response = await this.ask(`picture?after=${after}`, { signal: stream.signal });
        if (response.status === 200) {
          after = Number(response.headers.get("X-Holdfast-Number"));
          this.on.picture(Number(response.headers.get("X-Holdfast-Sequence")), await response.blob());
        }
      } catch {
        await later(kAgain_ms);
      }
    }
  }

  async send(line) {
    if (this.controls) await this.ask("send", { method: "POST", body: line }).catch(() => {});
  }

  async leave() {
    this.stream?.abort();
  }
}
