/** Pens that draw the same picture on a canvas or as SVG. */
import { element } from "./elements.js";

/**
 * @typedef {object} LineStyle
 * @property {number} [width] [px]
 * @property {number[]} [dash] Lengths of dashes and gaps [px].
 * @property {string | null} [fill] Fills the area instead of drawing the line.
 *
 * @typedef {object} Pen
 * @property {(points: number[], color: string, style?: LineStyle) => void} line
 *   Draws through x, y, x, y, ...; the line is interrupted where y is NaN.
 * @property {(text: string, x: number, y: number, color: string, anchor?: string) => void} text
 * @property {(source: HTMLCanvasElement, part: number[], x: number, y: number, width: number,
 *   height: number) => void} image Draws a part (x, y, width, height) of a picture.
 * @property {(x: number, y: number, width: number, height: number, draw: () => void) => void
 *   } within Draws what `draw` draws, cut off at a rectangle.
 */

/**
 * Call `start` at the first point of each stretch of a line, and `extend` at the others.
 *
 * @param {number[]} points
 * @param {(x: number, y: number) => void} start
 * @param {(x: number, y: number) => void} extend
 */
function traceLine(points, start, extend) {
  let isInterrupted = true;
  for (let n = 0; n < points.length; n += 2) {
    const y = points[n + 1];
    if (Number.isNaN(y)) {
      isInterrupted = true;
      continue;
    }
    if (isInterrupted) start(points[n], y);
    else extend(points[n], y);
    isInterrupted = false;
  }
}

/** @implements {Pen} */
export class CanvasPen {
  /** @param {CanvasRenderingContext2D} context */
  constructor(context) {
    this.context = context;
  }

  /** @type {Pen["line"]} */
  line(points, color, { width = 1, dash = [], fill = null } = {}) {
    const context = this.context;
    context.beginPath();
    traceLine(
      points,
      (x, y) => context.moveTo(x, y),
      (x, y) => context.lineTo(x, y),
    );

    if (fill) {
      context.fillStyle = fill;
      context.fill();
      return;
    }
    context.setLineDash(dash);
    context.strokeStyle = color;
    context.lineWidth = width;
    context.stroke();
  }

  /** @type {Pen["text"]} */
  text(text, x, y, color, anchor = "start") {
    const alignment = anchor === "middle" ? "center" : anchor;
    this.context.fillStyle = color;
    this.context.textAlign = /** @type {CanvasTextAlign} */ (alignment);
    this.context.fillText(text, x, y);
  }

  /** @type {Pen["image"]} */
  image(source, [left, top, partWidth, partHeight], x, y, width, height) {
    this.context.drawImage(source, left, top, partWidth, partHeight, x, y, width, height);
  }

  /** @type {Pen["within"]} */
  within(x, y, width, height, draw) {
    this.context.save();
    this.context.beginPath();
    this.context.rect(x, y, width, height);
    this.context.clip();
    draw();
    this.context.restore();
  }
}

/** @implements {Pen} */
export class SvgPen {
  constructor() {
    /** @type {string[]} */
    this.parts = [];
  }

  /** @type {Pen["line"]} */
  line(points, color, { width = 1, dash = [], fill = null } = {}) {
    let path = "";
    const append = (
      /** @type {string} */ command,
      /** @type {number} */ x,
      /** @type {number} */ y,
    ) => {
      path += `${command}${x.toFixed(1)} ${y.toFixed(1)}`;
    };
    traceLine(
      points,
      (x, y) => append("M", x, y),
      (x, y) => append("L", x, y),
    );

    const paint = fill
      ? `fill="${fill}" stroke="none"`
      : `fill="none" stroke="${color}" stroke-width="${width}"`;
    const dashes = dash.length ? ` stroke-dasharray="${dash.join(" ")}"` : "";
    this.parts.push(`<path d="${path}" ${paint}${dashes}/>`);
  }

  /** @type {Pen["text"]} */
  text(text, x, y, color, anchor = "start") {
    const escaped = text.replace(/[&<>]/g, (letter) => `&#${letter.charCodeAt(0)};`);
    const position = `x="${x.toFixed(1)}" y="${y.toFixed(1)}"`;
    this.parts.push(`<text ${position} fill="${color}" text-anchor="${anchor}">${escaped}</text>`);
  }

  /** @type {Pen["image"]} */
  image(source, [left, top, partWidth, partHeight], x, y, width, height) {
    const size = { width: Math.max(1, partWidth), height: Math.max(1, partHeight) };
    const cut = element("canvas", size);
    cut
      .getContext("2d")
      .drawImage(source, left, top, partWidth, partHeight, 0, 0, cut.width, cut.height);
    const place = `x="${x}" y="${y}" width="${width}" height="${height}"`;
    this.parts.push(`<image href="${cut.toDataURL()}" ${place} preserveAspectRatio="none"/>`);
  }

  /** @type {Pen["within"]} */
  within(x, y, width, height, draw) {
    const rectangle = `<rect x="${x}" y="${y}" width="${width}" height="${height}"/>`;
    this.parts.push(`<clipPath id="field">${rectangle}</clipPath><g clip-path="url(#field)">`);
    draw();
    this.parts.push("</g>");
  }
}
