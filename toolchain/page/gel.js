// SPDX-License-Identifier: Apache-2.0
// The gel: arrows from the markers' rest positions over the picture. Yellow as in the paper's figure.

// An element of the drawing `svg` with these attributes. (The name of its namespace is the drawing's own.)
export function shape(svg, name, attributes, parent = svg) {
  const element = document.createElementNS(svg.namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  parent.append(element);
  return element;
}

const kUnits = 600; // the drawing's width, whatever the picture's

export class GelView {
  constructor(svg, shot) {
    this.svg = svg;
    this.shot = shot;
    this.markers = [];
    this.box = null;
  }

  setBox(box) {
    if (this.box !== null && ["left", "top", "width", "height"].every((key) => this.box[key] === box[key])) return;
    this.box = box;
    this.scale = kUnits / box.width;
    const height = box.height * this.scale;
    this.svg.setAttribute("viewBox", `0 0 ${kUnits} ${height}`);
    this.svg.parentElement.style.aspectRatio = `${kUnits} / ${height}`;
  }

  // As many as the grid has.
  setCount(count) {
    if (this.markers.length === count) return;
    this.svg.replaceChildren();
    this.markers = [];
    for (let i = 0; i < count; ++i) {
      const group = shape(this.svg, "g", { "data-marker": i });
      this.markers.push({
        group,
        under: shape(this.svg, "path", { class: "under-arrow" }, group),
        dot: shape(this.svg, "circle", { class: "at-rest", r: 2.4 }, group),
        line: shape(this.svg, "path", { class: "the-arrow" }, group),
        cross: shape(this.svg, "path", { class: "lost-marker" }, group),
      });
    }
  }

  // `field`: null draws nothing.
  show(field, factor) {
    this.svg.classList.toggle("gone", field === null);
    if (field === null) return;
    this.setCount(field.ok.length);
    for (let i = 0; i < field.ok.length; ++i) this.draw(i, field, factor);
  }

  draw(i, field, factor) {
    const marker = this.markers[i];
    const x = (field.rest[2 * i] - this.box.left) * this.scale;
    const y = (field.rest[2 * i + 1] - this.box.top) * this.scale;
    const dx = field.d[2 * i] * factor * this.scale;
    const dy = field.d[2 * i + 1] * factor * this.scale;
    const text = (value) => value.toFixed(2);
    marker.group.setAttribute("class", field.ok[i] ? "" : "is-lost");
    if (!field.ok[i]) {
      marker.cross.setAttribute("d", `M${text(x - 5)} ${text(y - 5)}l10 10m0 -10l-10 10`);
      return;
    }
    marker.dot.setAttribute("cx", text(x));
    marker.dot.setAttribute("cy", text(y));
    const length = Math.hypot(dx, dy);
    let d = "";
    if (length >= 1) {
      const head = Math.min(9, 0.5 * length);
      const ux = dx / length;
      const uy = dy / length;
      const at = (px, py) => `${text(px)} ${text(py)}`;
      const side = (sign) => at(x + dx - head * (ux + sign * 0.5 * uy), y + dy - head * (uy - sign * 0.5 * ux));
      const tip = at(x + dx, y + dy);
      d = `M${at(x, y)}L${tip}M${side(1)}L${tip}L${side(-1)}`;
    }
    marker.line.setAttribute("d", d);
    marker.under.setAttribute("d", d);
  }

  showPicture(url) {
    this.shot.hidden = url === null;
    if (url !== null && this.shot.src !== url) this.shot.src = url;
  }
}
