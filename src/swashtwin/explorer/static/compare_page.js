/** Recordings or classes in one figure, and what differs most. */
import { Chart } from "./chart.js";
import { element, scrollTable, selectMenu } from "./elements.js";
import { formatLabel } from "./numbers.js";
import { channelLines } from "./series.js";
import { attempt, request } from "./server.js";
import { addressOf, readyRows, rememberAddress, state } from "./state.js";

/** Recordings of a class that are shown. */
const MAX_OF_CLASS = 12;
const MAX_LINKS = 8;
const FIRST_SPECTRUM_END = 3000;
const FIRST_ORDER_END = 80;
/** Opacity of lines if there are more than two. */
const FAINT = "73";
const CLASS = "class:";

/**
 * A comparison of side B with side A: a change is the value of B minus that of A.
 *
 * A side is the name of a recording, several names joined by "|", or "class:" and a class.
 */
class ComparePage {
  /**
   * @param {HTMLElement} place
   * @param {Record<string, string>} values
   */
  constructor(place, values) {
    this.rows = readyRows();
    if (this.rows.length < 2) {
      throw new Error("A comparison requires two recordings that can be read.");
    }
    this.sides = this.firstSides(values);
    this.channel = Number(values.channel ?? 0);
    this.kind = values.kind ?? "amplitude";
    this.controls = element("div", { class: "row tight" });
    this.results = element("div");
    this.showControls();

    const hint =
      "Select recordings in the table, or select two classes here." +
      ` Of a class the first ${MAX_OF_CLASS} recordings are shown.`;
    place.append(
      element("h1", {}, "Compare"),
      element("p", { class: "soft" }, hint),
      this.controls,
      this.results,
    );
  }

  /**
   * Return both sides: those of the address, or else the first two classes or recordings.
   *
   * The healthy side is A unless the address states otherwise: a fault then raises its lines.
   *
   * @param {Record<string, string>} values
   */
  firstSides(values) {
    let { a, b } = values;
    const selected = (a ?? "").split("|").filter((name) => state.rows.has(name));
    if (!b && selected.length > 1) {
      // The healthy ones of several selected recordings, or else the first, against the others.
      const healthy = selected.filter((name) => state.rows.get(name).healthy);
      const areMixed = healthy.length > 0 && healthy.length < selected.length;
      const first = areMixed ? healthy : selected.slice(0, 1);
      a = first.join("|");
      b = selected.filter((name) => !first.includes(name)).join("|");
    }

    const [firstClass, secondClass] = state.classes;
    a ||= firstClass ? CLASS + firstClass : this.rows[0].name;
    b ||= secondClass ? CLASS + secondClass : this.rows[1].name;
    return { a, b };
  }

  /** Show the menus with what is selected now. */
  showControls() {
    const firstOfB = this.members(this.sides.b)[0];
    const row = this.rows.find(({ name }) => name === firstOfB) ?? this.rows[0];
    /** @type {[number, string][]} */
    const channels = row.channels.map((name, n) => [n, name]);
    const selectChannel = (/** @type {string} */ value) => {
      this.channel = Number(value);
      this.show();
    };
    const selectKind = (/** @type {string} */ value) => {
      this.kind = value;
      this.show();
    };
    /** @type {[string, string][]} */
    const kinds = [
      ["amplitude", "frequency"],
      ["order", "shaft orders"],
    ];
    this.controls.replaceChildren(
      this.sideMenu("a", "A"),
      this.sideMenu("b", "B"),
      element("button", { onclick: () => this.swapSides() }, "Swap A and B"),
      selectMenu("Channel", channels, this.channel, selectChannel),
      selectMenu("Spectrum over", kinds, this.kind, selectKind),
    );
  }

  swapSides() {
    const { a, b } = this.sides;
    this.sides = { a: b, b: a };
    this.showControls();
    // The button is a new one; the keyboard stays on it.
    this.controls.querySelector("button").focus();
    this.show();
  }

  /**
   * @param {"a" | "b"} key
   * @param {string} label
   */
  sideMenu(key, label) {
    const side = this.sides[key];
    const sides = [
      ...(side.includes("|") ? [side] : []),
      ...state.classes.map((name) => CLASS + name),
      ...this.rows.map((row) => row.name),
    ];
    /** @type {[string, string][]} */
    const options = sides.map((value) => [value, this.describe(value)]);
    return selectMenu(label, options, side, (value) => {
      this.sides = { ...this.sides, [key]: value };
      this.show();
    });
  }

  /**
   * Return the names of the recordings of a side.
   *
   * @param {string} side
   */
  members(side) {
    if (!side.startsWith(CLASS)) {
      return side.split("|").filter((name) => state.rows.has(name));
    }
    const label = side.slice(CLASS.length);
    const rows = this.rows.filter((row) => row.label === label);
    return rows.slice(0, MAX_OF_CLASS).map((row) => row.name);
  }

  /** @param {string} side */
  describe(side) {
    if (side.startsWith(CLASS)) return `class ${formatLabel(side.slice(CLASS.length))}`;
    if (side.includes("|")) return `${this.members(side).length} selected recordings`;
    return state.rows.get(side)?.id ?? side;
  }

  async show() {
    const { a, b } = this.sides;
    rememberAddress("compare", { a, b, channel: this.channel, kind: this.kind });

    // New places: what was requested for other sides arrives in places that are no longer shown.
    const figures = element("div", {}, element("p", { class: "soft" }, "Computing …"));
    const table = element("div");
    this.results.replaceChildren(figures, table);
    await Promise.all([
      attempt(() => this.showSpectra(figures, a, b), figures),
      attempt(() => this.showRanking(table, a, b), table),
    ]);
  }

  /**
   * @param {HTMLElement} place
   * @param {string} a
   * @param {string} b
   */
  async showSpectra(place, a, b) {
    const { channel, kind } = this;
    const first = this.members(a);
    const second = this.members(b);
    const names = [...first, ...second];
    const faint = names.length > 2 ? FAINT : "";
    const series = [];
    let spectrum = null;
    for (const [n, name] of names.entries()) {
      const current = await request("spectrum", { name, kind });
      spectrum ??= current;
      const lines = channelLines(current.channels, current.amplitude, current.step);
      const line = lines[channel];
      if (!line) continue;
      line.name = state.rows.get(name).id;
      line.color = n < first.length ? 0 : 1;
      line.faint = faint;
      series.push(line);
    }

    const isOrder = kind === "order";
    const end = Math.max(...series.map((line) => line.step * line.values.length));
    const makeChart = (
      /** @type {string} */ title,
      /** @type {import("./types.js").Series[]} */ lines,
      /** @type {number} */ height,
    ) =>
      new Chart({
        title,
        x: isOrder ? "order" : "Hz",
        y: spectrum.unit,
        unit: spectrum.unit,
        log: true,
        height,
        shaft: isOrder ? null : spectrum.shaft,
        limits: [0, end],
        view: [0, Math.min(end, isOrder ? FIRST_ORDER_END : FIRST_SPECTRUM_END)],
        marks: spectrum.marks,
        series: lines,
      });

    const titleA = `A: ${this.describe(a)}`;
    const titleB = `B: ${this.describe(b)}`;
    const source = spectrum.excerpts ? `; ${spectrum.excerpts}` : "";
    const both = makeChart(`${titleA} (blue) and ${titleB} (red)${source}`, series, 300);
    const onlyA = makeChart(titleA, series.slice(0, first.length), 180);
    const onlyB = makeChart(titleB, series.slice(first.length), 180);
    linkViews([both, onlyA, onlyB]);
    const columns = element("div", { class: "columns" }, onlyA.element, onlyB.element);
    place.replaceChildren(both.element, columns);
  }

  /**
   * @param {HTMLElement} place
   * @param {string} a
   * @param {string} b
   */
  async showRanking(place, a, b) {
    const first = this.members(a);
    const second = this.members(b);
    const query = new URLSearchParams();
    for (const name of first) query.append("first", name);
    for (const name of second) query.append("second", name);
    const comparison = await request("comparison", query);

    const titleA = `A (${this.describe(a)})`;
    const titleB = `B (${this.describe(b)})`;
    const change = `A positive change means more power in ${titleB} than in ${titleA}.`;
    const spread = comparison.freedom
      ? "Ranked by spreads: the standard deviation within both sides, but at least 1 dB."
      : "With one recording on each side no spread is known; 1 dB is used.";
    const links = [...first, ...second].slice(0, MAX_LINKS).flatMap((name) => {
      const href = addressOf("recording", { name });
      return [element("a", { href }, state.rows.get(name).id), " "];
    });

    const section = element(
      "section",
      {},
      element("h2", {}, "What differs most"),
      element("p", {}, `${change} ${spread}`),
      rankingTable(comparison.rows),
      comparison.notes.map((/** @type {string} */ text) => element("p", { class: "soft" }, text)),
      element("p", {}, "Open: ", links),
    );
    place.replaceChildren(section);
  }
}

/** @param {{band: string, channel: string, change: number, spreads: number}[]} rows */
function rankingTable(rows) {
  const headers = [
    element("th", {}, "Band power"),
    element("th", {}, "Channel"),
    element("th", { class: "number" }, "Change, B − A"),
    element("th", { class: "number" }, "Spreads"),
  ];
  const lines = rows.map(({ band, channel, change, spreads }) => {
    const sign = change > 0 ? "+" : "";
    return element(
      "tr",
      {},
      element("td", {}, band),
      element("td", {}, channel),
      element("td", { class: "number" }, `${sign}${change.toFixed(1)} dB`),
      element("td", { class: "number" }, spreads.toFixed(1)),
    );
  });
  return scrollTable("What differs most", headers, lines, "changes");
}

/**
 * Let charts show the same part.
 *
 * @param {Chart[]} charts
 */
function linkViews(charts) {
  for (const chart of charts) {
    chart.onMove = (view) => {
      for (const linked of charts) {
        if (linked !== chart) linked.set({ view: [...view] });
      }
    };
  }
}

/**
 * @param {HTMLElement} place
 * @param {Record<string, string>} values
 * @returns {Promise<import("./types.js").Page>}
 */
export async function openCompare(place, values) {
  await new ComparePage(place, values).show();
  return {};
}
