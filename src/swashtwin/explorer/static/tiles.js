/** Samples of a recording in tiles, loaded where they are shown. */
import { showMessage } from "./elements.js";
import { requestSamples } from "./server.js";

/** Bins of one tile. */
const TILE = 4096;
/** Samples of the widest bins. */
const MAX_WIDTH = 4 ** 12;
const MAX_TILES = 400;
/** Oldest tiles that are never dropped: those of the whole recording, which stand in for others. */
const KEPT_TILES = 10;
/** Time after which a tile of a recording that is still being read is loaded again. */
const RELOAD_MS = 1000;

/**
 * Extremes of bins of 1, 4, 16, ... samples.
 *
 * Coarser tiles stand in for finer ones until these are loaded.
 */
export class Tiles {
  /**
   * @param {import("./types.js").Row} row
   * @param {(known: number) => void} onLoad called when a tile was loaded, with the share of the
   *   recording that is known
   */
  constructor(row, onLoad) {
    this.row = row;
    this.onLoad = onLoad;
    /** @type {Map<string, {values: Float32Array | null}>} */
    this.tiles = new Map();
    /** Whether another page is shown. */
    this.isLeft = false;
  }

  /**
   * Return the samples of a bin for a figure.
   *
   * @param {number} span length of what is shown [s]
   * @param {number} columns
   */
  width(span, columns) {
    let width = 1;
    while (width * columns * 2 < span * this.row.rate && width < MAX_WIDTH) width *= 4;
    return width;
  }

  /**
   * Return the values of a tile; null if it is not loaded.
   *
   * @param {number} width
   * @param {number} number
   * @param {boolean} isWanted whether to load it
   */
  values(width, number, isWanted) {
    const key = `${width}/${number}`;
    const tile = this.tiles.get(key);
    if (tile) return tile.values;

    const start = number * TILE;
    const exists = number >= 0 && start * width < this.row.samples;
    if (isWanted && exists) this.load(key, width, start);
    return null;
  }

  /**
   * @param {string} key
   * @param {number} width
   * @param {number} start
   */
  async load(key, width, start) {
    /** @type {{values: Float32Array | null}} */
    const tile = { values: null };
    this.tiles.set(key, tile);
    if (this.tiles.size > MAX_TILES) this.tiles.delete([...this.tiles.keys()][KEPT_TILES]);

    try {
      await this.fill(tile, { name: this.row.name, width, start, count: TILE });
    } catch (error) {
      showMessage(/** @type {Error} */ (error).message);
    }
  }

  /**
   * Load the values of a tile, again and again until all of the recording was read.
   *
   * @param {{values: Float32Array | null}} tile
   * @param {Record<string, any>} query
   */
  async fill(tile, query) {
    let known = 0;
    while (known < 1 && !this.isLeft) {
      if (known > 0) await new Promise((resolve) => setTimeout(resolve, RELOAD_MS));
      const answer = await requestSamples(query);
      tile.values = answer.values;
      known = answer.known;
      this.onLoad(known);
    }
  }

  /**
   * Return x, smallest and largest value of columns, one after the other.
   *
   * @param {number} channel
   * @param {number} low [s]
   * @param {number} high [s]
   * @param {number} count
   */
  columns(channel, low, high, count) {
    const width = this.width(high - low, count);
    const binLength = width / this.row.rate;
    const lastBin = Math.ceil(this.row.samples / width) - 1;
    const first = Math.max(0, Math.floor(low / binLength));
    const last = Math.min(lastBin, Math.ceil(high / binLength));
    const binsPerColumn = Math.max(1, Math.floor((last - first + 1) / count));

    // The tiles on both sides are loaded before they are shown.
    this.values(width, Math.floor(first / TILE) - 1, true);
    this.values(width, Math.floor(last / TILE) + 1, true);

    const points = [];
    // A single sample is a point in time, not an interval.
    const shift = width === 1 ? binLength / 2 : 0;
    const start = first - (first % binsPerColumn);
    for (let bin = start; bin <= last; bin += binsPerColumn) {
      const end = Math.min(bin + binsPerColumn - 1, last);
      const [minimum, maximum] = this.extremes(channel, width, bin, end);
      if (maximum >= minimum) {
        points.push((bin + binsPerColumn / 2) * binLength - shift, minimum, maximum);
      }
    }
    return points;
  }

  /**
   * Return the smallest and largest value of some bins.
   *
   * This runs for each column of each frame, so a tile is looked up once, not for each bin.
   *
   * @param {number} channel
   * @param {number} width
   * @param {number} first
   * @param {number} last
   */
  extremes(channel, width, first, last) {
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    for (let start = first; start <= last; ) {
      const number = Math.floor(start / TILE);
      const end = Math.min(last, (number + 1) * TILE - 1);
      const values = this.values(width, number, true);
      const [lower, upper] = values
        ? this.loadedExtremes(values, channel, start % TILE, end % TILE)
        : this.coarserExtremes(channel, width, start, end);
      minimum = Math.min(minimum, lower);
      maximum = Math.max(maximum, upper);
      start = end + 1;
    }
    return [minimum, maximum];
  }

  /**
   * @param {Float32Array} values of a tile
   * @param {number} channel
   * @param {number} first number of a bin in the tile
   * @param {number} last
   */
  loadedExtremes(values, channel, first, last) {
    const offset = (channel * values.length) / this.row.channels.length;
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    for (let index = offset + 2 * first; index <= offset + 2 * last; index += 2) {
      if (values[index] < minimum) minimum = values[index];
      if (values[index + 1] > maximum) maximum = values[index + 1];
    }
    return [minimum, maximum];
  }

  /**
   * @param {number} channel
   * @param {number} width
   * @param {number} first
   * @param {number} last
   */
  coarserExtremes(channel, width, first, last) {
    let minimum = Number.POSITIVE_INFINITY;
    let maximum = Number.NEGATIVE_INFINITY;
    for (let number = first; number <= last; number++) {
      const [lower, upper] = this.bin(channel, width, number);
      if (lower < minimum) minimum = lower;
      if (upper > maximum) maximum = upper;
    }
    return [minimum, maximum];
  }

  /**
   * Return the extremes of one bin, or of the coarser bin around it; NaN if none is loaded.
   *
   * @param {number} channel
   * @param {number} width
   * @param {number} number
   * @param {boolean} isWanted
   * @returns {[number, number]}
   */
  bin(channel, width, number, isWanted = true) {
    const values = this.values(width, Math.floor(number / TILE), isWanted);
    if (values) {
      const bins = values.length / this.row.channels.length / 2;
      const index = 2 * (channel * bins + (number % TILE));
      return [values[index], values[index + 1]];
    }

    const coarserWidth = width * 4;
    if (coarserWidth > MAX_WIDTH) return [Number.NaN, Number.NaN];
    return this.bin(channel, coarserWidth, Math.floor((number * width) / coarserWidth), false);
  }
}
