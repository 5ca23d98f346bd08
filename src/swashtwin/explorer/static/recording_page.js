/** One recording: waveform, spectra, envelope, waterfall, RMS, and its sound. */
import { Chart } from "./chart.js";
import { breakable, element, listItems, selectMenu } from "./elements.js";
import { assignClass, badge, changeFact, FACTS, factCell, findingTexts } from "./facts.js";
import { formatNumber } from "./numbers.js";
import { channelLines, Lines } from "./series.js";
import { attempt, request } from "./server.js";
import { Sound } from "./sound.js";
import { addressOf, rememberAddress, state, step } from "./state.js";
import { Tiles } from "./tiles.js";
import { waterfallPicture } from "./waterfall.js";

/** @typedef {import("./types.js").Row} Row */
/** @typedef {import("./types.js").Range} Range */

const SPEEDS_OF_SOUND = /** @type {[string, string][]} */ ([
  ["0.1", "× 0.1"],
  ["0.25", "× 0.25"],
  ["0.5", "× 0.5"],
  ["1", "original"],
  ["2", "× 2"],
  ["4", "× 4"],
]);
const SPECTRUM_KINDS = /** @type {[string, string][]} */ ([
  ["amplitude", "frequency"],
  ["order", "shaft orders"],
]);
const HEALTHY_MODES = /** @type {[string, string][]} */ ([
  ["", "not shown"],
  ["band", "as a band"],
  ["difference", "as difference in dB"],
]);
const MAP_AXES = /** @type {[string, string][]} */ ([
  ["time", "frequency"],
  ["orders", "shaft orders"],
]);
/** Settings that the next recording starts with. */
const STORED_SETTINGS = ["kind", "healthy", "map", "bodies", "ratio", "channels"];
const ADDRESS_SETTINGS = [
  "kind",
  "healthy",
  "map",
  "pistons",
  "bodies",
  "ratio",
  "channels",
  "from",
  "to",
  "low",
  "high",
];
/** Part of a spectrum that is shown first; piston pumps have little above. */
const FIRST_SPECTRUM_END = 5000;
const FIRST_ORDER_END = 80;
const REMEMBER_DELAY_MS = 300;
/** Time after which a figure of a recording that is still being read is drawn again. */
const RELOAD_MS = 1000;
const CLASS_KEYS = 9;

/**
 * Return the number of pistons that the recording specifies, or that was entered for its machine.
 *
 * @param {Row} row
 */
function knownPistons(row) {
  if (row.pistons) return String(row.pistons);
  return enteredPistons()[machineKey(row)] ?? "";
}

/**
 * Keep an entered number of pistons for the other recordings of the machine.
 *
 * @param {Row} row
 * @param {string} pistons
 */
function storePistons(row, pistons) {
  if (pistons === knownPistons(row)) return;
  const entered = { ...enteredPistons(), [machineKey(row)]: pistons };
  localStorage.setItem("pistons", JSON.stringify(entered));
}

/** @returns {Record<string, string>} */
function enteredPistons() {
  return JSON.parse(localStorage.getItem("pistons") ?? "{}");
}

/**
 * Return a name of the machine that no other source of recordings has.
 *
 * @param {Row} row
 */
function machineKey(row) {
  return JSON.stringify([state.source, row.specimen ?? null]);
}

/**
 * Return the title of a figure with what it is of, unless that is the whole recording.
 *
 * @param {string} title
 * @param {{excerpts: string}} content
 */
function titleOf(title, { excerpts }) {
  return excerpts ? `${title}: ${excerpts}` : title;
}

/**
 * Return which part of a recording is known; empty for all of it.
 *
 * @param {number} known share
 */
function partOf(known) {
  return known < 1 ? `${Math.floor(100 * known)} % of the recording` : "";
}

class RecordingPage {
  /**
   * @param {HTMLElement} place
   * @param {Record<string, string>} values
   * @param {Row} row
   */
  constructor(place, values, row) {
    this.name = values.name;
    this.row = row;
    this.settings = {
      kind: "amplitude",
      healthy: "band",
      map: "time",
      pistons: knownPistons(row),
      bodies: "",
      ratio: "",
      channels: "",
      speed: "1",
      from: "",
      to: "",
      low: "",
      high: "",
      ...JSON.parse(localStorage.getItem("view") ?? "{}"),
      ...values,
    };
    this.sound = new Sound();
    /** @type {Chart | null} */
    this.wave = null;
    this.rememberTimer = 0;
    this.rmsTimer = 0;

    this.addHead(place);
    this.showFacts();
    /** File that the figures are of. */
    this.shownStamp = row.samples ? row.stamp : null;
    if (row.samples) {
      this.tiles = new Tiles(row, (known) => this.showTile(known));
      this.addFigures(place);
      this.refresh();
    }
  }

  /** @param {HTMLElement} place */
  addHead(place) {
    this.crumbs = element("nav", { class: "crumbs", "aria-label": "Path" });
    this.title = element("h1");
    this.remarks = element("div");
    this.facts = element("dl", { class: "facts" });
    this.proposal = element("span", { role: "status" });
    const onclick = () => attempt(() => this.proposeSpeed(), this.proposal);
    const button = element("button", { class: "small", onclick }, "Determine speed from the lines");
    place.append(
      this.crumbs,
      this.title,
      this.remarks,
      this.facts,
      element("p", { class: "row tight" }, button, this.proposal),
    );
  }

  /** @param {HTMLElement} place */
  addFigures(place) {
    const names = ["wave", "rms", "spectrum", "envelope", "map"];
    /** @type {Record<string, any>} */
    this.sections = Object.fromEntries(
      names.map((name) => [name, element("section", { "aria-label": name })]),
    );
    place.append(
      element("div", { class: "row tight" }, this.channelBoxes(), this.soundControls()),
      this.sections.wave,
      this.sections.rms,
      element("div", { class: "row tight" }, this.spectrumControls()),
      this.sections.spectrum,
      this.sections.envelope,
      element("div", { class: "row tight" }, this.mapControl()),
      this.sections.map,
    );
  }

  channelBoxes() {
    const shown = new Set(this.shownChannels());
    this.boxes = this.row.channels.map((_, n) =>
      element("input", {
        type: "checkbox",
        checked: shown.has(n),
        onchange: () => this.selectChannels(),
      }),
    );
    return this.row.channels.map((channel, n) =>
      element("label", { class: `key line-${n % 6}` }, this.boxes[n], ` ${channel}`),
    );
  }

  selectChannels() {
    const numbers = this.boxes.flatMap((box, n) => (box.checked ? [n] : []));
    const areAll = numbers.length === this.row.channels.length;
    this.settings.channels = areAll ? "" : numbers.join(",");
    this.refresh();
  }

  soundControls() {
    const selectSpeed = (/** @type {string} */ value) => {
      this.settings.speed = value;
    };
    const onclick = () => this.toggleSound();
    this.playButton = element("button", { class: "primary", onclick }, "▶ Play");
    return [
      selectMenu("Playback speed", SPEEDS_OF_SOUND, this.settings.speed, selectSpeed),
      this.playButton,
    ];
  }

  spectrumControls() {
    const set = (/** @type {string} */ key) => (/** @type {string} */ value) => {
      this.settings[key] = value;
      this.refresh();
    };
    return [
      selectMenu("Spectrum over", SPECTRUM_KINDS, this.settings.kind, set("kind")),
      selectMenu("Healthy recordings", HEALTHY_MODES, this.settings.healthy, set("healthy")),
      this.numberField("pistons", "Pistons", 3),
      this.numberField("bodies", "Rolling bodies", 3),
      this.numberField("ratio", "Ball over pitch ⌀", 5),
    ];
  }

  mapControl() {
    const select = (/** @type {string} */ value) => {
      this.settings.map = value;
      this.remember();
      this.draw("map", () => this.drawMap());
    };
    return selectMenu("Map over", MAP_AXES, this.settings.map, select);
  }

  /**
   * @param {string} key
   * @param {string} label
   * @param {number} size
   */
  numberField(key, label, size) {
    const onchange = (/** @type {any} */ event) => {
      this.settings[key] = event.target.value.trim();
      this.refresh();
    };
    const attributes = { value: this.settings[key] ?? "", size, inputMode: "decimal", onchange };
    return element("label", {}, label, " ", element("input", attributes));
  }

  /** Keep the settings for the next recording and in the address. */
  remember() {
    const stored = Object.fromEntries(STORED_SETTINGS.map((key) => [key, this.settings[key]]));
    localStorage.setItem("view", JSON.stringify(stored));
    storePistons(this.row, this.settings.pistons);

    // "healthy" is kept if it is empty, too: without it the band would be shown again.
    const settings = ADDRESS_SETTINGS.map((key) => [key, this.settings[key]]);
    const given = settings.filter(([key, value]) => value || key === "healthy");
    rememberAddress("recording", { name: this.name, ...Object.fromEntries(given) });
  }

  /** Show title, facts and findings as they are now. */
  showFacts() {
    this.row = state.rows.get(this.name) ?? this.row;
    const row = this.row;
    this.title.replaceChildren(row.id ?? row.name, " ", badge(row));
    this.facts.replaceChildren(...this.factRows());

    const findings = findingTexts(row);
    this.remarks.replaceChildren(
      ...(findings.length ? [element("ul", {}, listItems(findings))] : []),
    );

    const previous = addressOf("recording", { name: step(this.name, -1) });
    const next = addressOf("recording", { name: step(this.name, 1) });
    const classes = state.classes.slice(0, CLASS_KEYS).map((label, n) => `${n + 1} ${label}`);
    this.crumbs.replaceChildren(
      element("a", { href: "#recordings" }, "Recordings"),
      " › ",
      element("a", { href: previous, rel: "prev" }, "← previous"),
      " ",
      element("a", { href: next, rel: "next" }, "next →"),
      ` · class keys: ${classes.join(", ")}`,
    );
  }

  factRows() {
    const { row } = this;
    const facts = /** @type {(keyof typeof FACTS)[]} */ (Object.keys(FACTS));
    /** @type {[string, any][]} */
    const entries = facts.map((fact) => [FACTS[fact], factCell(row, fact)]);
    if (row.samples) {
      entries.push(
        ["Length", `${formatNumber(row.duration, 4)} s`],
        ["Rate", `${formatNumber(row.rate, 6)} Hz`],
        ["File", breakable(row.file ?? "—")],
      );
    }
    return entries.map(([term, description]) =>
      element("div", {}, element("dt", {}, term), element("dd", {}, description)),
    );
  }

  update() {
    this.showFacts();
    // It was recorded anew, or can be read after its facts were changed.
    if (this.row.samples && this.row.stamp !== this.shownStamp) location.reload();
  }

  async proposeSpeed() {
    const { pistons } = this.settings;
    if (!pistons) {
      this.proposal.textContent = "Enter the number of pistons below first. ";
      return;
    }
    const speed = await request("speed", { name: this.name, pistons });
    const rpm = `${formatNumber(speed.rpm, 5)} rpm`;
    const clarity = Math.round(100 * speed.clarity);
    this.proposal.replaceChildren(
      `The lines of ${pistons} pistons match ${rpm} (${clarity} % clear)` +
        `${speed.excerpts ? ` in ${speed.excerpts}` : ""}. `,
    );
    if (!state.editable) return;

    const accept = () => {
      this.proposal.replaceChildren();
      changeFact([this.name], "speed", rpm);
    };
    this.proposal.append(element("button", { class: "small", onclick: accept }, "Use this speed"));
  }

  /** Return the numbers of the channels that are shown. */
  shownChannels() {
    const numbers = this.row.channels.map((_, n) => n);
    if (!this.settings.channels) return numbers;
    const selected = this.settings.channels.split(",");
    return numbers.filter((n) => selected.includes(String(n)));
  }

  /**
   * Return the lines of the channels that are shown.
   *
   * @param {string[]} channels
   * @param {string} text
   * @param {number} step
   */
  shownLines(channels, text, step) {
    const shown = new Set(this.shownChannels());
    return channelLines(channels, text, step).filter((line) => shown.has(line.color));
  }

  /** Draw all figures. */
  refresh() {
    this.remember();
    this.drawWave();
    this.draw("spectrum", () => this.drawSpectrum());
    this.draw("envelope", () => this.drawEnvelope());
    this.draw("rms", () => this.drawRms());
    this.draw("map", () => this.drawMap());
  }

  /**
   * Draw one figure; a failure is shown in its place.
   *
   * @param {string} name
   * @param {() => Promise<void>} work
   */
  draw(name, work) {
    return attempt(work, this.sections[name]);
  }

  drawWave() {
    const { row, settings } = this;
    /** @type {Range} */
    let view = [0, row.duration];
    if (this.wave) view = this.wave.view;
    else if (settings.from && settings.to) view = [Number(settings.from), Number(settings.to)];

    this.wave = new Chart({
      title: "Waveform",
      x: "s",
      y: row.unit,
      unit: row.unit,
      limits: [0, row.duration],
      view,
      series: this.shownChannels().map((channel) => this.waveSeries(channel)),
      onMove: (part) => this.rememberPart(part),
    });
    this.readNote = element("p", { class: "soft", role: "status" });
    this.sections.wave.replaceChildren(this.wave.element, this.readNote);
    this.sections.wave.chart = this.wave;
  }

  /** @param {number} known share of the recording that was read */
  showTile(known) {
    this.wave.title = titleOf("Waveform", { excerpts: partOf(known) });
    this.wave.request();
    this.readNote.textContent =
      known < 1 ? `Waveform and RMS show ${partOf(known)} so far, spread over all of it.` : "";
  }

  /**
   * @param {number} channel
   * @returns {import("./types.js").Series}
   */
  waveSeries(channel) {
    const { row, tiles } = this;
    return {
      name: row.channels[channel],
      color: channel,
      columns: (low, high, count) => tiles.columns(channel, low, high, count),
      at: (x) => {
        const [low, high] = this.wave.view;
        const width = tiles.width(high - low, this.wave.width);
        return tiles.bin(channel, width, Math.round((x * row.rate) / width), false)[1];
      },
    };
  }

  /** @param {Range} part */
  rememberPart([low, high]) {
    const isWhole = high - low >= this.row.duration * 0.999;
    this.settings.from = isWhole ? "" : low.toPrecision(6);
    this.settings.to = isWhole ? "" : high.toPrecision(6);
    clearTimeout(this.rememberTimer);
    this.rememberTimer = setTimeout(() => this.remember(), REMEMBER_DELAY_MS);
  }

  async drawRms() {
    const rms = await request("rms", { name: this.name });
    const chart = new Chart({
      title: titleOf("RMS against time", { excerpts: partOf(rms.known) }),
      x: "s",
      y: rms.unit,
      unit: rms.unit,
      height: 150,
      limits: [0, this.row.duration],
      series: this.shownLines(this.row.channels, rms.amplitude, rms.step),
    });
    this.sections.rms.replaceChildren(chart.element);
    if (rms.known < 1 && !this.tiles.isLeft) {
      clearTimeout(this.rmsTimer);
      this.rmsTimer = setTimeout(() => this.draw("rms", () => this.drawRms()), RELOAD_MS);
    }
  }

  /** @param {Record<string, any>} values */
  requestSpectrum(values) {
    const { pistons, bodies, ratio } = this.settings;
    return request("spectrum", { name: this.name, pistons, bodies, ratio, ...values });
  }

  async drawSpectrum() {
    const { kind, healthy } = this.settings;
    const spectrum = await this.requestSpectrum({ kind, healthy: healthy ? "true" : "" });
    const isOrder = kind === "order";
    const end = spectrum.step * spectrum.lines;

    /** @type {import("./chart.js").ChartOptions} */
    const options = {
      title: titleOf(isOrder ? "Order spectrum" : "Spectrum", spectrum),
      x: isOrder ? "order" : "Hz",
      y: spectrum.unit,
      unit: spectrum.unit,
      log: true,
      limits: [0, end],
      shaft: isOrder ? null : spectrum.shaft,
      marks: spectrum.marks,
      series: this.shownLines(spectrum.channels, spectrum.amplitude, spectrum.step),
      onBand: isOrder ? null : (low, high) => this.selectBand(low.toFixed(0), high.toFixed(0)),
    };
    const note = this.addHealthy(options, spectrum);

    const chart = new Chart(options);
    const text = element("p", { class: "soft" }, note);
    this.sections.spectrum.replaceChildren(chart.element, text);
    if (end > 0) chart.show([0, Math.min(end, isOrder ? FIRST_ORDER_END : FIRST_SPECTRUM_END)]);
  }

  /**
   * Add healthy recordings to the options of a spectrum; return a note on them.
   *
   * @param {import("./chart.js").ChartOptions} options
   * @param {any} spectrum
   */
  addHealthy(options, spectrum) {
    const mode = this.settings.healthy;
    if (!mode) return "Drag to move, Shift and drag to zoom.";
    const count = spectrum.healthy?.length ?? 0;
    if (!count) return "There is no healthy recording of this machine and operating point.";

    const { channels, step } = spectrum;
    if (mode === "difference") {
      const middle = this.shownLines(channels, spectrum.middle, step);
      options.series = /** @type {Lines[]} */ (options.series).map((line, n) => {
        const reference = middle[n].values;
        const level = line.values.map((value, k) => 20 * Math.log10(value / reference[k]));
        return new Lines(line.step, level, line);
      });
      options.log = false;
      options.unit = "dB";
      options.y = "dB over healthy";
    } else {
      const low = this.shownLines(channels, spectrum.low, step);
      const high = this.shownLines(channels, spectrum.high, step);
      options.areas = low.map((line, n) => ({ low: line, high: high[n] }));
    }

    const subject = mode === "difference" ? "Difference from the median" : "Range";
    const plural = count > 1 ? "s" : "";
    return `${subject} of ${count} healthy recording${plural} of this machine and operating point.`;
  }

  /**
   * Select the band for the envelope; empty edges leave it to the kurtogram.
   *
   * @param {string} low
   * @param {string} high
   */
  selectBand(low, high) {
    this.settings.low = low;
    this.settings.high = high;
    this.remember();
    this.draw("envelope", () => this.drawEnvelope());
  }

  async drawEnvelope() {
    const { low, high } = this.settings;
    const spectrum = await this.requestSpectrum({ kind: "envelope", low, high });
    const bands = this.shownChannels().map((channel) =>
      spectrum.bands[channel].map((/** @type {number} */ edge) => formatNumber(edge, 4)).join("–"),
    );
    const end = spectrum.step * spectrum.lines;

    const chart = new Chart({
      title: titleOf(`Envelope spectrum at ${[...new Set(bands)].join(", ")} Hz`, spectrum),
      x: "Hz",
      y: spectrum.unit,
      unit: spectrum.unit,
      log: true,
      shaft: spectrum.shaft,
      limits: [0, end],
      marks: spectrum.marks,
      series: this.shownLines(spectrum.channels, spectrum.amplitude, spectrum.step),
    });
    this.sections.envelope.replaceChildren(chart.element, this.bandNote());
    chart.show([0, Math.min(end, Math.max(500, 30 * (spectrum.shaft ?? 0)))]);
  }

  /** Return a text on how the band of the envelope was selected. */
  bandNote() {
    const hint = "To select another, press “Band” on the spectrum above and drag.";
    if (!this.settings.low) {
      return element("p", { class: "soft" }, `The kurtogram selected the band. ${hint}`);
    }
    const onclick = () => this.selectBand("", "");
    const button = element("button", { class: "small", onclick }, "Use the kurtogram's band");
    return element("p", { class: "soft" }, `${hint} `, button);
  }

  async drawMap() {
    const channel = this.shownChannels()[0] ?? 0;
    const isOrder = this.settings.map === "orders";
    const waterfall = await request("waterfall", { name: this.name, channel, orders: isOrder });
    const title = `${isOrder ? "Order map" : "Waterfall"} of ${this.row.channels[channel]}`;
    const chart = new Chart({
      title: titleOf(title, waterfall),
      x: isOrder ? "turns" : "s",
      y: isOrder ? "order" : "Hz",
      height: 320,
      limits: [0, waterfall.end],
      picture: waterfallPicture(waterfall, isOrder),
    });
    this.sections.map.replaceChildren(chart.element);
  }

  toggleSound() {
    if (!this.shownStamp) return;
    if (this.sound.isPlaying) {
      this.sound.stop();
      return;
    }

    this.playButton.textContent = "■ Stop";
    const channel = this.shownChannels()[0] ?? 0;
    const speed = Number(this.settings.speed);
    attempt(() => this.sound.play(this.row, channel, this.wave.view, speed, () => this.endSound()));
  }

  leave() {
    this.sound.stop();
    clearTimeout(this.rmsTimer);
    if (this.tiles) this.tiles.isLeft = true;
  }

  endSound() {
    this.playButton.textContent = "▶ Play";
  }

  /**
   * Do what a key means on this page; return whether it means something.
   *
   * @param {KeyboardEvent} event
   */
  keys(event) {
    switch (event.key) {
      case "j":
      case "n":
      case "ArrowDown":
        location.hash = addressOf("recording", { name: step(this.name, 1) });
        return true;
      case "k":
      case "ArrowUp":
        location.hash = addressOf("recording", { name: step(this.name, -1) });
        return true;
      case " ":
      case "p":
        this.toggleSound();
        return true;
      case "Escape":
        location.hash = "recordings";
        return true;
      default:
        return assignClass(this.row, event.key);
    }
  }
}

/**
 * @param {HTMLElement} place
 * @param {Record<string, string>} values
 * @returns {import("./types.js").Page}
 */
export function openRecording(place, values) {
  const row = state.rows.get(values.name);
  if (!row) throw new Error(`There is no recording ${values.name}. Select one in the table.`);

  const page = new RecordingPage(place, values, row);
  return {
    update: () => page.update(),
    keys: (event) => page.keys(event),
    leave: () => page.leave(),
  };
}
