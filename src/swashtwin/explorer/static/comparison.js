/** Spectra of two sides of a comparison: medians, ranges, and the difference in decibels. */
import { Lines } from "./series.js";

/** Range of a mirrored spectrum below its largest line [dB]. */
const MIRRORED_RANGE = 80;
/** Height up to which a mirrored axis may have ticks [dB]. */
const MAX_HEIGHT = 120;
const DECADE = 20;
/** Share of the lines of a mirrored spectrum that may lie below its axis. */
const LOW_SHARE = 0.05;
/** Healthy recordings below which their range is too narrow to judge by. */
export const MIN_HEALTHY = 3;

/** @param {number} amplitude */
function decibels(amplitude) {
  return 20 * Math.log10(amplitude);
}

/**
 * Return the median of several spectra, and their lowest and highest values, line by line.
 *
 * @param {Lines[]} spectra
 */
export function summarize(spectra) {
  const { step } = spectra[0];
  const count = Math.min(
    ...spectra.map((line) => Math.floor((line.values.length * line.step) / step)),
  );
  const low = new Float32Array(count);
  const middle = new Float32Array(count);
  const high = new Float32Array(count);
  const values = new Float32Array(spectra.length);
  for (let n = 0; n < count; n++) {
    for (let k = 0; k < spectra.length; k++) values[k] = spectra[k].at(n * step);
    values.sort();
    low[n] = values[0];
    middle[n] = values[Math.floor((values.length - 1) / 2)];
    high[n] = values[values.length - 1];
  }
  return {
    low: new Lines(step, low),
    middle: new Lines(step, middle),
    high: new Lines(step, high),
  };
}

/**
 * Return the level of a spectrum in bands of equal width [dB].
 *
 * Single lines scatter by several decibels from one recording to the next, bands by much less.
 *
 * @param {Lines} spectrum
 * @param {number} width of a band, in the unit of its axis
 */
function bandLevels(spectrum, width) {
  const linesPerBand = Math.max(1, Math.round(width / spectrum.step));
  const count = Math.floor(spectrum.values.length / linesPerBand);
  const levels = new Float32Array(count);
  for (let band = 0; band < count; band++) {
    let power = 0;
    for (let n = band * linesPerBand; n < (band + 1) * linesPerBand; n++) {
      power += spectrum.values[n] ** 2;
    }
    levels[band] = decibels(Math.sqrt(power));
  }
  return { levels, step: linesPerBand * spectrum.step };
}

/**
 * Return by how much the levels of a spectrum exceed those of another one [dB].
 *
 * @param {Lines} spectrum
 * @param {Lines} reference
 * @param {number} width of a band
 */
export function levelDifference(spectrum, reference, width) {
  const { levels, step } = bandLevels(spectrum, width);
  const base = bandLevels(reference, width).levels;
  const count = Math.min(levels.length, base.length);
  const difference = Float32Array.from({ length: count }, (_, n) => levels[n] - base[n]);
  return new Lines(step, difference, { start: step / 2 });
}

/**
 * Return how far spectra lie below and above their median at most [dB].
 *
 * @param {Lines[]} spectra
 * @param {number} width of a band
 */
export function scatterOf(spectra, width) {
  const { middle } = summarize(spectra);
  const differences = spectra.map((line) => levelDifference(line, middle, width));
  const { low, high } = summarize(differences);
  for (const limit of [low, high]) limit.start = differences[0].start;
  return { low, high };
}

/**
 * Return the share of the bands of a difference that lie outside the scatter, and the band that
 * lies farthest outside.
 *
 * @param {Lines} difference
 * @param {{low: Lines, high: Lines}} scatter
 * @param {number} end of the bands that count
 */
export function findOutside(difference, scatter, end) {
  let outside = 0;
  let farthest = { position: 0, change: 0, excess: 0 };
  const count = Math.min(
    scatter.low.values.length,
    Math.max(1, Math.floor((end - difference.start) / difference.step)),
  );
  for (let n = 0; n < count; n++) {
    const change = difference.values[n];
    const excess = Math.max(change - scatter.high.values[n], scatter.low.values[n] - change);
    if (excess > 0) outside += 1;
    if (excess > farthest.excess) {
      farthest = { position: difference.start + n * difference.step, change, excess };
    }
  }
  return { share: outside / count, ...farthest };
}

/**
 * A spectrum in decibels above a floor, upward or downward from a common axis.
 *
 * @implements {Series}
 * @typedef {import("./types.js").Series} Series
 */
export class Mirrored {
  /**
   * @param {Lines} line
   * @param {number} sign
   * @param {number} floor level at the axis [dB]
   */
  constructor(line, sign, floor) {
    this.line = line;
    this.sign = sign;
    this.floor = floor;
    this.name = line.name;
    this.color = line.color;
    this.ink = line.ink;
    this.dash = line.dash;
    this.width = line.width;
  }

  /** @param {number} x */
  at(x) {
    return this.line.at(x);
  }

  /**
   * @param {number} low
   * @param {number} high
   * @param {number} count
   */
  columns(low, high, count) {
    const points = this.line.columns(low, high, count);
    for (let n = 0; n < points.length; n += 3) {
      const height = this.sign * Math.max(decibels(points[n + 2]) - this.floor, 0);
      points[n + 1] = height;
      points[n + 2] = height;
    }
    return points;
  }
}

/**
 * Return the level at the common axis of mirrored spectra [dB], a power of ten below nearly all
 * lines.
 *
 * @param {Lines[]} spectra
 */
export function mirrorFloor(spectra) {
  const sorted = spectra.map((line) => line.values.toSorted());
  const low = sorted.map((values) => decibels(values[Math.floor(LOW_SHARE * values.length)]));
  const peak = sorted.map((values) => decibels(values[values.length - 1]));
  const lowest = Math.max(Math.min(...low), Math.max(...peak) - MIRRORED_RANGE);
  return DECADE * Math.floor(lowest / DECADE);
}

/**
 * Return heights of the powers of ten on both sides of a common axis, and their amplitudes.
 *
 * @param {number} floor level at the axis [dB]
 * @returns {[number, number][]}
 */
export function mirrorTicks(floor) {
  /** @type {[number, number][]} */
  const ticks = [];
  for (let height = -MAX_HEIGHT; height <= MAX_HEIGHT; height += DECADE) {
    ticks.push([height, 10 ** ((Math.abs(height) + floor) / DECADE)]);
  }
  return ticks;
}
