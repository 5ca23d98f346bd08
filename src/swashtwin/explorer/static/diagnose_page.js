/** A model's verdict on a recording, its uncertainty, and its evidence. */
import { Chart } from "./chart.js";
import { element, titledList } from "./elements.js";
import { formatLabel, formatNumber } from "./numbers.js";
import { channelLines } from "./series.js";
import { attempt, request, send, sendFile } from "./server.js";
import { addressOf, readyRows, rememberAddress, state, step } from "./state.js";

const MIN_SPECTRUM_END = 3000;
/** Bands that end above are not shown at first; the lines of the pump would become too narrow. */
const MAX_BAND_END = 20000;
const BAND_OPACITY = "22";
const TOP = 30;

class DiagnosePage {
  /**
   * @param {HTMLElement} place
   * @param {Record<string, string>} values
   */
  constructor(place, values) {
    const rows = readyRows();
    this.name = values.name ?? state.current ?? rows[0]?.name;
    /** Number of the newest request; answers to previous ones are ignored. */
    this.requests = 0;
    this.model = element("p", { role: "status" });
    this.answer = element("div");

    const options = rows.map(({ name, id, label }) =>
      element(
        "option",
        { value: name, selected: name === this.name },
        `${id} (${label ?? "no class"})`,
      ),
    );
    const onchange = () => {
      this.name = this.menu.value;
      this.show();
    };
    this.menu = element("select", { onchange }, options);
    place.append(
      element("h1", {}, "Diagnose"),
      this.modelCard(),
      element("div", { class: "row tight" }, element("label", {}, "Recording ", this.menu)),
      this.answer,
    );
  }

  /** Return the card on which a model is dropped. */
  modelCard() {
    const file = element("input", {
      type: "file",
      accept: ".safetensors",
      "aria-label": "Model file",
      onchange: () => this.loadFile(file.files[0]),
    });
    const loadPrior = () => this.load(() => send("prior", {}));
    const prior = element(
      "button",
      { onclick: loadPrior },
      "Use the shipped prior, adapted to the healthy recordings here",
    );
    const hint = "Drop a model or a prior here, or select its file: ";
    const controls = [element("label", {}, hint, file), prior];
    const card = element(
      "div",
      { class: "card drop" },
      this.model,
      element("div", { class: "row tight" }, controls),
    );

    card.addEventListener("dragover", (/** @type {DragEvent} */ event) => {
      event.preventDefault();
      card.classList.add("over");
    });
    card.addEventListener("dragleave", () => card.classList.remove("over"));
    card.addEventListener("drop", (/** @type {DragEvent} */ event) => {
      event.preventDefault();
      card.classList.remove("over");
      this.loadFile(event.dataTransfer.files[0]);
    });
    return card;
  }

  /** @param {File | undefined} file */
  loadFile(file) {
    if (!file) return;
    const query = new URLSearchParams({ name: file.name });
    this.load(() => sendFile(`drop?${query}`, file));
  }

  /**
   * Load a model, and diagnose again.
   *
   * @param {() => Promise<{model: string}>} work
   */
  load(work) {
    return attempt(async () => {
      this.requests += 1;
      this.answer.replaceChildren();
      this.model.replaceChildren("Reading the model …");
      this.showModel((await work()).model);
      await this.show();
    }, this.model);
  }

  /** @param {string} name */
  showModel(name) {
    if (name) this.model.replaceChildren("Model: ", element("strong", {}, name));
    else this.model.replaceChildren("No model yet.");
  }

  /** Show the present model, and its verdict. */
  async start() {
    const { model } = await request("model");
    this.showModel(model);
    if (model) await this.show();
  }

  async show() {
    if (!this.name) return;
    rememberAddress("diagnose", { name: this.name });
    this.menu.value = this.name;
    this.answer.replaceChildren(element("p", { class: "soft" }, "Computing …"));

    this.requests += 1;
    const number = this.requests;
    const isNewest = () => number === this.requests;
    await attempt(async () => {
      try {
        const diagnosis = await request("diagnosis", { name: this.name });
        if (!isNewest()) return;
        // A prior is adapted again if the healthy recordings changed, and its name says to which.
        this.showModel(diagnosis.model);
        this.draw(diagnosis);
      } catch (error) {
        if (isNewest()) throw error;
      }
    }, this.answer);
  }

  /** @param {any} diagnosis */
  draw(diagnosis) {
    this.showModel(diagnosis.model);
    const label = state.rows.get(this.name).label;
    const given = label ? ` · class in its facts: ${formatLabel(label)}` : "";
    const checks = diagnosis.checks.map((/** @type {any} */ check) => [
      element("strong", {}, check.what),
      ` ${check.why}`,
    ]);
    const figure = element("div");

    const parts = [
      element(
        "p",
        { class: "verdict" },
        formatLabel(diagnosis.verdict),
        element("small", {}, given),
      ),
      element("p", {}, diagnosis.sentence),
      diagnosis.spectrum ? element("p", {}, diagnosis.spectrum) : null,
      element(
        "div",
        { class: "columns" },
        uncertainty(diagnosis),
        titledList("Nearest training recordings", diagnosis.nearest.map(neighborItem), "ol"),
        titledList("What to check next", checks),
      ),
      figure,
      titledList("Evidence", diagnosis.evidence),
      titledList("Notes", diagnosis.notes),
    ];
    this.answer.replaceChildren(...parts.filter((part) => part !== null));
    attempt(() => this.drawSpectrum(figure, diagnosis.bands), figure);
  }

  /**
   * @param {HTMLElement} place
   * @param {{channel: string, description: string, low: number, high: number}[]} bands
   */
  async drawSpectrum(place, bands) {
    const spectrum = await request("spectrum", { name: this.name, healthy: "true" });
    const split = (/** @type {string} */ text) =>
      channelLines(spectrum.channels, text, spectrum.step);

    /** @type {{low: import("./types.js").Series, high: import("./types.js").Series}[]} */
    let areas = [];
    if (spectrum.healthy?.length) {
      const high = split(spectrum.high);
      areas = split(spectrum.low).map((low, n) => ({ low, high: high[n] }));
    }

    const bandEnds = bands.map((band) => (band.high < MAX_BAND_END ? band.high : 0));
    const end = Math.max(MIN_SPECTRUM_END, 1.2 * Math.max(0, ...bandEnds));
    const whole = spectrum.step * spectrum.lines;
    const evidence = bands.length ? " with the evidence marked" : "";
    const healthy = areas.length ? ", and the range of healthy recordings" : "";
    const source = spectrum.excerpts ? `: ${spectrum.excerpts}` : "";
    const chart = new Chart({
      title: `Spectrum${evidence}${healthy}${source}`,
      x: "Hz",
      y: spectrum.unit,
      unit: spectrum.unit,
      log: true,
      shaft: spectrum.shaft,
      limits: [0, whole],
      view: [0, Math.min(whole, end)],
      areas,
      series: split(spectrum.amplitude),
      marks: bands.map((band) => [(band.low + band.high) / 2, bandName(band), true]),
      drawOver: (pen, { across, color, bottom }) => {
        const fill = color("amber") + BAND_OPACITY;
        for (const { low, high } of bands) {
          const [left, right] = [across(low), across(high)];
          pen.line([left, TOP, right, TOP, right, bottom, left, bottom], "", { fill });
        }
      },
    });
    place.replaceChildren(chart.element);
  }

  /**
   * Do what a key means on this page; return whether it means something.
   *
   * @param {KeyboardEvent} event
   */
  keys(event) {
    const steps = { j: 1, ArrowDown: 1, k: -1, ArrowUp: -1 };
    const count = steps[/** @type {keyof typeof steps} */ (event.key)];
    if (count) {
      this.name = step(this.name, count);
      this.show();
      return true;
    }
    if (event.key === "Enter" && this.name) {
      location.hash = addressOf("recording", { name: this.name });
      return true;
    }
    return false;
  }
}

/** @param {{channel: string, description: string}} band */
function bandName({ channel, description }) {
  return `${description.split(" (")[0]}, ${channel}`;
}

/** @param {any} neighbor */
function neighborItem(neighbor) {
  const href = addressOf("recording", { name: neighbor.name });
  // A training recording may lie elsewhere; then there is nothing to open.
  const title = neighbor.name
    ? element("a", { href }, neighbor.recording_id)
    : neighbor.recording_id;
  return [title, ` ${formatLabel(neighbor.label)}, distance ${formatNumber(neighbor.distance)}`];
}

/**
 * Return a section on how certain a verdict is; null if nothing is known.
 *
 * @param {any} diagnosis
 */
function uncertainty(diagnosis) {
  // Shares presume one of the trained classes, so they would contradict "unknown".
  const probabilities = diagnosis.unknown ? {} : (diagnosis.probabilities ?? {});
  const shares = Object.entries(probabilities).sort((a, b) => b[1] - a[1]);
  // A verdict that is unknown in spite of a large p-value has another reason, which it states.
  const hasOtherReason = diagnosis.unknown && diagnosis.p_value > diagnosis.error_rate;
  const showsPValue = diagnosis.p_value !== null && !hasOtherReason;
  if (!shares.length && !showsPValue) return null;

  const parts = [element("h2", {}, "Uncertainty")];
  if (shares.length) parts.push(probabilityTable(shares));
  if (showsPValue) {
    const basis = diagnosis.kind === "detector" ? "healthy" : "training";
    const pValue = formatNumber(diagnosis.p_value, 2);
    const text = `p-value among ${diagnosis.n_basis} ${basis} recordings: ${pValue}.`;
    parts.push(element("p", { class: "soft" }, text));
  }
  return element("section", {}, parts);
}

/**
 * Return a probability in percent, never rounded down to 0 or up to 100 %, as in the reports.
 *
 * @param {number} share
 */
function formatShare(share) {
  if (share > 0 && share < 0.005) return "< 1 %";
  if (share < 1 && share >= 0.995) return "> 99 %";
  return `${Math.round(100 * share)} %`;
}

/** @param {[string, number][]} shares */
function probabilityTable(shares) {
  const rows = shares.map(([label, share]) => {
    const name = formatLabel(label);
    const meter = element("meter", { min: 0, max: 1, value: share, "aria-label": name });
    return element(
      "tr",
      {},
      element("th", { scope: "row" }, name),
      element("td", {}, meter),
      element("td", { class: "number" }, formatShare(share)),
    );
  });
  return element("table", { class: "shares" }, element("tbody", {}, rows));
}

/**
 * @param {HTMLElement} place
 * @param {Record<string, string>} values
 * @returns {Promise<import("./types.js").Page>}
 */
export async function openDiagnose(place, values) {
  const page = new DiagnosePage(place, values);
  await attempt(() => page.start(), page.answer);
  return { keys: (event) => page.keys(event) };
}
