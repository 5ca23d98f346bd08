/** The recordings that all pages share, and addresses of pages. */
import { request } from "./server.js";

/** @typedef {import("./types.js").Row} Row */
/** @typedef {import("./types.js").Change} Change */

export const state = {
  /** @type {Map<string, Row>} */
  rows: new Map(),
  /** @type {string[]} names of all recordings */
  names: [],
  /** @type {string[]} names in the order of the table, of those that are shown */
  order: [],
  /** @type {Set<string>} */
  selected: new Set(),
  /** @type {string | null} name of the recording that keys act on */
  current: null,
  /** @type {string[]} */
  classes: [],
  /** @type {{message: string}[]} */
  findings: [],
  /** @type {string[]} */
  skipped: [],
  /** @type {Record<string, string>} */
  questions: {},
  /** @type {Change[][]} changes that can be undone */
  undo: [],
  revision: -1,
  waiting: 0,
  source: "",
  editable: false,
  unwritten: false,
  filter: "",
  sortColumn: "state",
  sortSign: 1,
};

/** @type {Set<() => void>} */
const listeners = new Set();

/**
 * Call a function whenever the recordings changed.
 *
 * @param {() => void} listener
 */
export function onRecordingsChanged(listener) {
  listeners.add(listener);
}

/** Tell all listeners that the recordings changed. */
export function announceChange() {
  for (const listener of listeners) listener();
}

/** Load what changed since the last revision; return whether anything did. */
export async function loadRows() {
  return takeTable(await request("rows", { since: state.revision }));
}

/**
 * Take over a table that the server sent; return whether it is new.
 *
 * @param {any} table
 */
export function takeTable(table) {
  const isNew = table.revision !== state.revision;
  for (const row of table.rows) state.rows.set(row.name, row);

  const names = new Set(table.names);
  for (const name of state.rows.keys()) {
    if (!names.has(name)) state.rows.delete(name);
  }

  state.names = table.names;
  state.revision = table.revision;
  state.waiting = table.waiting;
  state.findings = table.findings;
  state.skipped = table.skipped;
  state.source = table.source;
  state.questions = table.questions;
  state.editable = table.editable;
  state.unwritten = table.unwritten;
  state.classes = sortedClasses();
  return isNew;
}

/** Return the classes of all recordings, the healthy one first. */
function sortedClasses() {
  const rows = [...state.rows.values()].filter((row) => row.label);
  const labels = new Set(rows.map((row) => row.label));
  const healthy = new Set(rows.filter((row) => row.healthy).map((row) => row.label));
  const isHealthy = (/** @type {string} */ label) => Number(healthy.has(label));
  return [...labels].sort((a, b) => isHealthy(b) - isHealthy(a) || a.localeCompare(b));
}

/** Return the rows that were read without error. */
export function readyRows() {
  return state.names.map((name) => state.rows.get(name)).filter((row) => row.state === "ready");
}

/**
 * Return the name of the recording some rows further in the table.
 *
 * @param {string} name
 * @param {number} count negative to go back
 */
export function step(name, count) {
  const order = state.order.length ? state.order : state.names;
  const index = order.indexOf(name) + count;
  return order[Math.min(Math.max(index, 0), order.length - 1)];
}

/**
 * Return the address of a page.
 *
 * @param {string} page
 * @param {Record<string, any>} values
 */
export function addressOf(page, values = {}) {
  const query = new URLSearchParams(values).toString();
  return query ? `#${page}?${query}` : `#${page}`;
}

/**
 * Put the values of a page into the address, unless another page was opened meanwhile.
 *
 * @param {string} page
 * @param {Record<string, any>} values
 */
export function rememberAddress(page, values) {
  const isOpen = location.hash === `#${page}` || location.hash.startsWith(`#${page}?`);
  if (isOpen) history.replaceState(null, "", addressOf(page, values));
}
