/** The table of recordings with their facts. */
import { breakable, element, foldedList, scrollTable } from "./elements.js";
import {
  assignClass,
  badge,
  FACTS,
  factCell,
  findingTexts,
  severityRank,
  severityText,
  writeChanges,
} from "./facts.js";
import { formatNumber, formatPressure } from "./numbers.js";
import { attempt, send } from "./server.js";
import { addressOf, rememberAddress, state, step, takeTable } from "./state.js";

/** @typedef {import("./types.js").Row} Row */

/**
 * @typedef {object} Column
 * @property {string} name
 * @property {string} title
 * @property {(row: Row) => string | number} sortKey
 * @property {(row: Row) => any} cell
 */

/** @type {Column[]} */
const COLUMNS = [
  { name: "state", title: "State", sortKey: severityRank, cell: badge },
  { name: "name", title: "Recording", sortKey: titleOf, cell: nameCell },
  factColumn("label", (row) => row.label ?? ""),
  factColumn("specimen", (row) => row.specimen ?? ""),
  factColumn("speed", (row) => row.rpm ?? -1),
  factColumn("pressure", (row) => row.mpa ?? -1),
  {
    name: "duration",
    title: "Length",
    sortKey: (row) => row.duration ?? -1,
    cell: (row) => (row.duration ? `${formatNumber(row.duration)} s` : "—"),
  },
  {
    name: "rms",
    title: "RMS",
    sortKey: (row) => Math.max(0, ...row.rms),
    cell: (row) => sparkline(row.rms),
  },
];

/** @type {Column[]} */
const MORE_COLUMNS = [
  factColumn("sensitivity", (row) => specifiedText(row, "sensitivity")),
  factColumn("unit", (row) => specifiedText(row, "unit")),
  factColumn("sample_rate", (row) => specifiedText(row, "sample_rate")),
];

/**
 * @param {keyof typeof FACTS} fact
 * @param {(row: Row) => string | number} sortKey
 * @returns {Column}
 */
function factColumn(fact, sortKey) {
  return { name: fact, title: FACTS[fact], sortKey, cell: (row) => factCell(row, fact) };
}

/**
 * @param {Row} row
 * @param {string} fact
 */
function specifiedText(row, fact) {
  return String(row.specified[fact] ?? "");
}

/** @param {Row} row */
function titleOf(row) {
  return row.id ?? row.name;
}

/** @param {Row} row */
function nameCell(row) {
  const title = titleOf(row);
  const href = addressOf("recording", { name: row.name });
  const link = element("a", { href, "aria-label": title }, breakable(title));
  return [link, element("small", { class: "reasons" }, findingTexts(row).join(" "))];
}

/**
 * Return a small figure of the root mean square along a recording.
 *
 * @param {number[]} rms
 */
function sparkline(rms) {
  if (rms.length < 2) return "";
  const maximum = Math.max(...rms) || 1;
  const points = rms.map((value, n) => {
    const x = (100 * n) / (rms.length - 1);
    const y = (22 - (20 * value) / maximum).toFixed(1);
    return `${n ? "L" : "M"}${x} ${y}`;
  });

  // Only numbers become markup here.
  const holder = element("span", { class: "spark" });
  holder.innerHTML =
    '<svg viewBox="0 0 100 24" preserveAspectRatio="none" role="img"' +
    ` aria-label="RMS along the recording"><path class="main" d="${points.join("")}"/></svg>`;
  return holder;
}

/**
 * @param {Row} row
 * @returns {string} text in which the filter searches
 */
function searchText(row) {
  const parts = [
    row.name,
    row.label,
    row.specimen,
    row.rpm && Math.round(row.rpm),
    row.mpa && formatPressure(row.mpa),
    severityText(row),
    ...row.findings.map((finding) => finding.message),
  ];
  return parts.join(" ").toLowerCase();
}

/**
 * @param {(row: Row) => string | number} sortKey
 * @param {number} sign
 */
function comparison(sortKey, sign) {
  return (/** @type {Row} */ a, /** @type {Row} */ b) => {
    const keyA = sortKey(a);
    const keyB = sortKey(b);
    if (typeof keyA === "number" && typeof keyB === "number") return sign * (keyA - keyB);
    return sign * String(keyA).localeCompare(String(keyB), undefined, { numeric: true });
  };
}

class RecordingsPage {
  /**
   * @param {HTMLElement} place
   * @param {Record<string, string>} values
   */
  constructor(place, values) {
    state.filter = values.filter ?? state.filter;
    this.columns = COLUMNS;
    /** @type {Map<string, {line: HTMLElement, content: string}>} rows that are shown, by name */
    this.lines = new Map();

    this.head = element("tr");
    this.body = element("tbody");
    this.summary = element("div");
    this.count = element("span", { class: "soft", role: "status" });
    this.filter = element("input", {
      type: "search",
      class: "wide",
      value: state.filter,
      placeholder: "Filter: words of any column",
      "aria-label": "Filter",
      oninput: () => this.applyFilter(),
    });
    const toggleColumns = () => this.toggleColumns();
    this.allFacts = element(
      "button",
      { "aria-pressed": "false", onclick: toggleColumns },
      "All facts",
    );
    const compare = () => {
      location.hash = addressOf("compare", { a: [...state.selected].join("|") });
    };
    this.compare = element("button", { onclick: compare }, "Compare selected");

    const tools = [this.filter, this.allFacts, this.compare, this.count];
    place.append(
      element("h1", {}, "Recordings"),
      this.summary,
      element("div", { class: "row" }, tools),
      this.table(),
      element("datalist", { id: "classes" }),
    );
    this.update();
  }

  table() {
    const table = scrollTable("Table of recordings", [], [], "recordings");
    table.querySelector("thead").replaceChildren(this.head);
    table.querySelector("tbody").replaceWith(this.body);
    return table;
  }

  applyFilter() {
    state.filter = this.filter.value;
    rememberAddress("recordings", state.filter ? { filter: state.filter } : {});
    this.update();
  }

  toggleColumns() {
    const hasAll = this.columns === COLUMNS;
    this.columns = hasAll ? [...COLUMNS, ...MORE_COLUMNS] : COLUMNS;
    this.allFacts.setAttribute("aria-pressed", String(hasAll));
    this.lines.clear();
    this.update();
  }

  /** Show the recordings as they are now. */
  update() {
    const rows = this.matchingRows();
    state.order = rows.map((row) => row.name);
    if (this.isEditing()) return;

    this.head.replaceChildren(this.selectAllCell(rows), ...this.headerCells());
    this.body.replaceChildren(...rows.map((row) => this.line(row)));
    this.summary.replaceChildren(...this.summaryParts());
    this.compare.hidden = state.selected.size < 2;

    const waiting = state.waiting ? `, ${state.waiting} being read` : "";
    const selected = state.selected.size ? `, ${state.selected.size} selected` : "";
    this.count.textContent = `${rows.length} of ${state.names.length}${waiting}${selected}`;

    const options = state.classes.map((label) => element("option", { value: label }));
    document.getElementById("classes").replaceChildren(...options);
  }

  matchingRows() {
    const words = state.filter.toLowerCase().split(/\s+/).filter(Boolean);
    const column = this.columns.find(({ name }) => name === state.sortColumn) ?? COLUMNS[0];
    return state.names
      .map((name) => state.rows.get(name))
      .filter((row) => {
        const text = searchText(row);
        return words.every((word) => text.includes(word));
      })
      .sort(comparison(column.sortKey, state.sortSign));
  }

  /** Return whether a fact is being typed, which a new table would interrupt. */
  isEditing() {
    const active = document.activeElement;
    return this.body.contains(active) && active.matches("input:not([type=checkbox])");
  }

  /** @param {Row[]} rows */
  selectAllCell(rows) {
    const areAllSelected = rows.length > 0 && rows.every((row) => state.selected.has(row.name));
    const toggleAll = () => {
      for (const row of rows) {
        if (areAllSelected) state.selected.delete(row.name);
        else state.selected.add(row.name);
      }
      this.update();
    };
    const box = element("input", {
      type: "checkbox",
      checked: areAllSelected,
      "aria-label": "Select all shown",
      onchange: toggleAll,
    });
    return element("th", {}, box);
  }

  headerCells() {
    return this.columns.map(({ name, title }) => {
      const isSorted = name === state.sortColumn;
      const isAscending = state.sortSign > 0;
      const sort = () => {
        state.sortColumn = name;
        state.sortSign = isSorted ? -state.sortSign : 1;
        this.update();
      };
      const arrow = isAscending ? " ▲" : " ▼";
      const button = element(
        "button",
        { class: "cell", onclick: sort },
        isSorted ? title + arrow : title,
      );
      const order = isAscending ? "ascending" : "descending";
      const attributes = { class: `column-${name}`, "aria-sort": isSorted ? order : null };
      return element("th", attributes, button);
    });
  }

  /**
   * Return the row of a recording; one that did not change is kept, with its focus.
   *
   * @param {Row} row
   */
  line(row) {
    const isSelected = state.selected.has(row.name);
    const isCurrent = state.current === row.name;
    const content = JSON.stringify([row, isSelected, isCurrent, state.editable]);
    const shown = this.lines.get(row.name);
    if (shown?.content === content) return shown.line;

    const box = element("input", {
      type: "checkbox",
      checked: isSelected,
      "aria-label": `Select ${row.name}`,
      onchange: () => this.toggle(row.name),
    });
    const cells = this.columns.map(({ name, cell }) =>
      element("td", { class: `column-${name}` }, cell(row)),
    );
    const makeCurrent = () => {
      state.current = row.name;
    };
    const attributes = { class: isCurrent ? "current" : "", onclick: makeCurrent };
    const line = element("tr", attributes, element("td", {}, box), cells);
    this.lines.set(row.name, { line, content });
    return line;
  }

  /** @param {string} name */
  toggle(name) {
    if (!state.selected.delete(name)) state.selected.add(name);
    this.update();
  }

  /** Return the source, questions about it, and findings that concern several recordings. */
  summaryParts() {
    const source = element("p", { class: "soft" }, state.source);
    if (state.unwritten) {
      const write = () => writeChanges([], false);
      source.append(
        " has no index yet. The first changed fact writes recordings.toml. ",
        element("button", { class: "small", onclick: write }, "Write it now"),
      );
    }

    const parts = [source];
    if (Object.keys(state.questions).length) parts.push(this.questionForm());

    const remarks = [
      ...state.findings.map((finding) => finding.message),
      ...state.skipped.map((text) => `Excluded: ${text}`),
    ];
    const plural = remarks.length > 1 ? "s" : "";
    const list = foldedList(`${remarks.length} remark${plural} on all recordings`, remarks);
    return list ? [...parts, list] : parts;
  }

  /** Return a form for facts that the files do not contain. */
  questionForm() {
    const fields = Object.entries(state.questions).map(([key, text]) => {
      const question = text.replace(/ \[.*\]$/, "");
      const field = element("input", { name: key, required: key !== "label_pattern" });
      return element("label", { class: "question" }, question, field);
    });
    const submit = async (/** @type {any} */ event) => {
      event.preventDefault();
      const answers = Object.fromEntries(new FormData(event.target));
      const table = await attempt(() => send("answers", answers));
      if (!table) return;
      takeTable(table);
      this.update();
    };
    const button = element("button", { class: "primary" }, "Read the files");
    return element("form", { class: "stack card", onsubmit: submit }, fields, button);
  }

  /**
   * Do what a key means on this page; return whether it means something.
   *
   * @param {KeyboardEvent} event
   */
  keys(event) {
    const current = state.current;
    switch (event.key) {
      case "j":
      case "ArrowDown":
        this.move(1);
        return true;
      case "k":
      case "ArrowUp":
        this.move(-1);
        return true;
      case "/":
        this.filter.focus();
        return true;
      case "Enter":
        if (current) location.hash = addressOf("recording", { name: current });
        return Boolean(current);
      case "x":
        if (current) this.toggle(current);
        return Boolean(current);
      default:
        return assignClass(state.rows.get(current), event.key);
    }
  }

  /** @param {number} count */
  move(count) {
    const isShown = state.current !== null && state.order.includes(state.current);
    state.current = isShown ? step(state.current, count) : state.order[0];
    this.update();
    this.lines.get(state.current)?.line.scrollIntoView({ block: "nearest" });
  }
}

/**
 * @param {HTMLElement} place
 * @param {Record<string, string>} values
 * @returns {import("./types.js").Page}
 */
export function openRecordings(place, values) {
  const page = new RecordingsPage(place, values);
  return { update: () => page.update(), keys: (event) => page.keys(event) };
}
