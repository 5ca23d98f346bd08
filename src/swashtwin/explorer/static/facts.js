/** Facts of recordings: show, edit, undo. */
import { element, showMessage } from "./elements.js";
import { formatNumber, formatPressure } from "./numbers.js";
import { attempt, send } from "./server.js";
import { announceChange, loadRows, state, takeTable } from "./state.js";

/** @typedef {import("./types.js").Row} Row */
/** @typedef {import("./types.js").Change} Change */

export const FACTS = {
  label: "Class",
  specimen: "Machine",
  speed: "Speed",
  pressure: "Pressure",
  sensitivity: "Sensitivity",
  unit: "Unit",
  sample_rate: "Sample rate",
};

const BADGES = [
  { style: "alarm", symbol: "▲", text: "broken" },
  { style: "unusual", symbol: "●", text: "check" },
  { style: "normal", symbol: "✓", text: "no finding" },
];
const READING_BADGE = { style: "learning", symbol: "…", text: "reading" };

/**
 * Return how bad the findings of a recording are: 0 broken, 1 to be checked, 2 none.
 *
 * @param {Row} row
 */
export function severityRank(row) {
  const severities = row.findings.map((finding) => finding.severity);
  if (row.state === "broken" || severities.includes("error")) return 0;
  return severities.includes("warning") ? 1 : 2;
}

/** @param {Row} row */
export function severityText(row) {
  return BADGES[severityRank(row)].text;
}

/** @param {Row} row */
export function badge(row) {
  const { style, symbol, text } =
    row.state === "waiting" ? READING_BADGE : BADGES[severityRank(row)];
  const label = element("span", { class: "badge-text" }, ` ${text}`);
  return element("span", { class: `badge ${style}` }, symbol, label);
}

/** @param {Row} row */
export function findingTexts(row) {
  return row.findings.map(({ channel, message }) => (channel ? `${channel}: ${message}` : message));
}

/**
 * Change a fact of recordings.
 *
 * @param {string[]} names
 * @param {keyof typeof FACTS} fact
 * @param {string} value empty to remove the fact
 */
export async function changeFact(names, fact, value) {
  const changes = names
    .map((name) => ({
      entry: name,
      fact,
      previous: state.rows.get(name).specified[fact] ?? null,
      value: value || null,
    }))
    .filter((change) => String(change.previous ?? "") !== value);
  if (!changes.length) return;

  await writeChanges(changes, false);
  const subject = changes.length === 1 ? names[0] : `${changes.length} recordings`;
  showMessage(`${FACTS[fact]} of ${subject}: ${value || "none"}.`);
}

/**
 * Write changes into the index; without changes a proposed index is written as it is.
 *
 * @param {Change[]} changes
 * @param {boolean} isUndo
 */
export async function writeChanges(changes, isUndo) {
  const table = await attempt(() => send("facts", { changes, undo: isUndo }));
  if (!table) {
    // Another window changed the fact: show its value.
    await attempt(loadRows);
    announceChange();
    return;
  }

  takeTable(table);
  if (!isUndo && changes.length) state.undo.push(changes);
  document.getElementById("undo").hidden = !state.undo.length;
  announceChange();
}

/** Undo the last change of facts. */
export async function undoChange() {
  const changes = state.undo.pop();
  if (!changes) return;

  const reversed = changes.map(({ entry, fact, previous }) => ({
    entry,
    fact,
    previous: state.rows.get(entry)?.specified[fact] ?? null,
    value: textOf(previous),
  }));
  await writeChanges(reversed, true);
  showMessage("The last change is undone.");
}

/**
 * Return an element that shows a fact, and becomes a field when it is clicked.
 *
 * If the recording is selected, the fact of all selected recordings is edited.
 *
 * @param {Row} row
 * @param {keyof typeof FACTS} fact
 */
export function factCell(row, fact) {
  const shownText = factText(row, fact);
  const specifiedText = textOf(row.specified[fact]) ?? shownText ?? "";
  if (!state.editable) return specifiedText || "—";

  const button = element("button", {
    class: "cell",
    title: `Edit ${FACTS[fact].toLowerCase()}`,
    onclick: (/** @type {Event} */ event) => {
      event.stopPropagation();
      editFact(row, fact, String(specifiedText), button);
    },
  });
  button.textContent = String(shownText ?? specifiedText) || "—";
  return button;
}

/**
 * Replace the button of a fact by a field until the edit is accepted or canceled.
 *
 * @param {Row} row
 * @param {keyof typeof FACTS} fact
 * @param {string} text
 * @param {HTMLElement} button
 */
function editFact(row, fact, text, button) {
  const list = fact === "label" ? "classes" : null;
  const field = element("input", { "aria-label": FACTS[fact], value: text, list, size: 12 });
  const names = namesToChange(row);
  let isDone = false;

  const finish = (/** @type {boolean} */ isAccepted) => {
    // The field loses the focus when it is removed, which would finish again.
    if (isDone) return;
    isDone = true;
    field.replaceWith(button);
    const value = field.value.trim();
    if (isAccepted && value !== text) changeFact(names, fact, value);
  };

  field.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    event.stopPropagation();
    if (event.key !== "Enter" && event.key !== "Escape") return;
    event.preventDefault(); // otherwise the button that gets the focus is pressed
    finish(event.key === "Enter");
    button.focus();
  });
  field.addEventListener("blur", () => finish(true));
  button.replaceWith(field);
  field.focus();
  field.select();
}

/**
 * Give a recording the class of a number key; return whether the key has one.
 *
 * @param {Row | undefined} row
 * @param {string} key
 */
export function assignClass(row, key) {
  const label = state.classes[Number(key) - 1];
  if (!label || !row) return false;
  changeFact(namesToChange(row), "label", label);
  return true;
}

/** @param {Row} row */
function namesToChange(row) {
  return state.selected.has(row.name) ? [...state.selected] : [row.name];
}

/**
 * @param {Row} row
 * @param {string} fact
 */
function factText(row, fact) {
  if (fact === "label") return row.label;
  if (fact === "specimen") return row.specimen;
  if (fact === "speed") return row.rpm && `${formatNumber(row.rpm, 4)} rpm`;
  if (fact === "pressure") return row.mpa && formatPressure(row.mpa);
  return undefined;
}

/** @param {any} value */
function textOf(value) {
  return Array.isArray(value) ? value.join(", ") : value;
}
