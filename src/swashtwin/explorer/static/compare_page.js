/** Two recordings or classes in one figure, their difference, and what differs most. */
import { Chart } from "./chart.js";
import {
  findOutside,
  levelDifference,
  MIN_HEALTHY,
  Mirrored,
  mirrorFloor,
  mirrorTicks,
  scatterOf,
  summarize,
} from "./comparison.js";
import { element, scrollTable, selectMenu } from "./elements.js";
import { formatLabel, formatNumber } from "./numbers.js";
import { PART_S, PairSound } from "./pair_sound.js";
import { channelLines } from "./series.js";
import { attempt, attemptQuietly, request } from "./server.js";
import { addressOf, readyRows, rememberAddress, state } from "./state.js";

/** @typedef {import("./series.js").Lines} Lines */

/** Recordings of a class that are shown. */
const MAX_OF_CLASS = 12;
const MAX_LINKS = 8;
const FIRST_SPECTRUM_END = 3000;
const FIRST_ORDER_END = 80;
/** Widths of the bands of a difference. */
const BAND_HZ = 5;
const BAND_ORDERS = 0.25;
const CLASS = "class:";
const DASH = [6, 3];
/** Color of each side, by its name in the style sheet. */
const INKS = ["side-a", "side-b"];
/** Left edge of a chart's field [px]. */
const LEFT = 56;

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
    this.layout = values.layout ?? "overlaid";
    /** Number of the newest comparison; previous ones end. */
    this.comparisons = 0;
    this.sound = new PairSound();
    /** Side that is heard, and the frequency near which [Hz]. */
    this.heard = 0;
    /** @type {number | null} */
    this.frequency = null;
    this.start = 0;
    this.controls = element("div", { class: "row tight" });
    this.listening = element("div", { class: "row tight" });
    this.results = element("div");
    this.showControls();

    const hint =
      "Select recordings in the table, or select two classes here." +
      ` Of a class the first ${MAX_OF_CLASS} recordings are shown.`;
    place.append(
      element("h1", {}, "Compare"),
      element("p", { class: "soft" }, hint),
      this.controls,
      this.listening,
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

    // Recordings of the others may still be read.
    const isReady = (/** @type {string} */ label) => this.members(CLASS + label).length > 0;
    const [firstClass, secondClass] = state.classes.filter(isReady);
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
    const selectLayout = (/** @type {string} */ value) => {
      this.layout = value;
      this.show();
    };
    /** @type {[string, string][]} */
    const layouts = [
      ["overlaid", "over each other"],
      ["mirrored", "mirrored"],
    ];
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
      selectMenu("Drawn", layouts, this.layout, selectLayout),
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
    const { channel, kind, layout } = this;
    rememberAddress("compare", { a, b, channel, kind, layout });
    this.comparisons += 1;
    this.sound.stop();
    this.frequency = null;
    this.showListening();

    // New places: what was requested for other sides arrives in places that are no longer shown.
    const figures = element("div");
    const table = element("div", {}, element("p", { class: "soft" }, "Ranking the changes …"));
    this.results.replaceChildren(figures, table);
    await attempt(() => this.showSpectra(figures, a, b), figures);
    await attempt(() => this.showRanking(table, a, b), table);
  }

  /** Show the buttons that play the first recording of each side. */
  showListening() {
    const rows = this.heardRows();
    if (rows.length < 2) {
      this.listening.replaceChildren();
      return;
    }
    const buttons = rows.map((row, n) => this.sideButton(row, n));
    const end = Math.max(0, Math.min(rows[0].duration, rows[1].duration) - PART_S);
    const from = element("input", {
      type: "number",
      min: "0",
      max: String(end),
      step: "0.1",
      value: String(Math.min(this.start, end)),
      onchange: (/** @type {any} */ event) => {
        this.start = Number(event.target.value);
        if (this.sound.isPlaying) this.play();
      },
    });
    const parts = [
      element("span", {}, "Listen in turns, with the same gain: "),
      ...buttons,
      element("label", {}, "from second ", from),
    ];
    if (this.frequency === null) {
      const hint = "Click a line of the spectrum to hear only what is near it.";
      parts.push(element("span", { class: "soft" }, hint));
    } else {
      const near = `Only near ${formatNumber(this.frequency, 4)} Hz `;
      const all = element("button", { onclick: () => this.tune(null) }, "Hear all");
      parts.push(element("span", {}, near, all));
    }
    this.listening.replaceChildren(...parts);
  }

  /**
   * @param {import("./types.js").Row} row
   * @param {number} side
   */
  sideButton(row, side) {
    const name = side ? "B" : "A";
    const isHeard = this.sound.isPlaying && this.heard === side;
    const attributes = {
      onclick: () => this.hear(side),
      "aria-pressed": String(isHeard),
      "aria-label": `${isHeard ? "Stop" : "Listen to"} ${name}: ${row.id}`,
    };
    return element("button", attributes, `${isHeard ? "■" : "▶"} ${name}`);
  }

  /** Return the first recording of each side. */
  heardRows() {
    const names = [this.members(this.sides.a)[0], this.members(this.sides.b)[0]];
    return names.flatMap((name) => (name ? [state.rows.get(name)] : []));
  }

  /**
   * Play a side, or stop it if it is heard.
   *
   * @param {number} side
   */
  async hear(side) {
    const isSame = this.heard === side;
    this.heard = side;
    if (!this.sound.isPlaying) await this.play();
    else if (isSame) this.sound.stop();
    else this.sound.hear(side);
    this.showListening();
    // The buttons are new ones; the keyboard stays on it.
    this.listening.querySelectorAll("button")[side]?.focus();
  }

  play() {
    const { channel, start, heard, frequency } = this;
    const rows = this.heardRows();
    return attempt(() => this.sound.play(rows, channel, start, heard, frequency));
  }

  /** @param {number | null} frequency [Hz] */
  tune(frequency) {
    this.frequency = frequency;
    this.sound.tune(frequency);
    this.showListening();
  }

  /**
   * Return the spectrum of each recording, and show how long the others will take; null if another
   * comparison began meanwhile.
   *
   * @param {HTMLElement} place
   * @param {string[]} names
   */
  async readSpectra(place, names) {
    const { kind, comparisons } = this;
    const meter = element("progress", { max: names.length, value: 0, "aria-label": "Spectra" });
    const note = element("span", {}, `Computing ${names.length} spectra …`);
    place.replaceChildren(element("p", { class: "soft", role: "status" }, meter, " ", note));

    const begun = performance.now();
    const spectra = [];
    for (const name of names) {
      spectra.push(await request("spectrum", { name, kind }));
      if (comparisons !== this.comparisons) return null;
      const count = spectra.length;
      const left = ((performance.now() - begun) / count / 1000) * (names.length - count);
      meter.value = count;
      note.textContent = `${count} of ${names.length} spectra, about ${left.toFixed(0)} s left`;
    }
    return spectra;
  }

  /**
   * @param {HTMLElement} place
   * @param {string} a
   * @param {string} b
   */
  async showSpectra(place, a, b) {
    const first = this.members(a);
    const names = [...first, ...this.members(b)];
    const spectra = await this.readSpectra(place, names);
    if (!spectra) return;

    const lines = spectra.map((current) => {
      const channels = channelLines(current.channels, current.amplitude, current.step);
      return channels[Math.min(this.channel, channels.length - 1)];
    });
    const parts = [lines.slice(0, first.length), lines.slice(first.length)];
    if (!parts.every((part) => part.length)) {
      throw new Error("Each side requires a recording that can be read.");
    }
    const sides = parts.map(summarizeSide);

    const isOrder = this.kind === "order";
    const spectrum = spectra[0];
    const hertz = isOrder ? spectrum.shaft : 1;
    const end = Math.min(...sides.map(({ middle }) => middle.step * middle.values.length));
    const axis = {
      x: isOrder ? "order" : "Hz",
      shaft: isOrder ? null : spectrum.shaft,
      limits: [0, end],
      view: [0, Math.min(end, isOrder ? FIRST_ORDER_END : FIRST_SPECTRUM_END)],
      marks: spectrum.marks,
      onPick: (/** @type {number} */ x) => hertz && this.tune(x * hertz),
    };
    const source = spectrum.excerpts ? `; ${spectrum.excerpts}` : "";
    const both = this.drawBoth(sides, axis, spectrum.unit, source);

    const width = isOrder ? BAND_ORDERS : BAND_HZ;
    const difference = levelDifference(sides[1].middle, sides[0].middle, width);
    const scatter = await this.findScatter(names, lines, width);
    const changes = drawDifference(difference, scatter, axis);
    linkViews([both, changes]);
    place.replaceChildren(
      this.legend(parts),
      both.element,
      changes.element,
      describeDifference(difference, scatter, axis),
    );
  }

  /** @param {Lines[][]} parts spectra of each side */
  legend(parts) {
    const sides = [this.sides.a, this.sides.b].map((side, n) => {
      const count = parts[n].length;
      const drawn = this.layout === "mirrored" ? "median" : "median and range";
      const what = count > 1 ? `, ${drawn} of ${count} recordings` : "";
      return element("span", { class: INKS[n] }, `${n ? "B" : "A"}: ${this.describe(side)}${what}`);
    });
    return element("p", { class: "sides" }, sides);
  }

  /**
   * Return the figure of both sides, over each other or mirrored.
   *
   * @param {ReturnType<typeof summarizeSide>[]} sides
   * @param {any} axis
   * @param {string} unit
   * @param {string} source
   */
  drawBoth(sides, axis, unit, source) {
    const series = sides.map(({ middle }) => middle);
    const common = { ...axis, y: unit, unit };
    if (this.layout !== "mirrored") {
      const title = `Spectra of A and B${source}`;
      const areas = sides.filter(({ count }) => count > 1);
      return new Chart({ ...common, title, log: true, height: 300, areas, series });
    }
    const floor = mirrorFloor(series);
    return new Chart({
      ...common,
      title: `Spectra of A (upward) and B (downward)${source}`,
      height: 340,
      series: series.map((line, n) => new Mirrored(line, n ? -1 : 1, floor)),
      ticks: mirrorTicks(floor).map(([value, amplitude]) => [value, formatNumber(amplitude, 2)]),
      drawOver: drawZero,
    });
  }

  /**
   * Return how far healthy recordings scatter about their median, and of which; null if too few are
   * known.
   *
   * They are those that are compared, or else those like the first recording of side B.
   *
   * @param {string[]} names
   * @param {Lines[]} lines
   * @param {number} width of a band
   */
  async findScatter(names, lines, width) {
    const healthy = lines.filter((_, n) => state.rows.get(names[n]).healthy);
    if (healthy.length >= MIN_HEALTHY) {
      const source = `${healthy.length} healthy recordings compared here`;
      return { ...scatterOf(healthy, width), source };
    }

    const { kind, channel } = this;
    const name = this.members(this.sides.b)[0];
    const answer = await attemptQuietly(() => request("spectrum", { name, kind, healthy: "true" }));
    if (!answer || (answer.healthy?.length ?? 0) < MIN_HEALTHY) return null;

    // The range of each line says nothing of a band, whose lines are not all extreme at once.
    const others = [];
    for (const healthyName of answer.healthy.slice(0, MAX_OF_CLASS)) {
      const spectrum = await attemptQuietly(() => request("spectrum", { name: healthyName, kind }));
      if (!spectrum) continue;
      const channels = channelLines(spectrum.channels, spectrum.amplitude, spectrum.step);
      others.push(channels[Math.min(channel, channels.length - 1)]);
    }
    if (others.length < MIN_HEALTHY) return null;
    const source = `${others.length} healthy recordings at the operating point of B`;
    return { ...scatterOf(others, width), source };
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

/**
 * Return median and range of the spectra of a side, drawn as its side.
 *
 * @param {Lines[]} spectra
 * @param {number} side
 */
function summarizeSide(spectra, side) {
  const { low, middle, high } = summarize(spectra);
  middle.name = side ? "B" : "A";
  middle.width = 1.6;
  middle.dash = side ? DASH : [];
  middle.ink = INKS[side];
  low.ink = INKS[side];
  return { low, middle, high, count: spectra.length };
}

/**
 * @param {import("./drawing.js").Pen} pen
 * @param {import("./chart.js").Scale} scale
 */
function drawZero(pen, { up, color, right }) {
  pen.line([LEFT, up(0), right, up(0)], color("soft"));
}

/** @typedef {{low: Lines, high: Lines, source: string} | null} Scatter */

/**
 * @param {Lines} difference
 * @param {Scatter} scatter
 * @param {any} axis
 */
function drawDifference(difference, scatter, axis) {
  difference.name = "B − A";
  difference.ink = "ink";
  if (scatter) {
    scatter.low.ink = "soft";
    scatter.low.name = "lowest healthy";
    scatter.high.name = "highest healthy";
  }
  const gray = scatter ? "; gray: scatter of healthy recordings" : "";
  return new Chart({
    ...axis,
    title: `B − A in bands of ${formatNumber(difference.step)} ${axis.x}${gray}`,
    y: "dB",
    unit: "dB",
    height: 200,
    areas: scatter ? [scatter] : [],
    series: [difference],
    drawOver: drawZero,
  });
}

/**
 * Return a sentence on what of a difference lies outside the scatter of healthy recordings.
 *
 * @param {Lines} difference
 * @param {Scatter} scatter
 * @param {any} axis
 */
function describeDifference(difference, scatter, axis) {
  if (!scatter) {
    const text =
      `No scatter is known: it requires ${MIN_HEALTHY} healthy recordings of the same machine, ` +
      "speed and pressure.";
    return element("p", { class: "soft" }, text);
  }

  const end = axis.view[1];
  const found = findOutside(difference, scatter, end);
  const describe = (/** @type {number} */ position) =>
    axis.x === "Hz" ? `${formatNumber(position, 4)} Hz` : `order ${formatNumber(position)}`;
  const share = `${Math.round(100 * found.share)} % of the bands`;
  const parts = [`${share} up to ${describe(end)} lie outside the scatter.`];
  if (found.excess) {
    const sign = found.change > 0 ? "+" : "";
    const order = axis.shaft ? ` (order ${formatNumber(found.position / axis.shaft)})` : "";
    const place = `${describe(found.position)}${order}`;
    parts.push(`Farthest outside: ${sign}${found.change.toFixed(1)} dB at ${place}.`);
  }
  parts.push(`The scatter is the largest deviation from the median of ${scatter.source}.`);
  return element("p", {}, parts.join(" "));
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
  const page = new ComparePage(place, values);
  await page.show();
  return { leave: () => page.sound.stop() };
}
