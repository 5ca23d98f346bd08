/** Format numbers, and read packed ones. */

const STANDARD_GRAVITY = 9.80665;
const REFERENCE_ACCELERATION = 1e-6; // 1 µm/s², by ISO 1683
const UNITS_PER_MPA = { MPa: 1, bar: 10 };

const pressureUnit = /** @type {"MPa" | "bar"} */ (document.body.dataset.pressureUnit);
/** Unit of pressures, and its number in a megapascal. */
export const PRESSURE = { unit: pressureUnit, perMpa: UNITS_PER_MPA[pressureUnit] };

/**
 * Return a number with a count of significant digits; a dash for a missing one.
 *
 * @param {number | null} value
 * @param {number} digits
 */
export function formatNumber(value, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "—";

  const magnitude = Math.abs(value);
  if (value !== 0 && (magnitude < 1e-3 || magnitude >= 1e6)) {
    return value.toExponential(digits - 1);
  }
  return String(Number(value.toPrecision(digits)));
}

/**
 * Return the numbers of a text in base 64.
 *
 * @param {string} text
 */
export function unpackNumbers(text) {
  return new Float32Array(unpackBytes(text).buffer);
}

/**
 * Return the bytes of a text in base 64.
 *
 * @param {string} text
 */
export function unpackBytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/**
 * Return a level in decibels, of an acceleration by ISO 1683, of others relative to one unit.
 *
 * @param {number} value
 * @param {string} unit
 */
export function formatDecibels(value, unit) {
  if (unit === "m/s^2") {
    return `${(20 * Math.log10(value / REFERENCE_ACCELERATION)).toFixed(1)} dB`;
  }
  return `${(20 * Math.log10(value)).toFixed(1)} dB re 1 ${unit}`;
}

/**
 * Return a value with its unit, of an acceleration also in g.
 *
 * @param {number} value
 * @param {string} unit
 */
export function formatQuantity(value, unit) {
  const text = `${formatNumber(value)} ${formatUnit(unit)}`;
  return unit === "m/s^2" ? `${text} (${formatNumber(value / STANDARD_GRAVITY)} g)` : text;
}

/**
 * Return a pressure with the unit that the explorer was started with.
 *
 * @param {number} mpa
 */
export function formatPressure(mpa) {
  return `${formatNumber(PRESSURE.perMpa * mpa, 4)} ${PRESSURE.unit}`;
}

/** @param {string} unit */
export function formatUnit(unit) {
  return unit.replace("m/s^2", "m/s²");
}

/**
 * Return a class as a reader should see it.
 *
 * @param {string} label
 */
export function formatLabel(label) {
  return label.replace(/_/g, " ");
}
