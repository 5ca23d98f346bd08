/** The picture of a waterfall: level over time and frequency, or over turns and orders. */
import { element } from "./elements.js";
import { formatDecibels, formatNumber, formatQuantity, unpackBytes } from "./numbers.js";

/** Colors from silence to the largest level, even in lightness. */
const SHADES = [
  [18, 12, 60],
  [90, 20, 110],
  [180, 50, 90],
  [235, 110, 50],
  [252, 200, 60],
  [252, 255, 180],
];

/**
 * Return the color of a share between 0 and 1.
 *
 * @param {number} share
 */
function shadeOf(share) {
  const position = Math.min(share, 0.9999) * (SHADES.length - 1);
  const index = Math.floor(position);
  const weight = position - index;
  const next = SHADES[index + 1];
  return SHADES[index].map((value, part) => value + (next[part] - value) * weight);
}

/**
 * Return the picture of a waterfall that the server sent.
 *
 * @param {any} waterfall
 * @param {boolean} isOrder whether it is over turns and orders
 * @returns {import("./chart.js").Picture}
 */
export function waterfallPicture(waterfall, isOrder) {
  const { frames, bands } = waterfall;
  const shades = unpackBytes(waterfall.shades);
  const canvas = element("canvas", { width: frames, height: bands });
  const context = canvas.getContext("2d");
  const image = context.createImageData(frames, bands);
  for (let frame = 0; frame < frames; frame++) {
    for (let band = 0; band < bands; band++) {
      // Rows of an image begin at the top, frequencies at the bottom.
      const pixel = (bands - 1 - band) * frames + frame;
      const color = shadeOf(shades[frame * bands + band] / 255);
      image.data.set([...color, 255], 4 * pixel);
    }
  }
  context.putImageData(image, 0, 0);

  const describe = (/** @type {number} */ x, /** @type {number} */ y) => {
    const frame = Math.min(frames - 1, Math.floor((x / waterfall.end) * frames));
    const band = Math.min(bands - 1, Math.max(0, Math.floor((y / waterfall.high) * bands)));
    const belowTop = waterfall.range * (1 - shades[frame * bands + band] / 255);
    const value = 10 ** ((waterfall.top - belowTop) / 20);
    const position = `${formatNumber(y, 4)} ${isOrder ? "×" : "Hz"}`;
    const quantity = formatQuantity(value, waterfall.unit);
    return `${position}: ${quantity}, ${formatDecibels(value, waterfall.unit)}`;
  };
  return { canvas, x: waterfall.end, y: waterfall.high, describe };
}
