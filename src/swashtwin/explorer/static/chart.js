/** Charts on a canvas: zoom, move, read values, and copy as SVG and CSV. */
import { CanvasPen, SvgPen } from "./drawing.js";
import { element, showMessage } from "./elements.js";
import { formatDecibels, formatNumber, formatQuantity, formatUnit } from "./numbers.js";

/** @typedef {import("./types.js").Range} Range */
/** @typedef {import("./types.js").Series} Series */
/** @typedef {import("./drawing.js").Pen} Pen */

/**
 * @typedef {object} Picture A picture that fills the field, such as a waterfall.
 * @property {HTMLCanvasElement} canvas
 * @property {number} x End of its horizontal axis; it begins at 0.
 * @property {number} y End of its vertical axis.
 * @property {(x: number, y: number) => string} describe Describes the value at a position.
 *
 * @typedef {object} Scale Where the pen draws.
 * @property {(x: number) => number} across Pixel of a position.
 * @property {(y: number) => number} up Pixel of a value.
 * @property {(name: string) => string} color Color of the style sheet.
 * @property {number} bottom Pixel of the field's lower edge.
 * @property {number} right Pixel of the field's right edge.
 * @property {number} minimum Lower end of the vertical axis; its logarithm if that is logarithmic.
 * @property {number} maximum Upper end of the vertical axis.
 *
 * @typedef {object} ChartOptions
 * @property {string} title
 * @property {string} x Name of the horizontal axis.
 * @property {string} y Name of the vertical axis.
 * @property {string} [unit] Unit of the values.
 * @property {Range} limits Ends of the horizontal axis.
 * @property {Range} [view] Part of it that is shown.
 * @property {boolean} [log] Whether the vertical axis is logarithmic.
 * @property {number} [height] [px]
 * @property {Series[]} [series]
 * @property {{low: Series, high: Series}[]} [areas]
 * @property {[number, string, boolean][]} [marks] Position, name, and whether it is emphasized.
 * @property {Picture} [picture]
 * @property {number | null} [shaft] Shaft frequency, to state positions as orders too.
 * @property {((low: number, high: number) => void) | null} [onBand] Called when a band is dragged.
 * @property {(view: Range) => void} [onMove] Called when another part is shown.
 * @property {(pen: Pen, scale: Scale) => void} [drawOver] Draws over the series.
 * @property {[number, string][]} [ticks] Values of the vertical axis and their texts.
 * @property {(x: number) => void} [onPick] Called with a position that is clicked.
 */

const LEFT = 56;
const RIGHT = 10;
const TOP = 30;
const BOTTOM = 24;

/** Decades that a logarithmic axis shows below its largest value. */
const MAX_DECADES = 6;
/** Shortest part that can be shown, as a share of the whole. */
const MIN_VIEW = 1e-6;
/** Series whose values are stated at the pointer. */
const MAX_READ_SERIES = 6;
/** Distance of the pointer within which a spectrum's peak is read [px]. */
const PEAK_REACH = 6;
/** Distance of a drag that is not a click [px]. */
const MIN_DRAG = 5;
const CSV_ROWS = 1e5;

/**
 * Return round values of an axis.
 *
 * @param {number} low
 * @param {number} high
 * @param {number} maxCount
 */
function roundValues(low, high, maxCount) {
  const span = high - low || 1;
  const power = 10 ** Math.floor(Math.log10(span / maxCount));
  const steps = [1, 2, 5, 10, 20].map((factor) => factor * power);
  const step = steps.find((length) => span / length <= maxCount);

  const values = [];
  // The tolerance keeps values at the ends in spite of rounding.
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * span; n++) {
    values.push(Number((n * step).toPrecision(12)));
  }
  return values;
}

export class Chart {
  /** @param {ChartOptions} options */
  constructor(options) {
    this.title = options.title;
    this.x = options.x;
    this.y = options.y;
    this.unit = options.unit ?? "";
    this.limits = options.limits;
    /** @type {Range} */
    this.view = [...(options.view ?? options.limits)];
    this.log = options.log ?? false;
    this.height = options.height ?? 260;
    this.series = options.series ?? [];
    this.areas = options.areas ?? [];
    this.marks = options.marks ?? [];
    this.picture = options.picture ?? null;
    this.shaft = options.shaft ?? null;
    this.onBand = options.onBand ?? null;
    this.onMove = options.onMove ?? null;
    this.drawOver = options.drawOver ?? null;
    this.ticks = options.ticks ?? null;
    this.onPick = options.onPick ?? null;

    /** @type {"move" | "zoom" | "band"} what a drag does */
    this.drag = "move";
    this.frame = 0;
    /** Number of drawn frames, for measurements of speed. */
    this.frames = 0;

    const canvas = { tabIndex: 0, role: "img", "aria-label": this.title };
    this.canvas = element("canvas", canvas);
    this.tip = element("p", { class: "tip" });
    this.cursor = element("div", { class: "cursor", hidden: true });
    const field = element("div", { class: "field" }, this.canvas, this.cursor);
    this.element = element("figure", { class: "chart" }, this.caption(), field, this.tip);

    this.listen();
    new ResizeObserver(() => this.draw()).observe(field);
    const darkMode = matchMedia("(prefers-color-scheme: dark)");
    darkMode.addEventListener("change", () => this.draw());
  }

  caption() {
    const buttons = [
      this.button("SVG", "Copy as SVG", () => this.copy("svg")),
      this.button("CSV", "Copy as CSV", () => this.copy("csv")),
      this.button("All", "Show all", () => this.show(this.limits)),
    ];
    if (this.onBand) {
      const toggle = (/** @type {any} */ event) => this.toggleBand(event.target);
      buttons.unshift(this.button("Band", "Drag a band for the envelope spectrum", toggle));
    }
    const tools = element("span", { class: "tools" }, buttons);
    return element("figcaption", {}, element("strong", {}, this.title), " ", tools);
  }

  /**
   * @param {string} text
   * @param {string} description
   * @param {(event: Event) => void} onclick
   */
  button(text, description, onclick) {
    const label = `${description}: ${this.title}`;
    const attributes = { class: "small", title: description, "aria-label": label, onclick };
    return element("button", attributes, text);
  }

  /** @param {HTMLElement} button */
  toggleBand(button) {
    this.drag = this.drag === "band" ? "move" : "band";
    button.setAttribute("aria-pressed", String(this.drag === "band"));
  }

  /** @returns {number} width of the whole figure [px] */
  get width() {
    return this.canvas.parentElement.clientWidth || 600;
  }

  get fieldWidth() {
    return this.width - LEFT - RIGHT;
  }

  /** @param {number} x */
  pixelOf(x) {
    const [low, high] = this.view;
    return LEFT + ((x - low) / (high - low)) * this.fieldWidth;
  }

  /** @param {number} pixel */
  positionOf(pixel) {
    const [low, high] = this.view;
    return low + ((pixel - LEFT) / this.fieldWidth) * (high - low);
  }

  /**
   * Show a part of the horizontal axis, kept within its limits.
   *
   * @param {Range} view
   */
  show([low, high]) {
    const [first, last] = this.limits;
    const span = Math.min(Math.max(high - low, (last - first) * MIN_VIEW), last - first);
    const start = Math.min(Math.max(low, first), last - span);
    this.view = [start, start + span];
    this.onMove?.(this.view);
    this.request();
  }

  /**
   * @param {number} factor above 1 to show more
   * @param {number} center position that stays in place
   */
  zoom(factor, center) {
    const [low, high] = this.view;
    this.show([center - (center - low) * factor, center + (high - center) * factor]);
  }

  /**
   * Show other data in the same figure.
   *
   * @param {Partial<ChartOptions>} changes
   */
  set(changes) {
    Object.assign(this, changes);
    this.request();
  }

  /** Draw with the next frame of the screen. */
  request() {
    if (this.frame) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      this.draw();
    });
  }

  listen() {
    this.listenToWheel();
    this.listenToPointer();
    this.canvas.addEventListener("dblclick", () => this.show(this.limits));
    this.canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.ctrlKey || event.metaKey || !this.useKey(event.key)) return;
      event.preventDefault();
      event.stopPropagation();
    });
  }

  /**
   * Pixel of an event from the left edge of the figure.
   *
   * @param {MouseEvent} event
   */
  pixelAt(event) {
    return event.clientX - this.canvas.getBoundingClientRect().left;
  }

  listenToWheel() {
    const zoom = (/** @type {WheelEvent} */ event) => {
      // Without a key and without the focus, the wheel scrolls the page.
      const isMeant = event.ctrlKey || event.shiftKey || document.activeElement === this.canvas;
      if (!isMeant) return;
      event.preventDefault();
      const direction = Math.sign(event.deltaY || event.deltaX);
      this.zoom(1.2 ** direction, this.positionOf(this.pixelAt(event)));
    };
    this.canvas.addEventListener("wheel", zoom, { passive: false });
  }

  listenToPointer() {
    /** @type {Map<number, number>} pixels of the pointers that are down */
    const pointers = new Map();
    /** @type {{pixel: number, view: Range, mode: string} | null} */
    let drag = null;

    this.canvas.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
      const pixel = this.pixelAt(event);
      pointers.set(event.pointerId, pixel);
      this.canvas.setPointerCapture(event.pointerId);
      drag = { pixel, view: [...this.view], mode: event.shiftKey ? "zoom" : this.drag };
    });

    this.canvas.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
      const pixel = this.pixelAt(event);
      const isDown = pointers.has(event.pointerId);
      if (isDown && pointers.size === 2) {
        this.pinch(pointers, event.pointerId, pixel);
      } else if (isDown && drag) {
        this.continueDrag(drag, pixel);
      } else {
        this.read(pixel, event.clientY - this.canvas.getBoundingClientRect().top);
      }
    });

    const finish = (/** @type {PointerEvent} */ event) => {
      pointers.delete(event.pointerId);
      if (drag && event.type === "pointerup") this.finishDrag(drag, this.pixelAt(event));
      drag = null;
      this.cursor.hidden = true;
    };
    this.canvas.addEventListener("pointerup", finish);
    this.canvas.addEventListener("pointercancel", finish);
    this.canvas.addEventListener("pointerleave", () => {
      this.tip.textContent = "";
      this.cursor.hidden = true;
    });
  }

  /**
   * Zoom with two fingers.
   *
   * @param {Map<number, number>} pointers
   * @param {number} id of the finger that moved
   * @param {number} pixel to which it moved
   */
  pinch(pointers, id, pixel) {
    const previousPixel = pointers.get(id);
    const [otherId] = [...pointers.keys()].filter((pointer) => pointer !== id);
    const otherPixel = pointers.get(otherId);
    const ratio = Math.abs(previousPixel - otherPixel) / Math.max(20, Math.abs(pixel - otherPixel));
    pointers.set(id, pixel);
    this.zoom(ratio, this.positionOf((pixel + otherPixel) / 2));
  }

  /**
   * @param {{pixel: number, view: Range, mode: string}} drag
   * @param {number} pixel
   */
  continueDrag(drag, pixel) {
    if (drag.mode !== "move") {
      this.markPart(drag.pixel, pixel);
      return;
    }
    const [low, high] = drag.view;
    const distance = ((high - low) * (pixel - drag.pixel)) / this.fieldWidth;
    this.show([low - distance, high - distance]);
  }

  /**
   * @param {{pixel: number, view: Range, mode: string}} drag
   * @param {number} pixel
   */
  finishDrag(drag, pixel) {
    const isClick = Math.abs(pixel - drag.pixel) <= MIN_DRAG;
    if (isClick) this.onPick?.(this.peakNear(pixel));
    if (drag.mode === "move" || isClick) return;

    const ends = [this.positionOf(drag.pixel), this.positionOf(pixel)].sort((a, b) => a - b);
    const part = /** @type {Range} */ (ends);
    if (drag.mode === "band") this.onBand(...part);
    else this.show(part);
  }

  /**
   * Do what a key means on a figure; return whether it means something.
   *
   * @param {string} key
   */
  useKey(key) {
    const [low, high] = this.view;
    const distance = (high - low) / 8;
    const middle = (low + high) / 2;
    switch (key) {
      case "ArrowLeft":
        this.show([low - distance, high - distance]);
        return true;
      case "ArrowRight":
        this.show([low + distance, high + distance]);
        return true;
      case "+":
        this.zoom(0.7, middle);
        return true;
      case "-":
        this.zoom(1 / 0.7, middle);
        return true;
      case "0":
        this.show(this.limits);
        return true;
      case "c":
        this.copy("svg");
        return true;
      case "v":
        this.copy("csv");
        return true;
      default:
        return false;
    }
  }

  /**
   * Mark the part between two pixels.
   *
   * @param {number} start
   * @param {number} end
   */
  markPart(start, end) {
    this.cursor.style.left = `${Math.min(start, end)}px`;
    this.cursor.style.width = `${Math.abs(end - start)}px`;
    this.cursor.classList.add("part");
    this.cursor.hidden = false;
  }

  /**
   * Return the position of a pixel; of a spectrum, that of the nearest peak.
   *
   * @param {number} pixel
   */
  peakNear(pixel) {
    const x = this.positionOf(pixel);
    const [low, high] = this.view;
    const reach = (PEAK_REACH * (high - low)) / this.width;
    return this.log && this.series[0]?.peak ? this.series[0].peak(x, reach) : x;
  }

  /**
   * State the values at the pointer; of a spectrum, those of the nearest peak.
   *
   * @param {number} pixel
   * @param {number} height from the top of the figure [px]
   */
  read(pixel, height) {
    const [low, high] = this.view;
    const pointed = this.positionOf(pixel);
    if (pointed < low || pointed > high) return;
    const x = this.peakNear(pixel);

    const values = this.series.slice(0, MAX_READ_SERIES).map((line) => this.describe(line, x));
    if (this.picture) {
      const share = 1 - (height - TOP) / (this.height - TOP - BOTTOM);
      values.push(this.picture.describe(x, this.picture.y * share));
    }
    const order = this.shaft ? ` (${formatNumber(x / this.shaft, 4)}×)` : "";
    this.tip.textContent = `${formatNumber(x, 5)} ${this.x}${order}: ${values.join("; ")}`;

    this.cursor.style.left = `${this.pixelOf(x)}px`;
    this.cursor.style.width = "1px";
    this.cursor.classList.remove("part");
    this.cursor.hidden = false;
  }

  /**
   * @param {Series} line
   * @param {number} x
   */
  describe(line, x) {
    const value = line.at(x);
    const level = this.log && value > 0 ? `, ${formatDecibels(value, this.unit)}` : "";
    return `${line.name} ${formatQuantity(value, this.unit)}${level}`;
  }

  draw() {
    const width = this.width;
    const ratio = devicePixelRatio || 1;
    const pixelWidth = Math.round(width * ratio);
    const pixelHeight = Math.round(this.height * ratio);
    if (this.canvas.width !== pixelWidth || this.canvas.height !== pixelHeight) {
      this.canvas.width = pixelWidth;
      this.canvas.height = pixelHeight;
      this.canvas.style.height = `${this.height}px`;
    }

    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, this.height);
    context.font = "12px system-ui, sans-serif";
    this.paint(new CanvasPen(context), width);
    this.frames += 1;
  }

  /**
   * Draw the whole figure with a pen.
   *
   * @param {Pen} pen
   * @param {number} width
   */
  paint(pen, width) {
    const [low, high] = this.view;
    const count = Math.max(50, Math.floor(width - LEFT - RIGHT));
    const columns = this.series.map((line) => line.columns(low, high, count));
    const scale = this.makeScale(width, columns);

    this.paintAxes(pen, scale, count);
    pen.within(LEFT, TOP, scale.right - LEFT, scale.bottom - TOP, () => {
      this.paintPicture(pen, scale);
      for (const area of this.areas) this.paintArea(pen, scale, area, count);
      columns.forEach((points, index) => {
        this.paintSeries(pen, scale, this.series[index], points);
      });
      this.drawOver?.(pen, { ...scale, up: (y) => scale.up(this.scaled(y)) });
      for (const [x, , isEmphasized] of this.marks) {
        const color = scale.color(isEmphasized ? "amber" : "mark");
        pen.line([scale.across(x), TOP, scale.across(x), scale.bottom], color, { dash: [3, 3] });
      }
    });
    this.paintMarkNames(pen, scale);
  }

  /**
   * Return a value as the vertical axis counts it.
   *
   * @param {number} value
   */
  scaled(value) {
    if (!this.log) return value;
    return value > 0 ? Math.log10(value) : Number.NaN;
  }

  /**
   * @param {number} width
   * @param {number[][]} columns
   * @returns {Scale}
   */
  makeScale(width, columns) {
    const [low, high] = this.view;
    const [minimum, maximum] = this.picture ? [0, this.picture.y] : this.verticalRange(columns);
    const bottom = this.height - BOTTOM;
    const right = width - RIGHT;
    const style = getComputedStyle(document.documentElement);
    return {
      across: (x) => LEFT + ((x - low) / (high - low)) * (right - LEFT),
      up: (y) => bottom - ((y - minimum) / (maximum - minimum)) * (bottom - TOP),
      color: (name) => style.getPropertyValue(`--${name}`).trim(),
      bottom,
      right,
      minimum,
      maximum,
    };
  }

  /**
   * Return the ends of the vertical axis for what is shown.
   *
   * @param {number[][]} columns
   * @returns {Range}
   */
  verticalRange(columns) {
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    // On a logarithmic axis only the upper edge of the columns is drawn.
    const lowerOffset = this.log ? 2 : 1;
    for (const points of columns) {
      for (let n = 0; n < points.length; n += 3) {
        const lower = this.scaled(points[n + lowerOffset]);
        const upper = this.scaled(points[n + 2]);
        if (lower < minimum) minimum = lower;
        if (upper > maximum) maximum = upper;
      }
    }

    if (!(maximum >= minimum)) [minimum, maximum] = [0, 1];
    if (this.log) minimum = Math.max(minimum, maximum - MAX_DECADES);
    const margin = 0.05 * (maximum - minimum) || 0.5;
    return [minimum - margin, maximum + margin];
  }

  /**
   * @param {Pen} pen
   * @param {Scale} scale
   * @param {number} columns
   */
  paintAxes(pen, scale, columns) {
    const soft = scale.color("soft");
    for (const [value, text] of this.ticks ?? this.verticalTicks(scale)) {
      if (value < scale.minimum || value > scale.maximum) continue;
      const y = scale.up(value);
      pen.line([LEFT, y, scale.right, y], scale.color("grid"));
      pen.text(text, LEFT - 6, y + 4, soft, "end");
    }

    const [low, high] = this.view;
    for (const value of roundValues(low, high, Math.max(2, Math.floor(columns / 80)))) {
      const x = scale.across(value);
      pen.line([x, scale.bottom, x, scale.bottom + 4], scale.color("mark"));
      // A text at the right end is moved to the left, or it would be cut off.
      const textX = Math.min(x, scale.right - 14);
      pen.text(formatNumber(value, 6), textX, scale.bottom + 18, soft, "middle");
    }

    pen.text(formatUnit(this.y), 4, 12, soft);
    pen.text(this.x, scale.right, 12, soft, "end");
  }

  /**
   * Return values of the vertical axis and their texts.
   *
   * @param {Scale} scale
   * @returns {[number, string][]}
   */
  verticalTicks({ minimum, maximum }) {
    if (!this.log) {
      return roundValues(minimum, maximum, 5).map((value) => [value, formatNumber(value, 4)]);
    }

    // Powers of ten are marked if there are at least two; otherwise also parts of a decade.
    const values = roundValues(minimum, maximum, 6);
    const marked = maximum - minimum > 1.5 ? values.filter(Number.isInteger) : values;
    return marked.map((value) => [value, formatNumber(10 ** value, 2)]);
  }

  /**
   * @param {Pen} pen
   * @param {Scale} scale
   */
  paintPicture(pen, scale) {
    if (!this.picture) return;
    const { canvas, x } = this.picture;
    const [low, high] = this.view;
    const start = (low / x) * canvas.width;
    const part = Math.max(1, ((high - low) / x) * canvas.width);
    const width = scale.right - LEFT;
    pen.image(canvas, [start, 0, part, canvas.height], LEFT, TOP, width, scale.bottom - TOP);
  }

  /**
   * @param {Pen} pen
   * @param {Scale} scale
   * @param {{low: Series, high: Series}} area
   * @param {number} count
   */
  paintArea(pen, scale, area, count) {
    const [low, high] = this.view;
    const lower = area.low.columns(low, high, count);
    const upper = area.high.columns(low, high, count);
    // What lies below the axis, or has no logarithm, is drawn at its lower end.
    const height = (/** @type {number} */ value) =>
      scale.up(Math.max(this.scaled(value) || scale.minimum, scale.minimum));

    const outline = [];
    for (let n = 0; n < upper.length; n += 3) {
      outline.push(scale.across(upper[n]), height(upper[n + 2]));
    }
    for (let n = lower.length - 3; n >= 0; n -= 3) {
      outline.push(scale.across(lower[n]), height(lower[n + 2]));
    }
    const ink = area.low.ink || `line-${area.low.color % 6}`;
    pen.line(outline, "", { fill: `${scale.color(ink)}38` });
  }

  /**
   * @param {Pen} pen
   * @param {Scale} scale
   * @param {Series} line
   * @param {number[]} points
   */
  paintSeries(pen, scale, line, points) {
    const ink = scale.color(line.ink || `line-${line.color % 6}`) + (line.faint ?? "");
    const upperEdge = [];
    for (let n = 0; n < points.length; n += 3) {
      upperEdge.push(scale.across(points[n]), scale.up(this.scaled(points[n + 2])));
    }

    if (line.stems) {
      this.paintStems(pen, scale, upperEdge, line.stems, ink, line.width);
      return;
    }
    const isCurve = points.every((value, n) => n % 3 !== 2 || value === points[n - 1]);
    if (this.log || isCurve) {
      pen.line(upperEdge, ink, { width: line.width ?? 1.2, dash: line.dash });
      return;
    }
    this.paintExtremes(pen, scale, points, upperEdge, ink);
  }

  /**
   * @param {Pen} pen
   * @param {Scale} scale
   * @param {number[]} upperEdge
   * @param {number} shift
   * @param {string} ink
   * @param {number} width
   */
  paintStems(pen, scale, upperEdge, shift, ink, width) {
    const stems = [];
    for (let n = 0; n < upperEdge.length; n += 2) {
      const x = upperEdge[n] + shift;
      stems.push(x, scale.bottom, x, upperEdge[n + 1], Number.NaN, Number.NaN);
    }
    pen.line(stems, ink, { width });
  }

  /**
   * Draw columns from their smallest to their largest value.
   *
   * They are one filled area with steps, which is drawn much faster than a dense line.
   *
   * @param {Pen} pen
   * @param {Scale} scale
   * @param {number[]} points
   * @param {number[]} upperEdge
   * @param {string} ink
   */
  paintExtremes(pen, scale, points, upperEdge, ink) {
    const half = points.length > 3 ? (scale.across(points[3]) - scale.across(points[0])) / 2 : 1;
    const outline = [];
    for (let n = 0; n < upperEdge.length; n += 2) {
      outline.push(upperEdge[n] - half, upperEdge[n + 1], upperEdge[n] + half, upperEdge[n + 1]);
    }
    for (let n = points.length - 3; n >= 0; n -= 3) {
      const x = scale.across(points[n]);
      // At least one pixel high, so that a constant signal is seen.
      const y = Math.max(scale.up(points[n + 1]), scale.up(points[n + 2]) + 1);
      outline.push(x + half, y, x - half, y);
    }
    pen.line(outline, "", { fill: ink });
  }

  /**
   * Write the names of marks, emphasized ones first, unless they would overlap.
   *
   * @param {Pen} pen
   * @param {Scale} scale
   */
  paintMarkNames(pen, scale) {
    const [low, high] = this.view;
    const byImportance = [...this.marks].sort((a, b) => Number(b[2]) - Number(a[2]) || a[0] - b[0]);
    /** @type {number[]} */
    const namedPixels = [];
    for (const [position, name] of byImportance) {
      if (position < low || position > high) continue;
      const x = scale.across(position);
      const minDistance = 8 * name.length + 8;
      if (namedPixels.some((pixel) => Math.abs(x - pixel) < minDistance)) continue;
      pen.text(name, x, TOP - 4, scale.color("soft"), "middle");
      namedPixels.push(x);
    }
  }

  /** Return the figure as SVG. */
  svg() {
    const pen = new SvgPen();
    const width = Math.max(600, this.width);
    this.paint(pen, width);

    const style = getComputedStyle(document.documentElement);
    const paper = style.getPropertyValue("--card").trim();
    const title = this.title.replace(/[&<>]/g, " ");
    const font = 'font-family="sans-serif" font-size="12"';
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${this.height}" ${font}>` +
      `<title>${title}</title><rect width="100%" height="100%" fill="${paper}"/>` +
      `${pen.parts.join("")}</svg>`
    );
  }

  /** Return the values that are shown as CSV, with the limits of areas that have a name. */
  csv() {
    const [low, high] = this.view;
    const points = this.series[0]?.columns(low, high, CSV_ROWS) ?? [];
    const limits = this.areas.flatMap((area) => [area.low, area.high]);
    const lines = [...this.series, ...limits.filter((line) => line.name)];
    const headers = [this.x, ...lines.map((line) => `${line.name} [${this.unit}]`)];
    const rows = [headers.map(quoteCsv).join(",")];
    for (let n = 0; n < points.length; n += 3) {
      const values = lines.map((line) => line.at(points[n]));
      rows.push([points[n], ...values].join(","));
    }
    return `${rows.join("\n")}\n`;
  }

  /**
   * Copy the figure, or save it if the browser does not allow that.
   *
   * @param {"svg" | "csv"} kind
   */
  async copy(kind) {
    const text = kind === "svg" ? this.svg() : this.csv();
    try {
      await navigator.clipboard.writeText(text);
      showMessage(`${this.title}: copied as ${kind.toUpperCase()}.`);
    } catch {
      const href = URL.createObjectURL(new Blob([text]));
      element("a", { href, download: `figure.${kind}` }).click();
      URL.revokeObjectURL(href);
      showMessage(`${this.title}: saved as figure.${kind}.`);
    }
  }
}

/**
 * Quote a text for CSV; a spreadsheet must not take it for a formula.
 *
 * @param {string} text
 */
function quoteCsv(text) {
  return `"${text.replace(/"/g, '""').replace(/^[=+@-]/, "'$&")}"`;
}
