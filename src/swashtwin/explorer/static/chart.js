// Figures on a canvas: zoom, move, read values, and copy as SVG and CSV.

export function h(tag, attributes = {}, ...children) {
  // an element; names that begin with "on" are listeners
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

export const choose = (label, options, value, onchange) =>
  h("label", {}, label, " ", h("select", { onchange: (event) => onchange(event.target.value) }, options.map(([key, text]) => h("option", { value: key, selected: String(key) === String(value) }, text))));

export const say = (text) => {
  const place = document.getElementById("message");
  place.textContent = text;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => { place.textContent = ""; }, 6000);
};

export const short = (value, digits = 3) =>
  value === null || !Number.isFinite(value) ? "—"
    : value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6) ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));

export const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);

export function decibel(value, unit) {
  // level re 1 µm/s² (ISO 1683), or re one unit
  const isMetric = unit === "m/s^2";
  return `${(20 * Math.log10(value / (isMetric ? 1e-6 : 1))).toFixed(1)} dB${isMetric ? "" : ` re 1 ${unit}`}`;
}

export function inUnits(value, unit) {
  const gravity = unit === "m/s^2" ? ` (${short(value / 9.80665)} g)` : "";
  return `${short(value)} ${unit.replace("m/s^2", "m/s²")}${gravity}`;
}

class CanvasPen {
  constructor(context) { this.context = context; }
  line(points, color, { width = 1, dash = [], fill = null } = {}) {
    const pen = this.context;
    pen.beginPath();
    let isDown = false;
    for (let n = 0; n < points.length; n += 2) {
      const isThere = points[n + 1] === points[n + 1];
      if (isThere) pen[isDown ? "lineTo" : "moveTo"](points[n], points[n + 1]);
      isDown = isThere;
    }
    if (fill) { pen.fillStyle = fill; pen.fill(); return; }
    pen.setLineDash(dash);
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.stroke();
  }
  text(text, x, y, color, anchor = "start") {
    this.context.fillStyle = color;
    this.context.textAlign = anchor === "middle" ? "center" : anchor;
    this.context.fillText(text, x, y);
  }
  image(canvas, part, x, y, width, height) { this.context.drawImage(canvas, ...part, x, y, width, height); }
  within(x, y, width, height, draw) {
    this.context.save();
    this.context.beginPath();
    this.context.rect(x, y, width, height);
    this.context.clip();
    draw();
    this.context.restore();
  }
}

class SvgPen {
  constructor() { this.parts = []; }
  line(points, color, { width = 1, dash = [], fill = null } = {}) {
    let path = "", isDown = false;
    for (let n = 0; n < points.length; n += 2) {
      const isThere = points[n + 1] === points[n + 1];
      if (isThere) path += `${isDown ? "L" : "M"}${points[n].toFixed(1)} ${points[n + 1].toFixed(1)}`;
      isDown = isThere;
    }
    const dashes = dash.length ? ` stroke-dasharray="${dash.join(" ")}"` : "";
    this.parts.push(`<path d="${path}" fill="${fill ?? "none"}" stroke="${fill ? "none" : color}" stroke-width="${width}"${dashes}/>`);
  }
  text(text, x, y, color, anchor = "start") {
    const safe = text.replace(/[&<>]/g, (letter) => `&#${letter.charCodeAt(0)};`);
    this.parts.push(`<text x="${x.toFixed(1)}" y="${y.toFixed(1)}" fill="${color}" text-anchor="${anchor}">${safe}</text>`);
  }
  image(canvas, part, x, y, width, height) {
    const cut = h("canvas", { width: Math.max(1, part[2]), height: Math.max(1, part[3]) });
    cut.getContext("2d").drawImage(canvas, ...part, 0, 0, cut.width, cut.height);
    this.parts.push(`<image href="${cut.toDataURL()}" x="${x}" y="${y}" width="${width}" height="${height}" preserveAspectRatio="none"/>`);
  }
  within(x, y, width, height, draw) {
    this.parts.push(`<clipPath id="field"><rect x="${x}" y="${y}" width="${width}" height="${height}"/></clipPath><g clip-path="url(#field)">`);
    draw();
    this.parts.push("</g>");
  }
}

export class Lines {
  // values at equal steps
  constructor(step, values, { name = "", color = 0, start = 0 } = {}) { Object.assign(this, { step, values, name, color, start }); }
  at(x) {
    const value = this.values[Math.round((x - this.start) / this.step)];
    return value === undefined ? NaN : value;
  }
  peak(x, reach) {
    // place of the greatest value near x
    let best = Math.max(0, Math.round((x - reach - this.start) / this.step));
    for (let n = best; n <= (x + reach - this.start) / this.step && n < this.values.length; n++) if (this.values[n] > this.values[best]) best = n;
    return this.start + best * this.step;
  }
  columns(low, high, count) {
    const first = Math.max(0, Math.floor((low - this.start) / this.step)), last = Math.min(this.values.length - 1, Math.ceil((high - this.start) / this.step));
    const points = [];
    const each = (last - first + 1) / count;
    if (each <= 2) {
      for (let n = first; n <= last; n++) points.push(this.start + n * this.step, this.values[n], this.values[n]);
      return points;
    }
    for (let column = 0; column < count; column++) {
      let least = Infinity, most = -Infinity;
      const end = Math.min(last, first + Math.ceil((column + 1) * each) - 1);
      for (let n = first + Math.floor(column * each); n <= end; n++) {
        if (this.values[n] < least) least = this.values[n];
        if (this.values[n] > most) most = this.values[n];
      }
      if (most >= least) points.push(this.start + (first + (column + 0.5) * each) * this.step, least, most);
    }
    return points;
  }
}

export const channelLines = (channels, text, step) => {
  // of each channel, of values that were packed together
  const all = unpack(text), length = all.length / channels.length;
  return channels.map((name, n) => new Lines(step, all.subarray(n * length, (n + 1) * length), { name, color: n }));
};

export class Stems {
  // values at some places, as upright lines
  constructor(places, values, options) { Object.assign(this, { places, values, color: 0, width: 3, stems: 0.01, ...options }); }
  at(x) {
    const reach = (this.places[1] ?? this.places[0] + 1) - this.places[0];
    const n = this.places.findIndex((place) => Math.abs(place - x) <= reach / 2);
    return n < 0 ? NaN : this.values[n];
  }
  columns(low, high) { return this.places.flatMap((place, n) => (place < low || place > high ? [] : [place, this.values[n], this.values[n]])); }
}

const LEFT = 56, RIGHT = 10, TOP = 30, BOTTOM = 24;

function ticks(low, high, most) {
  const span = high - low || 1;
  const power = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10, 20].map((factor) => factor * power).find((length) => span / length <= most);
  const places = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * span; n++) places.push(Number((n * step).toPrecision(12)));
  return places;
}

export class Chart {
  // options: title, x and y (words of the axes), unit, limits, log, height, series, areas [{low, high}], marks [[x, name, isStrong]],
  // image {canvas, x, y}, shaft, drag ("move", "zoom" or "band"), onband(low, high), onmove(view), level (y range)
  constructor(options) {
    Object.assign(this, { log: false, height: 260, series: [], areas: [], marks: [], drag: "move", shaft: null, unit: "", ...options });
    this.view = [...(options.view ?? this.limits)];
    this.canvas = h("canvas", { tabIndex: 0, role: "img", "aria-label": this.title });
    this.tip = h("p", { class: "tip" });
    this.cursor = h("div", { class: "cursor", hidden: true });
    const buttons = [["SVG", "Copy as SVG", () => this.copy("svg")], ["CSV", "Copy as CSV", () => this.copy("csv")], ["All", "Show all", () => this.show(this.limits)]];
    if (this.onband) buttons.unshift(["Band", "Drag a band whose envelope is shown", (event) => this.toggle(event.target)]);
    this.element = h("figure", { class: "chart" },
      h("figcaption", {}, h("strong", {}, this.title), " ", h("span", { class: "tools" }, buttons.map(([text, label, onclick]) => h("button", { class: "small", title: label, "aria-label": `${label}: ${this.title}`, onclick }, text)))),
      h("div", { class: "field" }, this.canvas, this.cursor), this.tip);
    this.listen();
    this.watcher = new ResizeObserver(() => this.draw());
    this.watcher.observe(this.canvas.parentElement);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  }
  toggle(button) {
    this.drag = this.drag === "band" ? "move" : "band";
    button.setAttribute("aria-pressed", this.drag === "band");
  }
  get width() { return this.canvas.parentElement.clientWidth || 600; }
  place(x) { return LEFT + ((x - this.view[0]) / (this.view[1] - this.view[0])) * (this.width - LEFT - RIGHT); }
  value(pixel) { return this.view[0] + ((pixel - LEFT) / (this.width - LEFT - RIGHT)) * (this.view[1] - this.view[0]); }
  show([low, high]) {
    // a part of the horizontal axis, kept within its limits
    const [first, last] = this.limits;
    const span = Math.min(Math.max(high - low, (last - first) * 1e-6), last - first);
    const start = Math.min(Math.max(low, first), last - span);
    this.view = [start, start + span];
    this.onmove?.(this.view);
    this.request();
  }
  zoom(factor, around) {
    const [low, high] = this.view;
    this.show([around - (around - low) * factor, around + (high - around) * factor]);
  }
  set(changes) {
    // new data in the same figure
    Object.assign(this, changes);
    this.request();
  }
  request() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => { this.frame = 0; this.draw(); });
  }
  listen() {
    const canvas = this.canvas;
    const touches = new Map();
    let from = null;
    const at = (event) => event.clientX - canvas.getBoundingClientRect().left;
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey && document.activeElement !== canvas) return; // the page scrolls
      event.preventDefault();
      this.zoom(1.2 ** Math.sign(event.deltaY || event.deltaX), this.value(at(event)));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      touches.set(event.pointerId, at(event));
      canvas.setPointerCapture(event.pointerId);
      from = { pixel: at(event), view: [...this.view], mode: event.shiftKey ? "zoom" : this.drag };
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = touches.get(event.pointerId);
      if (before !== undefined && touches.size === 2) { // two fingers
        const [other] = [...touches].filter(([id]) => id !== event.pointerId).map(([, pixel]) => pixel);
        const ratio = Math.abs(before - other) / Math.max(20, Math.abs(at(event) - other));
        touches.set(event.pointerId, at(event));
        this.zoom(ratio, this.value((at(event) + other) / 2));
        return;
      }
      if (from && before !== undefined) {
        const step = ((from.view[1] - from.view[0]) * (at(event) - from.pixel)) / (this.width - LEFT - RIGHT);
        if (from.mode === "move") this.show([from.view[0] - step, from.view[1] - step]);
        else this.mark(from.pixel, at(event));
      } else this.read(at(event), event.clientY - canvas.getBoundingClientRect().top);
    });
    const end = (event) => {
      touches.delete(event.pointerId);
      if (from && from.mode !== "move" && Math.abs(at(event) - from.pixel) > 5 && event.type === "pointerup") {
        const part = [this.value(from.pixel), this.value(at(event))].sort((a, b) => a - b);
        if (from.mode === "band") this.onband(...part);
        else this.show(part);
      }
      from = null;
      this.cursor.hidden = true;
    };
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, end);
    canvas.addEventListener("pointerleave", () => { this.tip.textContent = ""; this.cursor.hidden = true; });
    canvas.addEventListener("dblclick", () => this.show(this.limits));
    canvas.addEventListener("keydown", (event) => {
      const [low, high] = this.view, step = (high - low) / 8, middle = (low + high) / 2;
      const actions = {
        ArrowLeft: () => this.show([low - step, high - step]), ArrowRight: () => this.show([low + step, high + step]),
        "+": () => this.zoom(0.7, middle), "-": () => this.zoom(1 / 0.7, middle), 0: () => this.show(this.limits),
        c: () => this.copy("svg"), v: () => this.copy("csv"),
      };
      if (event.ctrlKey || event.metaKey || !actions[event.key]) return;
      event.preventDefault();
      event.stopPropagation();
      actions[event.key]();
    });
  }
  mark(start, end) {
    Object.assign(this.cursor.style, { left: `${Math.min(start, end)}px`, width: `${Math.abs(end - start)}px` });
    this.cursor.classList.add("part");
    this.cursor.hidden = false;
  }
  read(pixel, height) {
    // values at the pointer: of a spectrum those of the nearest peak
    let x = this.value(pixel);
    if (x < this.view[0] || x > this.view[1]) return;
    const first = this.series[0];
    if (first?.peak && this.log) x = first.peak(x, (6 * (this.view[1] - this.view[0])) / this.width);
    const order = this.shaft ? ` (${short(x / this.shaft, 4)}×)` : "";
    const values = this.series.slice(0, 6).map((line) => {
      const value = line.at(x);
      return `${line.name} ${inUnits(value, this.unit)}${this.log && value > 0 ? `, ${decibel(value, this.unit)}` : ""}`;
    });
    if (this.image) values.push(this.image.words(x, this.image.y * (1 - (height - TOP) / (this.height - TOP - BOTTOM))));
    this.tip.textContent = `${short(x, 5)} ${this.x}${order}: ${values.join("; ")}`;
    Object.assign(this.cursor.style, { left: `${this.place(x)}px`, width: "1px" });
    this.cursor.classList.remove("part");
    this.cursor.hidden = false;
  }
  draw() {
    const width = this.width, ratio = devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(this.height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
      this.canvas.style.height = `${this.height}px`;
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, this.height);
    context.font = "12px system-ui, sans-serif";
    this.paint(new CanvasPen(context), width);
    this.frames = (this.frames ?? 0) + 1;
  }
  paint(pen, width) {
    const style = getComputedStyle(document.documentElement), color = (name) => style.getPropertyValue(`--${name}`).trim();
    const [low, high] = this.view, columns = Math.max(50, Math.floor(width - LEFT - RIGHT)), bottom = this.height - BOTTOM, right = width - RIGHT;
    const drawn = this.series.map((line) => line.columns(low, high, columns));
    const areas = this.areas.map((area) => [area.low.columns(low, high, columns), area.high.columns(low, high, columns)]);
    const scale = this.log ? (value) => (value > 0 ? Math.log10(value) : NaN) : (value) => value;
    let [least, most] = this.image ? [0, this.image.y] : this.level ?? [Infinity, -Infinity];
    if (!this.image && !this.level) {
      for (const points of drawn) {
        for (let n = 0; n < points.length; n += 3) {
          const bottomValue = scale(points[n + (this.log ? 2 : 1)]), topValue = scale(points[n + 2]);
          if (bottomValue < least) least = bottomValue;
          if (topValue > most) most = topValue;
        }
      }
      if (!(most >= least)) [least, most] = [0, 1];
      if (this.log) least = Math.max(least, most - 6);
      const margin = 0.05 * (most - least) || 0.5;
      [least, most] = [least - margin, most + margin];
    }
    const across = (x) => LEFT + ((x - low) / (high - low)) * (right - LEFT), up = (y) => bottom - ((y - least) / (most - least)) * (bottom - TOP);
    const plain = this.log && most - least > 1.5;
    const levels = this.log ? ticks(least, most, 6).filter((value) => !plain || Number.isInteger(value)) : ticks(least, most, 5);
    for (const value of levels) {
      pen.line([LEFT, up(value), right, up(value)], color("grid"));
      pen.text(this.log ? short(10 ** value, 2) : short(value, 4), LEFT - 6, up(value) + 4, color("soft"), "end");
    }
    for (const value of ticks(low, high, Math.max(2, Math.floor(columns / 80)))) {
      pen.line([across(value), bottom, across(value), bottom + 4], color("mark"));
      pen.text(short(value, 6), Math.min(across(value), right - 14), bottom + 18, color("soft"), "middle");
    }
    pen.text(this.y.replace("m/s^2", "m/s²"), 4, 12, color("soft"));
    pen.text(this.x, right, 12, color("soft"), "end");
    pen.within(LEFT, TOP, right - LEFT, bottom - TOP, () => {
      if (this.image) {
        const { canvas, x } = this.image, from = (low / x) * canvas.width, part = ((high - low) / x) * canvas.width;
        pen.image(canvas, [from, 0, Math.max(1, part), canvas.height], LEFT, TOP, right - LEFT, bottom - TOP);
      }
      areas.forEach(([bottoms, tops], number) => {
        const edge = [], height = (value) => up(Math.max(scale(value) || least, least));
        for (let n = 0; n < tops.length; n += 3) edge.push(across(tops[n]), height(tops[n + 2]));
        for (let n = bottoms.length - 3; n >= 0; n -= 3) edge.push(across(bottoms[n]), height(bottoms[n + 2]));
        pen.line(edge, "", { fill: `${color(`line-${this.areas[number].low.color % 6}`)}38` });
      });
      drawn.forEach((points, number) => {
        const path = [], line = this.series[number], ink = color(`line-${line.color % 6}`) + (line.faint ?? "");
        for (let n = 0; n < points.length; n += 3) path.push(across(points[n]), up(scale(points[n + 2])));
        if (line.stems) {
          const stems = [];
          for (let n = 0; n < path.length; n += 2) stems.push(path[n] + line.stems, bottom, path[n] + line.stems, path[n + 1], NaN, NaN);
          pen.line(stems, line.ink ? color(line.ink) : ink, { width: line.width });
          return;
        }
        if (this.log || points.every((value, n) => n % 3 !== 2 || value === points[n - 1])) {
          pen.line(path, ink, { width: line.width ?? 1.2, dash: line.dash ?? [] });
          return;
        }
        const edge = [], half = points.length > 3 ? (across(points[3]) - across(points[0])) / 2 : 1; // steps: each column as wide as it is
        for (let n = 0; n < path.length; n += 2) edge.push(path[n] - half, path[n + 1], path[n] + half, path[n + 1]);
        for (let n = points.length - 3; n >= 0; n -= 3) {
          const x = across(points[n]), y = Math.max(up(points[n + 1]), up(points[n + 2]) + 1);
          edge.push(x + half, y, x - half, y);
        }
        pen.line(edge, "", { fill: ink }); // an area is drawn much faster than a dense line
      });
      this.over?.(pen, { across, up: (value) => up(scale(value)), color, bottom });
      for (const [x, , isStrong] of this.marks) pen.line([across(x), TOP, across(x), bottom], color(isStrong ? "amber" : "mark"), { dash: [3, 3] });
    });
    const named = [];
    for (const [x, name] of [...this.marks].sort((a, b) => b[2] - a[2] || a[0] - b[0])) {
      if (x < low || x > high || named.some((at) => Math.abs(across(x) - at) < 8 * name.length + 8)) continue;
      pen.text(name, across(x), TOP - 4, color("soft"), "middle");
      named.push(across(x));
    }
  }
  svg() {
    const pen = new SvgPen(), width = Math.max(600, this.width);
    this.paint(pen, width);
    const paper = getComputedStyle(document.documentElement).getPropertyValue("--card").trim();
    return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${this.height}" font-family="sans-serif" font-size="12">`
      + `<title>${this.title.replace(/[&<>]/g, " ")}</title><rect width="100%" height="100%" fill="${paper}"/>${pen.parts.join("")}</svg>`;
  }
  csv() {
    const [low, high] = this.view, points = this.series[0]?.columns(low, high, 1e5) ?? [];
    const quoted = (text) => `"${text.replace(/"/g, '""').replace(/^[=+@-]/, "'$&")}"`;
    const rows = [[this.x, ...this.series.map((line) => `${line.name} [${this.unit}]`)].map(quoted).join(",")];
    for (let n = 0; n < points.length; n += 3) rows.push([points[n], ...this.series.map((line) => line.at(points[n]))].join(","));
    return `${rows.join("\n")}\n`;
  }
  async copy(kind) {
    const text = this[kind]();
    try {
      await navigator.clipboard.writeText(text);
      say(`${this.title}: copied as ${kind.toUpperCase()}.`);
    } catch {
      const link = h("a", { href: URL.createObjectURL(new Blob([text])), download: `figure.${kind}` });
      link.click();
      URL.revokeObjectURL(link.href);
      say(`${this.title}: saved as figure.${kind}.`);
    }
  }
}
