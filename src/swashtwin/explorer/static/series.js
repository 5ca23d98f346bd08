/** Data of charts: values at equal steps, and values at single positions. */
import { unpackNumbers } from "./numbers.js";

/**
 * Values at equal steps.
 *
 * @implements {Series}
 * @typedef {import("./types.js").Series} Series
 */
export class Lines {
  /**
   * @param {number} step distance of the values
   * @param {Float32Array} values
   * @param {{name?: string, color?: number, start?: number}} options
   */
  constructor(step, values, { name = "", color = 0, start = 0 } = {}) {
    this.step = step;
    this.values = values;
    this.name = name;
    this.color = color;
    this.start = start;
    this.faint = "";
    this.ink = "";
    /** @type {number | undefined} */
    this.width = undefined;
    /** @type {number[]} */
    this.dash = [];
  }

  /** @param {number} x */
  at(x) {
    return this.values[Math.round((x - this.start) / this.step)] ?? Number.NaN;
  }

  /**
   * Return the position of the largest value near x.
   *
   * @param {number} x
   * @param {number} reach distance within which it is searched
   */
  peak(x, reach) {
    const first = Math.max(0, Math.round((x - reach - this.start) / this.step));
    const last = Math.min(this.values.length - 1, (x + reach - this.start) / this.step);
    let largest = first;
    for (let n = first; n <= last; n++) {
      if (this.values[n] > this.values[largest]) largest = n;
    }
    return this.start + largest * this.step;
  }

  /**
   * @param {number} low
   * @param {number} high
   * @param {number} count
   */
  columns(low, high, count) {
    const first = Math.max(0, Math.floor((low - this.start) / this.step));
    const last = Math.min(this.values.length - 1, Math.ceil((high - this.start) / this.step));
    const valuesPerColumn = (last - first + 1) / count;
    return valuesPerColumn <= 2
      ? this.singleValues(first, last)
      : this.extremes(first, last, valuesPerColumn, count);
  }

  /**
   * @param {number} first
   * @param {number} last
   */
  singleValues(first, last) {
    const points = [];
    for (let n = first; n <= last; n++) {
      points.push(this.start + n * this.step, this.values[n], this.values[n]);
    }
    return points;
  }

  /**
   * @param {number} first
   * @param {number} last
   * @param {number} valuesPerColumn
   * @param {number} count
   */
  extremes(first, last, valuesPerColumn, count) {
    const points = [];
    for (let column = 0; column < count; column++) {
      const begin = first + Math.floor(column * valuesPerColumn);
      const end = Math.min(last, first + Math.ceil((column + 1) * valuesPerColumn) - 1);
      let minimum = Number.POSITIVE_INFINITY;
      let maximum = Number.NEGATIVE_INFINITY;
      for (let n = begin; n <= end; n++) {
        if (this.values[n] < minimum) minimum = this.values[n];
        if (this.values[n] > maximum) maximum = this.values[n];
      }

      // A column of NaN only has neither.
      if (maximum >= minimum) {
        const middle = first + (column + 0.5) * valuesPerColumn;
        points.push(this.start + middle * this.step, minimum, maximum);
      }
    }
    return points;
  }
}

/**
 * Return the lines of each channel from values that were packed together.
 *
 * @param {string[]} channels
 * @param {string} text
 * @param {number} step
 */
export function channelLines(channels, text, step) {
  const values = unpackNumbers(text);
  const length = values.length / channels.length;
  return channels.map((name, color) => {
    const part = values.subarray(color * length, (color + 1) * length);
    return new Lines(step, part, { name, color });
  });
}

/**
 * Values at single positions, drawn as upright lines.
 *
 * @implements {Series}
 */
export class Stems {
  /**
   * @param {number[]} positions
   * @param {number[]} values
   * @param {{name?: string, width?: number, ink?: string}} options
   */
  constructor(positions, values, { name = "", width = 3, ink = "" } = {}) {
    this.positions = positions;
    this.values = values;
    this.name = name;
    this.color = 0;
    this.width = width;
    this.stems = 0.01;
    this.ink = ink;
  }

  /** @param {number} x */
  at(x) {
    const distance = (this.positions[1] ?? this.positions[0] + 1) - this.positions[0];
    const index = this.positions.findIndex((position) => Math.abs(position - x) <= distance / 2);
    return index < 0 ? Number.NaN : this.values[index];
  }

  /**
   * @param {number} low
   * @param {number} high
   */
  columns(low, high) {
    return this.positions.flatMap((position, n) => {
      const isVisible = position >= low && position <= high;
      return isVisible ? [position, this.values[n], this.values[n]] : [];
    });
  }
}
