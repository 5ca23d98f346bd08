/** A pump's twin: its lines over measured ones, calibration, windows, and new pumps. */
import { Chart } from "./chart.js";
import { element, foldedList, scrollTable, selectMenu, showMessage } from "./elements.js";
import { LivingPump } from "./living_pump.js";
import { formatLabel, formatNumber, formatPressure, PRESSURE } from "./numbers.js";
import { Stems } from "./series.js";
import { attempt, attemptQuietly, request, send } from "./server.js";
import { readyRows, rememberAddress, state } from "./state.js";

const PARAMETER_UNITS = ["N s/m", "N/m"];
const PARAMETER_NAMES = [
  "slippers on swash plate, damping",
  "slippers on swash plate, stiffness",
  "block on valve plate, damping",
  "block on valve plate, stiffness",
  "pistons in bores, damping",
  "pistons in bores, stiffness",
];
const SCALES = [
  ["mount", "Mounting stiffness, relative to the start"],
  ["bearing", "Bearing stiffness, relative to the start"],
];
/** A value can be moved by this factor in both directions. */
const VALUE_RANGE = 30;
const SCALE_RANGE = 10;
const MAX_PRESSURE_MPA = 40;
const SPEED_RANGE = 0.2;
const SLIDER_STEPS = 400;
/** Highest frequency whose lines are compared, as at the server. */
const MAX_FREQUENCY = 2500;
/** Columns of the misfit's table; of more lines, those that differ most. */
const ALL_LINES = 40;
const WORST_LINES = 12;
/** Differences that are marked as good and as large [dB]. */
const SMALL_MISFIT = 2;
const LARGE_MISFIT = 6;
/** Difference of a line that the twin lacks [dB]. */
const NO_LINE = -99;
/** Height of the charts by their number, so that all are in view while a slider moves [px]. */
const CHART_HEIGHTS = [220, 170, 145];
/** Share of the largest line of its channel below which a change is not worth a remark. */
const MIN_LINE = 1e-2;
/** Half of the width of a slider's handle, which its track ends before [px]. */
const HANDLE = 8;
const TABLE_DELAY_MS = 100;
const REMEMBER_DELAY_MS = 400;
const POLL_MS = 400;
const RESULT = "result";

class TwinPage {
  /**
   * @param {HTMLElement} place
   * @param {Record<string, string>} values
   * @param {any} known pumps, calibrations and faults to start from
   */
  constructor(place, values, known) {
    this.known = known;
    this.rows = readyRows();
    this.setting = { ...this.firstSetting(values), ...JSON.parse(values.setting ?? "{}") };
    if (!state.rows.has(this.setting.recording)) this.setting.recording = "";

    /** @type {number[] | null} values from which the ranges of the sliders are made */
    this.origin = null;
    /** @type {Chart[]} */
    this.charts = [];
    this.isRequesting = false;
    this.isOutdated = false;
    this.isLeft = false;
    this.hasStartedJob = false;
    this.tableTimer = 0;
    this.rememberTimer = 0;

    this.startMenu = element("span");
    this.summary = element("p", { class: "soft" });
    this.sliders = element("div", { class: "sliders" });
    this.figures = element("div", { id: "twin-lines" });
    this.fit = element("p", { class: "fit" });
    this.notes = element("div");
    this.job = element("div", { role: "status" });
    this.warnings = element("div");
    this.cutaway = element("div");
    /** @type {any} lines that are shown */
    this.lines = null;
    /** @type {{label: string, place: HTMLElement, lines: any} | null} slider that was moved last */
    this.moved = null;
    this.pumpPlace = element("div", { class: "living-pump" });
    this.turnSource = element("p", { class: "turn-source soft" });
    this.pump = new LivingPump(this.pumpPlace);
    this.misfit = element("div");
    this.savingForm = this.makeSavingForm();
    this.savingForm.hidden = true;
    this.addElements(place);
  }

  /**
   * @param {Record<string, string>} values
   * @returns {Record<string, any>}
   */
  firstSetting(values) {
    const healthyRow = this.rows.find((row) => row.healthy);
    const firstRow = healthyRow ?? this.rows[0];
    return {
      start: this.known.starts[0],
      values: null,
      scales: {},
      rpm: null,
      mpa: null,
      fault: "start",
      dimensions: {},
      recording: values.recording ?? state.current ?? firstRow?.name ?? "",
    };
  }

  /** @param {HTMLElement} place */
  addElements(place) {
    const comparable = element("input", { type: "checkbox", checked: true });
    const calibrate = () => attempt(() => this.calibrate(comparable.checked));
    const label = "with comparable recordings";
    const title = "Recordings of the same machine, operating point and class";
    this.calibrateButton = element(
      "button",
      { class: "primary", onclick: calibrate },
      "Calibrate from here",
    );
    const reset = () => this.restart({ values: null, scales: {}, rpm: null, mpa: null });

    const controls = [
      this.sliders,
      element(
        "div",
        { class: "row tight" },
        this.calibrateButton,
        element("label", { title }, comparable, label),
        element("button", { onclick: reset }, "Reset to the start"),
      ),
      this.job,
      this.savingForm,
      this.makeWindowsForm(),
      this.makePumpForm(),
      this.notes,
    ];
    const menus = [this.startMenu, this.recordingMenu(), this.faultMenu()];
    place.append(
      element("div", { class: "row tight" }, menus),
      this.summary,
      this.warnings,
      this.pumpPlace,
      this.turnSource,
      element(
        "div",
        { class: "twin" },
        element("div", {}, controls),
        element("div", {}, this.figures),
      ),
      this.cutaway,
      this.misfit,
    );
  }

  showStartMenu() {
    /** @type {[string, string][]} */
    const options = this.known.starts.map((/** @type {string} */ name) => [
      name,
      name === RESULT ? "the calibration made here" : name,
    ]);
    const select = (/** @type {string} */ name) => this.restart(freshSetting(name));
    this.startMenu.replaceChildren(selectMenu("Start from", options, this.setting.start, select));
  }

  recordingMenu() {
    /** @type {[string, string][]} */
    const options = [["", "lines of the start's calibration"]];
    for (const { name, id, label } of this.rows) {
      options.push([name, `${id} (${label ?? "no class"})`]);
    }
    return selectMenu("Measured", options, this.setting.recording, (recording) =>
      this.restart({ recording, rpm: null, mpa: null }),
    );
  }

  faultMenu() {
    const kinds = this.known.faults.map((/** @type {any} */ fault) => fault.kind);
    /** @type {[string, string][]} */
    const options = [
      ["start", "that of the start"],
      ["", "none, healthy"],
      ...kinds.map((/** @type {string} */ kind) => [kind, formatLabel(kind)]),
    ];
    return selectMenu("Fault", options, this.setting.fault, (fault) => {
      const typical = this.dimensionsOf(fault).map(({ name, typical }) => [name, typical]);
      this.restart({ fault, dimensions: Object.fromEntries(typical) });
    });
  }

  /**
   * Return the dimensions of a kind of fault.
   *
   * @param {string} kind
   * @returns {{name: string, unit: string, per_unit: number, typical: number}[]}
   */
  dimensionsOf(kind) {
    const fault = this.known.faults.find((/** @type {any} */ item) => item.kind === kind);
    return fault?.dimensions ?? [];
  }

  /**
   * Change the setting, and show the twin with new sliders.
   *
   * @param {Record<string, any>} changes
   */
  async restart(changes) {
    Object.assign(this.setting, changes);
    this.showStartMenu();
    await attempt(async () => {
      const lines = await send("twin_lines", this.setting);
      this.showTwin(lines);
      this.showLines(lines);
      this.remember();
    }, this.misfit);
  }

  /**
   * Show sliders, notes and drawing of a twin.
   *
   * @param {any} lines
   */
  showTwin(lines) {
    if (lines.estimates.length) {
      this.origin = lines.estimates.map((/** @type {any} */ estimate) => estimate.value);
    } else if (!this.origin || !this.setting.values) {
      this.origin = [...lines.values];
    }

    this.moved = null;
    this.sliders.replaceChildren(
      element(
        "p",
        { class: "soft" },
        element("span", { class: "key sign nominal" }),
        " nominal value ",
        element("span", { class: "key sign interval" }),
        " 90 % interval of the calibration",
      ),
      ...this.valueSliders(lines),
      ...this.scaleSliders(),
      ...this.conditionSliders(lines),
      ...this.dimensionSliders(),
    );
    const notes = foldedList(`Notes of the calibration: ${lines.notes.length}`, lines.notes);
    this.notes.replaceChildren(...(notes ? [notes] : []));

    const state = lines.label === "normal" ? "healthy" : formatLabel(lines.label);
    const displacement = formatNumber(lines.displacement * 1e6);
    const speed = formatNumber(lines.rpm, 4);
    this.summary.textContent =
      `${lines.pump}: ${lines.pistons} pistons, ${displacement} cm³/rev,` +
      ` ${speed} rpm, ${formatPressure(lines.mpa)}; ${state}.`;
    attempt(() => this.drawCutaway(lines));
  }

  /** @param {any} lines */
  async drawCutaway({ label, pistons, shaft }) {
    // Without a fault it would show nothing that the turning pump does not.
    if (label === "normal") {
      this.cutaway.replaceChildren();
      return;
    }
    // The drawing is made by our own server, of a class that it knows.
    const { html } = await request("twin_cutaway", { label, pistons, shaft });
    this.cutaway.innerHTML = html;
  }

  /** @param {any} lines */
  valueSliders(lines) {
    const values = this.setting.values ?? [...lines.values];
    return this.known.letters.map((/** @type {string} */ letter, /** @type {number} */ n) => {
      const estimate = lines.estimates[n];
      return this.slider(`${letter}: ${PARAMETER_NAMES[n]}`, values[n], {
        low: this.origin[n] / VALUE_RANGE,
        high: this.origin[n] * VALUE_RANGE,
        isLog: true,
        unit: PARAMETER_UNITS[n % 2],
        nominal: lines.nominal[n],
        estimate,
        onValue: (value) => {
          this.setting.values ??= [...values];
          this.setting.values[n] = value;
        },
      });
    });
  }

  scaleSliders() {
    const { scales } = this.setting;
    return SCALES.map(([name, label]) =>
      this.slider(label, scales[name] ?? 1, {
        low: 1 / SCALE_RANGE,
        high: SCALE_RANGE,
        isLog: true,
        unit: "×",
        nominal: 1,
        onValue: (value) => {
          scales[name] = value;
        },
      }),
    );
  }

  /** @param {any} lines */
  conditionSliders({ mpa, rpm }) {
    const { unit, perMpa } = PRESSURE;
    const pressure = this.slider("Discharge pressure", perMpa * mpa, {
      low: perMpa,
      high: perMpa * Math.max(MAX_PRESSURE_MPA, mpa),
      unit,
      nominal: perMpa * mpa,
      onValue: (value) => {
        this.setting.mpa = value / perMpa;
      },
    });
    const speed = this.slider("Speed", rpm, {
      low: rpm * (1 - SPEED_RANGE),
      high: rpm * (1 + SPEED_RANGE),
      unit: "rpm",
      nominal: rpm,
      onValue: (value) => {
        this.setting.rpm = value;
      },
    });
    return [pressure, speed];
  }

  dimensionSliders() {
    const { dimensions, fault } = this.setting;
    return this.dimensionsOf(fault).map(({ name, unit, per_unit: perUnit, typical }, n) => {
      const isAngle = name === "angle";
      // The first dimension is the severity, which may be zero; a fault without extent is none.
      const low = n === 0 || isAngle ? 0 : (0.2 * typical) / perUnit;
      return this.slider(`Fault: ${formatLabel(name)}`, dimensions[name] / perUnit, {
        low,
        high: isAngle ? 360 : (3 * typical) / perUnit,
        unit,
        nominal: typical / perUnit,
        onValue: (value) => {
          dimensions[name] = value * perUnit;
        },
      });
    });
  }

  /**
   * Return a slider that draws the twin's lines while it moves.
   *
   * @param {string} label
   * @param {number} value
   * @param {object} options
   * @param {number} options.low
   * @param {number} options.high
   * @param {string} options.unit
   * @param {boolean} [options.isLog] whether equal steps are equal factors
   * @param {number} options.nominal value that is marked on the track
   * @param {any} [options.estimate] of a calibration, whose interval is marked
   * @param {(value: number) => void} options.onValue
   */
  slider(label, value, { low, high, unit, nominal, isLog = false, estimate = null, onValue }) {
    const toPosition = (/** @type {number} */ number) => (isLog ? Math.log10(number) : number);
    const toValue = (/** @type {number} */ position) => (isLog ? 10 ** position : position);
    const min = toPosition(low);
    const max = toPosition(high);
    const output = element("output");
    const range = element("input", {
      type: "range",
      min,
      max,
      step: (max - min) / SLIDER_STEPS,
      value: String(toPosition(value)),
      "aria-label": label,
    });

    const showValue = (/** @type {number} */ number) => {
      output.textContent = `${formatNumber(number, 4)} ${unit}`;
      range.setAttribute("aria-valuetext", output.textContent);
    };
    range.addEventListener("input", () => {
      const moved = toValue(Number(range.value));
      showValue(moved);
      if (this.moved?.label !== label) {
        this.moved?.place.replaceChildren();
        this.moved = { label, place: change, lines: this.lines };
      }
      onValue(moved);
      this.draw();
    });
    showValue(value);
    const share = (/** @type {number} */ number) =>
      Math.min(Math.max((toPosition(number) - min) / (max - min), 0), 1);
    const change = element("span", { class: "change" });
    const title = element("span", {}, label);
    const track = sliderTrack(share, nominal, estimate);
    const interval = estimate ? intervalLabel(estimate) : null;
    return element("div", { class: "slider" }, title, output, range, track, interval, change);
  }

  /** Draw the lines of the setting; one request at a time, and another if it changed meanwhile. */
  async draw() {
    if (this.isRequesting) {
      this.isOutdated = true;
      return;
    }

    this.isRequesting = true;
    do {
      this.isOutdated = false;
      await attempt(async () => this.showLines(await send("twin_lines", this.setting)));
    } while (this.isOutdated && !this.isLeft);
    this.isRequesting = false;
    if (!this.isLeft) this.remember();
  }

  /**
   * Show the lines of a twin over the measured ones.
   *
   * @param {any} lines
   */
  showLines(lines) {
    const { measured } = lines;
    this.lines = lines;
    this.pump.show(lines.turn);
    this.turnSource.textContent = lines.turn_source;
    this.showWarnings(lines);
    if (this.moved) this.moved.place.textContent = largestChange(lines, this.moved.lines);
    const channels = measured?.channels ?? lines.channels;
    if (this.charts.length !== channels.length) this.makeCharts(channels);

    this.fit.textContent = "";
    if (measured) {
      const correlation = measured.correlation.toFixed(3);
      const error = measured.error.toFixed(2);
      this.fit.textContent = `Correlation of levels ${correlation}, spectrum value error ${error}`;
    }
    channels.forEach((/** @type {string} */ channel, /** @type {number} */ n) => {
      this.showChannel(this.charts[n], channel, n, lines);
    });

    // While a slider moves, the figures go first.
    clearTimeout(this.tableTimer);
    this.tableTimer = setTimeout(() => this.showMisfit(lines), TABLE_DELAY_MS);
  }

  /**
   * State what a reader must know before the figures.
   *
   * @param {any} lines
   */
  showWarnings({ reason, estimates }) {
    const warnings = reason ? [reason] : [];
    const isOpen = (/** @type {any} */ estimate) => estimate.verdict === "not identified";
    const letters = this.known.letters.filter((/** @type {string} */ _, /** @type {number} */ n) =>
      estimates[n] ? isOpen(estimates[n]) : false,
    );
    if (letters.length) {
      const names = letters.join(", ");
      warnings.push(`The recordings do not determine ${names}: other values fit as well.`);
    }
    const notices = warnings.map((text) => element("p", { class: "notice" }, text));
    this.warnings.replaceChildren(...notices);
  }

  /** @param {string[]} channels */
  makeCharts(channels) {
    this.charts = channels.map(
      (channel) =>
        new Chart({
          title: `Lines of ${channel}`,
          x: "order",
          y: "m/s^2",
          unit: "m/s^2",
          log: true,
          height: CHART_HEIGHTS[Math.min(channels.length, CHART_HEIGHTS.length) - 1],
          limits: [0, 10],
        }),
    );
    const legend = element(
      "p",
      { class: "fit" },
      element("span", { class: "key sign measured" }),
      " measured ",
      element("span", { class: "key sign simulated" }),
      " twin",
    );
    this.figures.replaceChildren(legend, this.fit, ...this.charts.map((chart) => chart.element));
  }

  /**
   * @param {Chart} chart
   * @param {string} channel
   * @param {number} n number of the channel in the measurement
   * @param {any} lines
   */
  showChannel(chart, channel, n, lines) {
    const { measured, orders } = lines;
    const amplitude = lines.amplitude[lines.channels.indexOf(channel)];
    const series = [new Stems(orders, amplitude, { name: "twin", width: 3 })];
    if (measured) {
      const options = { name: "measured", ink: "mark", width: 7 };
      series.unshift(new Stems(measured.orders, measured.amplitude[n], options));
    }

    const lastCompared = Math.min(orders.at(-1), MAX_FREQUENCY / lines.shaft);
    const end = 1.03 * Math.max(lastCompared, measured?.orders.at(-1) ?? 0);
    /** @type {import("./types.js").Range} */
    const limits = [0, end];
    // The part that is shown is kept while a slider moves.
    const view = chart.limits[1] === end ? chart.view : limits;
    chart.set({ title: `Lines of ${channel}`, series, limits, view });
  }

  /** @param {any} lines */
  showMisfit({ measured, reason }) {
    const parts = [];
    if (measured) parts.push(misfitSection(measured));
    if (!reason && !measured) {
      const hint = "Select a recording to compare the twin's lines with.";
      parts.push(element("p", { class: "soft" }, hint));
    }
    this.misfit.replaceChildren(...parts);
  }

  remember() {
    clearTimeout(this.rememberTimer);
    this.rememberTimer = setTimeout(() => {
      if (!this.isLeft) rememberAddress("twin", { setting: JSON.stringify(this.setting) });
    }, REMEMBER_DELAY_MS);
  }

  /** @param {boolean} comparable whether to use also comparable recordings */
  async calibrate(comparable) {
    await send("twin_calibrate", { setting: this.setting, comparable });
    this.hasStartedJob = true;
    this.followJob();
  }

  /** Show the progress of the calibration until it ends. */
  async followJob() {
    /** @type {any} */
    const job = await attemptQuietly(() => request("twin_job"));
    if (!job || this.isLeft) return;

    const isRunning = job.state === "running";
    this.calibrateButton.hidden = isRunning;
    this.job.replaceChildren(...(isRunning ? jobProgress(job) : [jobResult(job)]));
    if (isRunning) {
      setTimeout(() => this.followJob(), POLL_MS);
      return;
    }

    if (job.state === "done" && this.hasStartedJob) {
      this.hasStartedJob = false;
      Object.assign(this.known, await request("twin_starts"));
      this.origin = null;
      await this.restart(freshSetting(RESULT));
    }
    this.savingForm.hidden = !this.known.starts.includes(RESULT);
  }

  makeSavingForm() {
    const fields = [{ name: "name", label: "Name", example: "calibration", value: "calibration" }];
    return makeForm("Save the calibration", fields, "Save", async ({ name }) => {
      const { file } = await send("twin_save", { name });
      showMessage(`${file} is saved in the folder of the recordings.`);
      Object.assign(this.known, await request("twin_starts"));
      this.showStartMenu();
    });
  }

  makeWindowsForm() {
    const fields = [
      { name: "name", label: "Name", example: "windows", value: "windows" },
      { name: "count", label: "Number", example: "150", value: "150" },
    ];
    const title = "Synthesize windows of this twin for training";
    return makeForm(title, fields, "Make windows", async ({ name, count }) => {
      const content = { setting: this.setting, name, count: Number(count) };
      const windows = await send("twin_windows", content);
      showMessage(
        `${windows.file}: ${windows.count} windows of ${windows.label}.` +
          " Their noise is from the labeled recordings here, which are now training data." +
          ` ${windows.notes.join(" ")}`,
      );
    });
  }

  makePumpForm() {
    const fields = [
      { name: "name", label: "Name", example: "my-pump" },
      { name: "displacement", label: "Displacement", example: "45 cm3/rev" },
      { name: "pistons", label: "Pistons", example: "9" },
      { name: "speed", label: "Rated speed", example: "1500 rpm" },
      { name: "pressure", label: "Rated pressure", example: "280 bar" },
      { name: "mass", label: "Mass, if known", example: "21 kg", isOptional: true },
    ];
    const title = "New pump from its nameplate";
    return makeForm(title, fields, "Write the pump file", async ({ name, ...plate }) => {
      const pump = await send("twin_pump", { name, plate });
      Object.assign(this.known, pump);
      this.origin = null;
      await this.restart(freshSetting(pump.start));
      showMessage(`${pump.start} is written. Replace its estimates by values that you know.`);
    });
  }
}

/**
 * Return the setting of a start that nobody changed.
 *
 * @param {string} start
 * @returns {Record<string, any>}
 */
function freshSetting(start) {
  return { start, values: null, scales: {}, fault: "start", dimensions: {} };
}

/**
 * Return a form that is closed at first.
 *
 * @param {string} title
 * @param {{name: string, label: string, example: string, value?: string, isOptional?: boolean}[]}
 *   fields
 * @param {string} button
 * @param {(values: Record<string, any>) => Promise<void>} work
 */
function makeForm(title, fields, button, work) {
  const labels = fields.map(({ name, label, example, value = "", isOptional = false }) => {
    const attributes = { name, placeholder: example, value, required: !isOptional };
    return element("label", {}, label, " ", element("input", attributes));
  });
  const onsubmit = (/** @type {any} */ event) => {
    event.preventDefault();
    showMessage("Working …");
    attempt(() => work(Object.fromEntries(new FormData(event.target))));
  };
  const form = element("form", { class: "stack", onsubmit }, labels, element("button", {}, button));
  return element("details", { class: "card" }, element("summary", {}, title), form);
}

/**
 * Return marks below a slider: the interval of its value, and the nominal one.
 *
 * @param {(value: number) => number} share of the slider's way
 * @param {number} nominal
 * @param {any} estimate
 */
function sliderTrack(share, nominal, estimate) {
  const at = (/** @type {number} */ part) =>
    `calc(${HANDLE}px + (100% - ${2 * HANDLE}px) * ${part})`;
  const mark = element("span", { class: "nominal" });
  mark.style.left = at(share(nominal));
  const track = element("span", { class: "track", "aria-hidden": "true" }, mark);
  if (estimate) {
    const [low, high] = estimate.interval;
    const [isOpenBelow, isOpenAbove] = estimate.open;
    const start = isOpenBelow ? 0 : share(low);
    const end = isOpenAbove ? 1 : share(high);
    const bar = element("span", { class: "interval" });
    bar.style.left = at(start);
    bar.style.width = `calc((100% - ${2 * HANDLE}px) * ${end - start})`;
    track.prepend(bar);
  }
  return track;
}

/**
 * Return the line whose level changed most since a slider began to move.
 *
 * @param {any} lines
 * @param {any} previous
 */
function largestChange(lines, previous) {
  let text = "No line changed.";
  let largest = 0.05;
  lines.channels.forEach((/** @type {string} */ channel, /** @type {number} */ row) => {
    const strongest = Math.max(...lines.amplitude[row], ...previous.amplitude[row]);
    lines.orders.forEach((/** @type {number} */ order, /** @type {number} */ n) => {
      const now = lines.amplitude[row][n];
      const before = previous.amplitude[row][previous.orders.indexOf(order)] ?? 0;
      if (Math.max(now, before) < MIN_LINE * strongest || !now || !before) return;
      const change = 20 * Math.log10(now / before);
      if (Math.abs(change) <= largest) return;
      largest = Math.abs(change);
      const sign = change > 0 ? "+" : "−";
      text = `Changed most: ${channel}, ${order}× by ${sign}${largest.toFixed(1)} dB`;
    });
  });
  return text;
}

/**
 * Return a label on how well a value is identified.
 *
 * @param {any} estimate
 */
function intervalLabel(estimate) {
  const [low, high] = estimate.interval.map((/** @type {number} */ end) => formatNumber(end));
  const [isOpenBelow, isOpenAbove] = estimate.open;
  let interval = `${low} … ${high}`;
  if (isOpenBelow && isOpenAbove) interval = "not limited";
  else if (isOpenBelow) interval = `at most ${high}`;
  else if (isOpenAbove) interval = `at least ${low}`;

  const styles = { identified: "normal", weak: "unusual" };
  const style = styles[/** @type {keyof typeof styles} */ (estimate.verdict)] ?? "alarm";
  const badge = element("span", { class: `badge ${style}` }, estimate.verdict);
  const partner = estimate.correlated_with;
  const correlation = partner ? `, correlated with ${partner}` : "";
  return element("span", { class: "interval" }, badge, ` 90 %: ${interval}${correlation}`);
}

/** @param {any} job */
function jobProgress({ step, total, loss }) {
  const bar = element("progress", { max: total || 1, value: step, "aria-label": "Calibration" });
  const steps = total ? `${step} of ${total}` : step;
  const misfit = loss === null ? "" : `, misfit ${formatNumber(loss)}`;
  const stop = () => attempt(() => send("twin_stop", {}));
  return [
    bar,
    ` step ${steps}${misfit} `,
    element("button", { onclick: stop }, "Stop the calibration"),
  ];
}

/** @param {any} job */
function jobResult({ state: jobState, error }) {
  if (jobState === "stopped") return "Stopped; nothing changed.";
  if (jobState === "failed") return error;
  return jobState === "done" ? "Calibrated." : "";
}

/** @param {any} measured */
function misfitSection({ channels, orders, misfit, excerpts }) {
  const columns = misfitColumns(orders, misfit);
  const isPart = columns.length < orders.length;
  const selection = isPart ? `; the ${WORST_LINES} lines that differ most` : "";
  const source = excerpts ? `, which are of ${excerpts}` : "";
  const headers = [
    element("th", {}, "Order"),
    ...columns.map((n) => element("th", { class: "number" }, `${orders[n]}×`)),
  ];
  const rows = channels.map((/** @type {string} */ channel, /** @type {number} */ row) =>
    element(
      "tr",
      {},
      element("th", { scope: "row" }, channel),
      columns.map((n) => misfitCell(misfit[row][n])),
    ),
  );
  return element(
    "section",
    {},
    element("h2", {}, "Misfit by line"),
    element("p", {}, `Level of the twin's lines over the measured ones${source} [dB]${selection}.`),
    scrollTable("Misfit by line", headers, rows),
  );
}

/**
 * Return the indices of the lines that the table shows, in their order.
 *
 * @param {number[]} orders
 * @param {(number | null)[][]} misfit
 */
function misfitColumns(orders, misfit) {
  const indices = orders.map((_, n) => n);
  if (orders.length <= ALL_LINES) return indices;
  const largest = (/** @type {number} */ n) => Math.max(...misfit.map((row) => Math.abs(row[n])));
  const byMisfit = indices.sort((a, b) => largest(b) - largest(a));
  return byMisfit.slice(0, WORST_LINES).sort((a, b) => a - b);
}

/** @param {number | null} value */
function misfitCell(value) {
  if (value === null) return element("td", { class: "number soft" }, "noise");

  let style = "";
  if (Math.abs(value) > LARGE_MISFIT) style = "large";
  else if (Math.abs(value) < SMALL_MISFIT) style = "small";
  const text = value < NO_LINE ? "none" : value.toFixed(1);
  return element("td", { class: `number ${style}` }, text);
}

/**
 * @param {HTMLElement} place
 * @param {Record<string, string>} values
 * @returns {Promise<import("./types.js").Page>}
 */
export async function openTwin(place, values) {
  const progress = element("p", { class: "soft" }, "Preparing the twin …");
  place.append(element("h1", {}, "Twin"), progress);
  const page = new TwinPage(place, values, await request("twin_starts"));
  await page.restart({});
  progress.remove();
  page.followJob();
  return {
    leave: () => {
      page.isLeft = true;
    },
  };
}
