/**
 * Types of what the server sends and of what the pages share.
 *
 * @typedef {{kind: string, severity: string, channel: string | null, message: string}} Finding
 *
 * @typedef {object} Row One recording of the table.
 * @property {string} name Id of its entry, or its file.
 * @property {"waiting" | "ready" | "broken"} state
 * @property {Finding[]} findings
 * @property {number[]} rms Root mean square along the recording.
 * @property {Record<string, any>} specified Facts that the index specifies.
 * @property {number} revision
 * @property {string} stamp Stamp of its file, which is another one after it was recorded anew.
 * @property {string} [id]
 * @property {string | null} [label]
 * @property {boolean} healthy Whether the label states that nothing is wrong.
 * @property {string | null} [specimen]
 * @property {string | null} [file]
 * @property {number | null} [rpm]
 * @property {number | null} [mpa]
 * @property {number | null} [pistons] Number of pistons, if the recording specifies it.
 * @property {string[]} [channels]
 * @property {string} [unit]
 * @property {number} [rate] Sample rate [Hz].
 * @property {number} [duration] [s]
 * @property {number} [samples]
 *
 * @typedef {object} Change One fact of one recording, before and after it was edited.
 * @property {string} entry
 * @property {string} fact
 * @property {any} previous
 * @property {any} value
 *
 * @typedef {object} Page What a page returns when it is opened.
 * @property {(isWhole?: boolean) => void} [update] Called when the table of recordings changed.
 * @property {(event: KeyboardEvent) => boolean} [keys] Returns whether it used the key.
 * @property {() => void} [leave] Called before another page is opened.
 *
 * @typedef {[number, number]} Range Low and high end.
 *
 * @typedef {object} Series What a chart draws as one line.
 * @property {string} name
 * @property {number} color Number of its color.
 * @property {(low: number, high: number, count: number) => number[]} columns
 *   Returns x, smallest and largest value, one after the other, of at most `count` columns.
 * @property {(x: number) => number} at Value at a position; NaN if there is none.
 * @property {(x: number, reach: number) => number} [peak] Position of the largest value nearby.
 * @property {number} [width] Width of the line [px].
 * @property {number} [stems] If set, values are upright lines, shifted by as many pixels.
 * @property {string} [ink] Name of a color of the style sheet.
 * @property {number[]} [dash] Lengths of dashes and gaps [px].
 * @property {string} [faint] Opacity as two hexadecimal digits.
 */

export {};
