// SPDX-License-Identifier: Apache-2.0
// The page: one session, recorded or live, one frame of it in view.
import { WIRE } from "./tables.js";
import { Recording, LiveSession, reasonOf } from "./model.js";
import { GelView } from "./gel.js";
import { Plots, drawHistogram, drawLatency, drawOverview, kStateClass, minus } from "./charts.js";
import { kLabels, Labels } from "./labels.js";
import { Port, Served, serialOf, whyNoSerial } from "./live.js";

const $ = (id) => document.getElementById(id);

const kIcons = { play: "M6 4l10 6-10 6z", pause: "M5 4h4v12h-4zM11 4h4v12h-4z" };
const kUnknown = "\u2013";

function number(value, valid, digits) {
  return valid ? minus(value.toFixed(digits)) : kUnknown;
}

class Page {
  constructor(recording, served) {
    this.recording = recording;
    this.live = new LiveSession();
    this.live.served = served;
    this.session = recording ?? this.live;
    this.gel = new GelView($("arrows"), $("shot"));
    this.plots = new Plots($("live-plots"));
    this.recorded = recording === null ? null : new Plots($("plots"));
    this.recorded?.draw(recording.rows, recording.data);
    const Source = served ? Served : Port;
    this.port = new Source({
      bytes: (bytes) => this.received(bytes),
      state: (state, words) => this.portIs(state, words),
      picture: (sequence, blob) => this.live.takePicture(sequence, blob),
    });
    this.at = 0; // in session.rows
    this.playing = false;
    this.playedFrom = null;
    this.following = true;
    this.dirty = false;
    this.behind = false; // plots and table are older than numbers and arrows
    this.ticks = 0;
    this.frozen = null;
    this.factors = new Map();
    this.labels = new Labels();
    this.listen();
    this.look(this.session);
    if (recording !== null && recording.data.clip) this.prepareLabels();
    $("session").hidden = false;
    $("desk").hidden = !served;
    if (served) this.port.connect();
  }

  // --- what is shown ---

  look(session) {
    this.stop();
    this.session = session;
    document.body.classList.toggle("is-live", session.live);
    document.body.classList.toggle("has-recording", this.recording !== null);
    $("modes").hidden = this.recording === null;
    $("mode-recording").setAttribute("aria-pressed", String(!session.live));
    $("mode-live").setAttribute("aria-pressed", String(session.live));
    $("connect").hidden = !session.live || !(this.port.served || serialOf() !== null);
    $("save").hidden = !session.live;
    $("with-picture").hidden = session.live ? !session.served : session.pictures.length === 0;
    $("speed-label").hidden = session.live;
    $("live-state").textContent = session.live ? this.portWords() : "";
    $("factor").value = this.factors.get(session) ?? session.factor;
    $("thinned").hidden = true;
    if (!session.live) this.sayWhatIsThinned(session.data);
    this.follow(session.live);
    this.at = session.live ? Math.max(0, session.rows.length - 1) : this.firstOf(session);
    this.refresh();
  }

  // Where a recording is opened: at its first slip, or where the gel is pressed most.
  firstOf(session) {
    const linked = location.hash.match(/^#frame=(\d+)$/);
    if (linked !== null) return this.nearestFrame(session.rows, Number(linked[1]));
    const slip = session.rows.findIndex((row) => row.slip);
    if (slip >= 0) return slip;
    let best = 0;
    session.rows.forEach((row, i) => {
      if (row.entropy > session.rows[best].entropy) best = i;
    });
    return best;
  }

  nearestFrame(rows, frame) {
    let best = 0;
    rows.forEach((row, i) => {
      if (Math.abs(row.frame - frame) < Math.abs(rows[best].frame - frame)) best = i;
    });
    return best;
  }

  // --- labels ---

  prepareLabels() {
    $("labelling").hidden = false;
    $("marks").replaceChildren(
      ...kLabels.map(({ kind, name, key, help }) => {
        const button = document.createElement("button");
        Object.assign(button, { type: "button", textContent: `${name} (${key.toUpperCase()})`, title: help });
        button.dataset.kind = kind;
        button.addEventListener("click", () => this.mark(kind));
        return button;
      }),
    );
    this.showLabels();
  }

  mark(kind) {
    if ($("labelling").hidden || this.session.live) return;
    $("labelling").open = true;
    this.labels.mark(kind, this.row.frame);
    this.showLabels();
  }

  showLabels() {
    const button = (words, label, act) => {
      const element = document.createElement("button");
      Object.assign(element, { type: "button", textContent: words });
      element.setAttribute("aria-label", `${words} ${label.kind}`);
      element.addEventListener("click", act);
      return element;
    };
    $("labels").replaceChildren(
      ...this.labels.list.map((label) => {
        const line = document.createElement("li");
        const words = document.createElement("span");
        words.textContent = label.kind;
        const from = button(String(label.from), label, () => this.go(this.nearestFrame(this.rows, label.from)));
        const to = button(String(label.to), label, () => this.go(this.nearestFrame(this.rows, label.to)));
        from.className = to.className = "go";
        const remove = button("Remove", label, () => {
          this.labels.remove(label);
          this.showLabels();
        });
        line.append(words, from, label.to === null ? "to: mark it again at its last frame" : "to", ...(label.to === null ? [] : [to]), remove);
        return line;
      }),
    );
    for (const element of $("marks").children) {
      const open = this.labels.open.some((label) => label.kind === element.dataset.kind);
      element.setAttribute("aria-pressed", String(open));
    }
    const { problem } = this.labels;
    $("labels-problem").textContent = problem === "" ? `For ${this.recording.data.clip}; put it beside the recording.` : `${problem}.`;
    $("export-labels").disabled = problem !== "";
  }

  sayWhatIsThinned(data) {
    const names = ["values", "markers", "pictures"];
    const nth = (n) => (n === 2 ? "second" : `${n}th`);
    const words = data.every.map((n, i) => (n > 1 ? `${names[i]} of every ${nth(n)}` : "")).filter((w) => w !== "");
    $("thinned").hidden = words.length === 0;
    const rest = "and of each frame in which the state changes; between them the frame before is shown.";
    $("thinned").textContent = `To keep this file small it holds ${words.join(", ")} frame, ${rest}`;
  }

  refresh() {
    const { session, rows } = this;
    if (this.following && session.live) this.at = Math.max(0, rows.length - 1);
    $("scrub").max = Math.max(0, rows.length - 1);
    $("scrub").disabled = rows.length === 0;
    if (session.live) this.showLiveTable();
    this.draw();
    this.show();
  }

  // What takes longest.
  draw() {
    const { session, rows } = this;
    drawOverview($("overview"), rows, session.live ? [] : session.data.marks);
    this.showLatency();
    $("how").hidden = !session.live || rows.length > 0;
    $("live-figure").hidden = rows.length === 0;
    if (session.live) this.plots.draw(rows);
  }

  // A live session goes on while it is looked at: what is looked at stands still.
  get rows() {
    return this.frozen ?? this.session.rows;
  }
  follow(on) {
    this.following = on;
    this.frozen = this.session.live && !on ? this.session.rows.slice() : null;
  }
  get row() {
    return this.rows[this.at];
  }

  show() {
    const { session, row } = this;
    if (row === undefined) return this.showNothing();
    $("scrub").value = this.at;
    const words = `${row.t_s.toFixed(3)} s, ${WIRE.states[row.state].name}`;
    $("scrub").setAttribute("aria-valuetext", `frame ${row.frame}, ${words}`);
    $("when").textContent = `frame ${row.frame} \u00b7 ${row.t_s.toFixed(3)} s`;
    const last = this.rows[this.rows.length - 1];
    const total = session.live ? `${this.rows.length} frames in view` : `${session.data.frames} frames`;
    $("place").textContent = `${row.t_s.toFixed(2)} of ${last.t_s.toFixed(2)} s \u00b7 ${total}`;
    this.showWords(row);
    this.showValues(row);
    this.showGel(row);
    drawHistogram($("histogram"), session.histogramAt(row), session.range_mm);
    this.showCursor(row);
    this.showKeys();
  }

  showNothing() {
    for (const id of ["state", "when", "reason", "place"]) $(id).textContent = "\u00a0";
    $("state").className = "badge none";
    $("state").textContent = "NO DATA";
    $("gel-note").textContent = this.port.open ? "waiting for the first frame" : "no board is connected";
    for (const id of ["e", "rate", "markers", "vx", "vy", "v"]) $(`value-${id}`).textContent = kUnknown;
    for (const id of ["decision", "grip", "alive"]) this.lamp(id, "", kUnknown);
    this.gel.setBox(this.session.box);
    this.gel.show(null, 1);
    this.gel.showPicture(null);
    $("shot-note").textContent = "";
    drawHistogram($("histogram"), null, this.session.range_mm);
    this.showKeys();
    this.showFactor();
  }

  showWords(row) {
    const state = WIRE.states[row.state];
    const reason = reasonOf(row.reason);
    $("state").className = `badge ${kStateClass[row.state]}`;
    $("state").textContent = state.name;
    $("reason").replaceChildren();
    const say = (tag, words) => {
      const element = document.createElement(tag);
      element.textContent = words;
      $("reason").append(element);
    };
    const what = reason.number === 0 ? state.meaning : reason.what;
    say("b", what[0].toUpperCase() + what.slice(1));
    if (reason.number !== 0) say("span", ` Likely cause: ${reason.cause}. Next: ${reason.next}.`);
  }

  lamp(id, css, words) {
    const lamp = $(`lamp-${id}`);
    lamp.className = `lamp ${css}`;
    lamp.lastElementChild.textContent = words;
  }

  showValues(row) {
    const { featuresValid: f, ratesValid: r } = row;
    $("value-e").textContent = number(row.entropy, f, 3);
    $("value-rate").textContent = number(row.rate, r, 2);
    $("value-markers").textContent = f ? String(row.markers) : kUnknown;
    $("value-vx").textContent = number(row.vx, r, 2);
    $("value-vy").textContent = number(row.vy, r, 2);
    $("value-v").textContent = number(Math.hypot(row.vx, row.vy), r, 2);
    this.lamp("decision", row.slip ? "on slip" : "", row.slip ? "slip" : "hold");
    this.showLines(row);
    this.showWhy(row);
  }

  // What the verdict stands on, where it is known.
  showWhy(row) {
    const why = row.why ?? null;
    $("why").hidden = why === null;
    if (why === null) return;
    const unit = why.evidence_unit ? ` ${why.evidence_unit}` : "";
    const frames = why.evidence_frames === 1 ? "1 frame" : `${why.evidence_frames} frames`;
    const none = why.evidence === null || why.evidence === "none";
    const by = `${why.evidence} ${why.evidence_value} of ${why.evidence_threshold}${unit}, ${frames} in a row`;
    const grows = why.contact === "TOUCHING" && !why.slip && why.evidence_value > why.evidence_threshold;
    const words = none ? "No evidence yet" : `Evidence: ${by}${grows ? "; it does not count while the contact grows" : ""}`;
    $("why").textContent = `Contact ${why.contact ?? "not judged"}. ${words}.`;
  }

  // The receiver's rule: GRIP_OK counts only while the last edge of ALIVE is young.
  showLines(row) {
    const now = this.session.live && this.following && this.port.open;
    const fresh = now ? performance.now() - this.session.aliveChanged_ms <= WIRE.freshMs : row.fresh;
    const grip = row.gripOk ? (fresh ? "HIGH" : "HIGH, but ALIVE is stale") : "LOW";
    this.lamp("grip", row.gripOk && fresh ? "on ok" : "", grip);
    this.lamp("alive", fresh ? "on" : "stale", `${row.alive ? "HIGH" : "LOW"}${fresh ? "" : ", stale"}`);
  }

  showGel(row) {
    const { session } = this;
    const factor = Number($("factor").value);
    const field = session.fieldAt(row);
    this.gel.setBox(session.box);
    this.gel.show(field, factor);
    $("gel-note").textContent = field === null ? "no markers in this frame" : "";
    this.showFactor();
    const picture = $("show-picture").checked ? session.pictureAt(row) : null;
    this.gel.showPicture(picture === null ? null : picture.url);
    const notes = [];
    if (picture !== null && picture.index !== row.index) {
      const of = session.rowOf(picture.index);
      notes.push(`picture of ${of.t_s.toFixed(3)} s`);
    }
    if (field !== null && field.index !== row.index) {
      const of = session.rowOf(field.index);
      notes.push(`arrows of ${of.t_s.toFixed(3)} s`);
    }
    $("shot-note").textContent = notes.join(", ");
  }

  showFactor() {
    $("factor-text").textContent = `\u00d7 ${$("factor").value}`;
  }

  showLatency() {
    const { session } = this;
    const { latency } = session;
    $("latency-name").textContent = session.live ? "Age of the picture when sent" : "Arrival to decision";
    $("latency").classList.toggle("none", latency === null);
    $("latency-note").classList.toggle("alone", latency === null);
    if (latency === null) {
      const virtual = "Not known: this run was in virtual time, where computing takes none.";
      const where = "A log of a board and a live session have it.";
      $("latency-note").textContent = session.live ? "Nothing received yet." : `${virtual} ${where}`;
      return;
    }
    const ms = (us) => (us / 1000).toFixed(us < 10000 ? 2 : 1);
    drawLatency($("latency"), latency, session.live ? "exposure to serial line (ms)" : "frame to edge (ms)");
    const { p50_us, p99_us, max_us } = latency;
    $("latency-note").textContent = `median ${ms(p50_us)}, 99 % ${ms(p99_us)}, most ${ms(max_us)} ms`;
  }

  showCursor(row) {
    if (this.session.live) return this.plots.showCursor(row.t_s);
    this.recorded.showCursor(row.t_s);
    $("readout").textContent = this.readout(row);
  }

  readout(row) {
    const f = row.featuresValid;
    const r = row.ratesValid;
    return [
      `frame ${row.frame}`,
      `${row.t_s.toFixed(3)} s`,
      WIRE.states[row.state].name,
      `E ${number(row.entropy, f, 3)} nat`,
      `dE/dt ${number(row.rate, r, 2)} nat/s`,
      `Vx ${number(row.vx, r, 2)} mm/s`,
      `Vy ${number(row.vy, r, 2)} mm/s`,
      `${row.markers} markers`,
    ].join("  \u00b7  ");
  }

  showKeys() {
    const { session } = this;
    const going = session.live ? this.following : this.playing;
    $("play-shape").setAttribute("d", going ? kIcons.pause : kIcons.play);
    $("play").setAttribute("aria-label", going ? "Pause" : session.live ? "Follow" : "Play");
    const none = this.rows.length === 0;
    for (const id of ["play", "step-back", "step-on"]) $(id).disabled = none;
    $("slip-before").disabled = this.slipFrom(-1) < 0;
    $("slip-next").disabled = this.slipFrom(1) < 0;
  }

  showLiveTable() {
    const { live } = this;
    const first = live.rows[0];
    const last = live.rows[live.rows.length - 1];
    const span = live.rows.length > 1 ? last.t_s - first.t_s : 0;
    const share = (n) => `${n}${live.frames > 0 ? ` (${((100 * n) / live.frames).toFixed(1)} %)` : ""}`;
    const rows = [
      ["Status frames", String(live.frames)],
      ["Rate, last minute", span > 0 ? `${((live.rows.length - 1) / span).toFixed(1)} a second` : kUnknown],
      ["Missing in the sequence", String(live.missing)],
      ["Damaged on the way", String(live.damaged)],
      ["Of kinds not shown here", String(live.unknown)],
      ["Marker fields", String(live.fields)],
      ["Times slip raised", String(live.slips)],
    ];
    WIRE.states.forEach((state, i) => live.stateCounts[i] > 0 && rows.push([state.name, share(live.stateCounts[i])]));
    if (live.restarts > 0) rows.push(["Starts of the board", String(live.restarts)]);
    if (live.forgotten > 0) rows.push(["Too old to be saved", `${live.forgotten} frames`]);
    const body = $("live-table").tBodies[0];
    body.replaceChildren(
      ...rows.map(([name, value]) => {
        const line = document.createElement("tr");
        for (const [tag, words] of [["th", name], ["td", value]]) {
          const cell = document.createElement(tag);
          cell.textContent = words;
          line.append(cell);
        }
        return line;
      }),
    );
    this.showParameters();
    const text = live.lines.slice(-80).join("\n");
    if ($("console").textContent !== text) {
      $("console").textContent = text;
      $("console").scrollTop = $("console").scrollHeight;
    }
  }

  // As the device told them last; what is typed goes to it at once, and it answers among the lines of text.
  showParameters() {
    const { parameters } = this.live;
    if (parameters === null) return;
    this.live.parameters = null;
    $("parameters").hidden = false;
    const body = $("parameters").tBodies[0];
    body.replaceChildren(
      ...parameters.map((one) => {
        const line = document.createElement("tr");
        const cell = (tag, child) => {
          const element = document.createElement(tag);
          element.append(child);
          line.append(element);
        };
        const input = document.createElement("input");
        Object.assign(input, { type: "number", min: one.min, max: one.max, value: one.value, title: one.help });
        input.setAttribute("aria-label", one.name);
        input.disabled = !this.port.controls;
        input.addEventListener("change", () => this.say(`set ${one.name} ${input.value}`));
        cell("th", one.name);
        cell("td", input);
        cell("td", one.unit);
        cell("td", `${one.min} to ${one.max}, ${one.class}`);
        return line;
      }),
    );
  }

  say(line) {
    if (line === "") return;
    if (!line.endsWith(" json")) this.live.text(`> ${line}`);
    this.dirty = true;
    this.port.send(line);
  }

  // --- moving ---

  go(at) {
    if (this.following) this.follow(false);
    this.at = Math.min(Math.max(at, 0), Math.max(this.rows.length - 1, 0));
    this.playedFrom = null;
    this.show();
    if (!this.session.live) this.linkSoon();
  }

  // The address, copied, shows this frame. Not while a hand drags: browsers refuse many changes a second.
  linkSoon() {
    clearTimeout(this.linking);
    this.linking = setTimeout(() => history.replaceState(null, "", `#frame=${this.row.frame}`), 300);
  }

  // First frame of the next slip in this direction; -1: none.
  slipFrom(direction) {
    const { rows } = this;
    for (let i = this.at + direction; i >= 0 && i < rows.length; i += direction) {
      if (rows[i].slip && (i === 0 || !rows[i - 1].slip)) return i;
    }
    return -1;
  }

  jump(direction) {
    const at = this.slipFrom(direction);
    if (at >= 0) this.go(at);
  }

  nearest(t_s) {
    const { rows } = this;
    let best = 0;
    rows.forEach((row, i) => {
      if (Math.abs(row.t_s - t_s) < Math.abs(rows[best].t_s - t_s)) best = i;
    });
    return best;
  }

  toggle() {
    if (this.rows.length === 0) return;
    if (this.session.live) {
      this.follow(!this.following);
      return this.refresh();
    }
    if (this.playing) return this.stop();
    if (this.at >= this.rows.length - 1) this.at = 0;
    this.playing = true;
    this.playedFrom = null;
    requestAnimationFrame((now) => this.play(now));
    this.showKeys();
  }

  stop() {
    this.playing = false;
    if (this.row !== undefined) this.showKeys();
  }

  play(now_ms) {
    if (!this.playing) return;
    const { rows } = this;
    const speed = Number($("speed").value);
    if (this.playedFrom === null || this.playedFrom.speed !== speed) {
      this.playedFrom = { now_ms, t_s: this.row.t_s, speed };
    }
    const { playedFrom } = this;
    const t_s = playedFrom.t_s + ((now_ms - playedFrom.now_ms) / 1000) * speed;
    let at = this.at;
    while (at + 1 < rows.length && rows[at + 1].t_s <= t_s) ++at;
    if (at !== this.at) {
      this.at = at;
      this.show();
    }
    if (at === rows.length - 1) return this.stop();
    requestAnimationFrame((next) => this.play(next));
  }

  // --- live ---

  received(bytes) {
    const frames = this.live.frames;
    this.live.push(bytes, performance.now());
    if (this.live.frames > frames) this.heard_ms = performance.now();
    this.dirty = true;
  }

  portIs(state, words) {
    if (state === "open") {  // not before: whoever chooses no port keeps what he has
      this.live.clear();
      this.follow(true);
      this.heard_ms = performance.now();
    }
    this.words = words;
    for (const id of ["line", "tare"]) $(id).disabled = state !== "open" || !this.port.controls;
    $("connect").textContent = state === "open" ? "Disconnect" : "Connect";
    $("connect").classList.toggle("primary", state !== "open");
    $("live-state").className = `live-state ${state}`;
    $("live-state").textContent = words;
    if (this.session.live) this.refresh();
  }

  portWords() {
    if (this.port.served) return this.words ?? "Connecting";
    if (serialOf() === null) return whyNoSerial();
    return this.words ?? "Plug the board in, then Connect and choose its port.";
  }

  async connect() {
    await (this.port.open ? this.port.leave() : this.port.connect());
  }

  // Numbers and arrows ten times a second, plots every third time.
  tick() {
    if (!this.session.live) return;
    if (this.port.open) this.sayWhetherHeard();
    $("save").disabled = this.live.kept.length === 0;
    ++this.ticks;
    if (this.following && this.behind && this.ticks % 3 === 0) {
      this.dirty = this.behind = false;
      this.refresh();
    } else if (this.following && this.dirty) {
      this.dirty = false;
      this.behind = true;
      this.at = Math.max(0, this.rows.length - 1);
      $("scrub").max = this.at;
      this.show();
    } else if (this.row !== undefined) {
      this.showLines(this.row);
    }
  }

  // A port that is open may be the wrong one.
  sayWhetherHeard() {
    const silent_s = Math.floor((performance.now() - this.heard_ms) / 1000);
    const mute = this.live.frames === 0;
    const why = mute
      ? "the wrong port, or firmware that does not know `watch`. Next: see the lines of text below"
      : "the board hangs or is switched off. Next: look at the board";
    const open = this.port.controls ? "Connected" : "Connected, to look only";
    const words = silent_s >= 2 ? `Connected, but no frame for ${silent_s} s. Likely cause: ${why}.` : open;
    if ($("live-state").textContent !== words) $("live-state").textContent = words;
    $("live-state").classList.toggle("silent", silent_s >= 2);
  }

  save() {
    this.download("holdfast_session.csv", this.live.csv());
  }

  download(name, csv) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([csv], { type: "text/csv" }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  // --- hands ---

  listen() {
    const on = (id, event, act) => $(id)?.addEventListener(event, act);
    on("mode-recording", "click", () => this.look(this.recording));
    on("mode-live", "click", () => this.look(this.live));
    on("connect", "click", () => this.connect());
    on("save", "click", () => this.save());
    on("export-labels", "click", () => this.download("labels.csv", this.labels.csv(this.recording.data.clip)));
    on("tare", "click", () => this.say("reference learn"));
    on("ask-parameters", "click", () => this.say("get json"));
    on("say", "submit", (event) => {
      event.preventDefault();
      this.say($("line").value.trim());
      $("line").value = "";
    });
    on("scrub", "input", () => this.go(Number($("scrub").value)));
    on("play", "click", () => this.toggle());
    on("step-back", "click", () => this.go(this.at - 1));
    on("step-on", "click", () => this.go(this.at + 1));
    on("slip-before", "click", () => this.jump(-1));
    on("slip-next", "click", () => this.jump(1));
    on("show-picture", "change", () => this.show());
    on("factor", "input", () => {
      this.factors.set(this.session, $("factor").value);
      this.showFactor();
      if (this.row !== undefined) this.showGel(this.row);
    });
    this.listenToPlots();
    document.addEventListener("keydown", (event) => this.key(event));
    addEventListener("pagehide", () => this.port.leave());
    setInterval(() => this.tick(), 100);
  }

  // Press and drag sets the frame; the pointer alone reads out.
  listenToPlots() {
    for (const plots of [this.recorded, this.plots]) {
      if (plots === null) continue;
      const { svg } = plots;
      const time = (event) =>
        plots.timeAt(new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()).x);
      svg.addEventListener("pointerdown", (event) => {
        if (this.row === undefined) return;
        svg.setPointerCapture(event.pointerId);
        this.go(this.nearest(time(event)));
      });
      svg.addEventListener("pointermove", (event) => {
        if (this.row === undefined) return;
        const at = this.nearest(time(event));
        if (event.buttons === 1) this.go(at);
        else if (plots === this.recorded) this.hover(this.rows[at]);
      });
    }
    this.recorded?.svg.addEventListener("pointerleave", () => this.hover(null));
  }

  hover(row) {
    this.recorded.showPointed(row === null ? null : row.t_s);
    $("readout").textContent = this.readout(row ?? this.row);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const target = event.target;
    // Controls that know the key themselves.
    if (target.matches("select, pre, #factor, #line, #parameters input")) return;
    const far = event.shiftKey ? 10 : 1;
    const acts = {
      ArrowLeft: () => this.go(this.at - far),
      ArrowRight: () => this.go(this.at + far),
      Home: () => this.go(0),
      End: () => this.go(Infinity),
      n: () => this.jump(1),
      p: () => this.jump(-1),
      " ": () => this.toggle(),
      "?": () => ($("keys-help").parentElement.open = !$("keys-help").parentElement.open),
    };
    for (const { kind, key } of kLabels) acts[key] = () => this.mark(kind);
    if (event.key === " " && target.matches("button, summary, input[type=checkbox]")) return;
    const act = acts[event.key];
    if (act === undefined || this.rows.length === 0) return;
    if ((event.key === "Home" || event.key === "End") && target !== $("scrub")) return;
    event.preventDefault();
    act();
  }
}

if (document.getElementById("session") !== null) {
  const data = JSON.parse(document.getElementById("data").textContent);
  const served = data !== null && data.served === true;
  new Page(data === null || served ? null : new Recording(data), served);
}
