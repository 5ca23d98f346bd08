// A pump's twin: sliders, its lines over the measured ones, its calibration, and windows made with it.
import { Chart, Stems, choose, h, say, short } from "./chart.js";
import { ask, attempt, remember, send, state } from "./explorer.js";

const UNITS = ["N s/m", "N/m"];
const WORDS = ["slippers on swash plate, damping", "slippers on swash plate, stiffness", "block on valve plate, damping", "block on valve plate, stiffness", "pistons in bores, damping", "pistons in bores, stiffness"];

export async function twinRoom(place, values) {
  const rows = [...state.rows.values()].filter((row) => row.state === "ready");
  place.append(h("h1", {}, "Twin"), h("p", { class: "soft", id: "twin-wait" }, "The twin is being prepared …"));
  const known = await ask("twin_starts");
  const setting = { start: known.starts[0], values: null, scales: {}, rpm: null, mpa: null, fault: "start", dimensions: {}, recording: values.recording ?? state.current ?? (rows.find((row) => row.label === "normal") ?? rows[0])?.name ?? "", ...JSON.parse(values.setting ?? "{}") };
  if (setting.recording && !state.rows.has(setting.recording)) setting.recording = "";
  let origin = null, charts = [], isAsking = false, isWaiting = false, isGone = false, moved = null;
  const sliders = h("div", { class: "sliders" }), figures = h("div"), misfit = h("div"), cutaway = h("div"), facts = h("p", { class: "soft" }), notes = h("div"), fit = h("p", { class: "fit" }), job = h("div", { role: "status" });

  const start = h("span"), menu = () => start.replaceChildren(choose("Start from", known.starts.map((name) => [name, name === "result" ? "what was calibrated here" : name]), setting.start, (name) => { Object.assign(setting, { start: name, values: null, scales: {}, fault: "start", dimensions: {} }); renew(); }));
  const faults = choose("Fault", [["start", "as the start has it"], ["", "none, healthy"], ...known.faults.map(({ kind }) => [kind, kind.replace(/_/g, " ")])], setting.fault, (kind) => {
    const dimensions = known.faults.find((fault) => fault.kind === kind)?.dimensions ?? [];
    Object.assign(setting, { fault: kind, dimensions: Object.fromEntries(dimensions.map((item) => [item.name, item.typical])) });
    renew();
  });
  const recordings = choose("Measured", [["", "the start's own, or nothing"], ...rows.map((row) => [row.name, `${row.id} (${row.label ?? "no class"})`])], setting.recording, (name) => { Object.assign(setting, { recording: name, rpm: null, mpa: null }); renew(); });

  function slider(words, value, [low, high], { log = false, unit = "", estimate = null, onvalue }) {
    const forth = log ? Math.log10 : (x) => x, back = log ? (x) => 10 ** x : (x) => x;
    const shown = h("output", {}), range = h("input", { type: "range", min: forth(low), max: forth(high), step: (forth(high) - forth(low)) / 400, value: String(forth(value)), "aria-label": words });
    const tell = (now) => { shown.textContent = `${short(now, 4)} ${unit}`; range.setAttribute("aria-valuetext", shown.textContent); };
    range.addEventListener("input", () => { moved = performance.now(); tell(back(Number(range.value))); onvalue(back(Number(range.value))); draw(); });
    tell(value);
    return h("div", { class: "slider" }, h("span", {}, words), shown, range, estimate);
  }
  function interval(item) {
    // how far a value can be trusted
    const [low, high] = item.interval.map((end) => short(end, 3)), [below, above] = item.open;
    const words = below && above ? "no limits" : below ? `at most ${high}` : above ? `at least ${low}` : `${low} … ${high}`;
    const kind = { identified: "normal", weak: "unusual" }[item.verdict] ?? "alarm";
    return h("span", { class: "interval" }, h("span", { class: `badge ${kind}` }, item.verdict), ` 90 %: ${words}${item.correlated_with ? `, trades with ${item.correlated_with}` : ""}`);
  }

  function build(lines) {
    const six = setting.values ?? [...lines.values];
    origin = lines.estimates.length ? lines.estimates.map((item) => item.value) : origin && setting.values ? origin : [...lines.values];
    const change = (n) => (value) => { setting.values ??= [...six]; setting.values[n] = value; };
    const parts = known.letters.map((letter, n) => slider(`${letter}: ${WORDS[n]}`, six[n], [origin[n] / 30, origin[n] * 30], { log: true, unit: UNITS[n % 2], estimate: lines.estimates[n] ? interval(lines.estimates[n]) : null, onvalue: change(n) }));
    for (const [name, words] of [["mount", "Mounting, stiffness over the start's"], ["bearing", "Bearings, stiffness over the start's"]]) {
      parts.push(slider(words, setting.scales[name] ?? 1, [0.1, 10], { log: true, unit: "×", onvalue: (value) => { setting.scales[name] = value; } }));
    }
    parts.push(slider("Discharge pressure", lines.mpa, [1, Math.max(40, lines.mpa)], { unit: "MPa", onvalue: (value) => { setting.mpa = value; } }));
    parts.push(slider("Speed", lines.rpm, [lines.rpm * 0.8, lines.rpm * 1.2], { unit: "rpm", onvalue: (value) => { setting.rpm = value; } }));
    for (const [n, item] of (known.faults.find(({ kind }) => kind === setting.fault)?.dimensions ?? []).entries()) {
      const most = item.name === "angle" ? 360 : (3 * item.typical) / item.per_unit, least = n && item.name !== "angle" ? (0.2 * item.typical) / item.per_unit : 0;
      parts.push(slider(`Fault: ${item.name.replace(/_/g, " ")}`, setting.dimensions[item.name] / item.per_unit, [least, most], { unit: item.unit, onvalue: (value) => { setting.dimensions[item.name] = value * item.per_unit; } }));
    }
    sliders.replaceChildren(...parts);
    notes.replaceChildren(...(lines.notes.length ? [h("details", {}, h("summary", {}, `Remarks of the calibration: ${lines.notes.length}`), h("ul", {}, lines.notes.map((text) => h("li", {}, text))))] : []));
    facts.textContent = `${lines.pump}: ${lines.pistons} pistons, ${short(lines.displacement * 1e6)} cm³ per turn, at ${short(lines.rpm, 4)} rpm and ${short(lines.mpa, 3)} MPa; ${lines.label === "normal" ? "healthy" : lines.label.replace(/_/g, " ")}.`;
    attempt(async () => { // drawn by our own server, of a class that it knows
      cutaway.innerHTML = (await ask("twin_cutaway", { label: lines.label, pistons: lines.pistons, shaft: lines.shaft })).html;
    });
  }
  function show(lines) {
    const measured = lines.measured, names = measured?.channels ?? lines.channels;
    if (charts.length !== names.length) {
      charts = names.map((name) => new Chart({ title: `Lines of ${name}`, x: "order", y: "m/s^2", unit: "m/s^2", log: true, height: 200, limits: [0, 10], series: [] }));
      figures.replaceChildren(fit, ...charts.map((chart) => chart.element));
    }
    fit.textContent = measured ? `Correlation of levels ${measured.correlation.toFixed(3)}, spectrum value error ${measured.error.toFixed(2)}` : "";
    names.forEach((name, n) => {
      const twin = lines.amplitude[lines.channels.indexOf(name)], series = [];
      if (measured) series.push(new Stems(measured.orders, measured.amplitude[n], { name: "measured", ink: "mark", width: 7 }));
      series.push(new Stems(lines.orders, twin, { name: "twin", width: 3 }));
      const end = 1.03 * Math.max(lines.orders.at(-1) > 2500 / lines.shaft ? 2500 / lines.shaft : lines.orders.at(-1), measured?.orders.at(-1) ?? 0);
      const isSame = charts[n].limits[1] === end;
      charts[n].set({ title: `Lines of ${name}`, series, limits: [0, end], view: isSame ? charts[n].view : [0, end] });
    });
    clearTimeout(show.timer); // while a slider moves, the figures go first
    show.timer = setTimeout(() => misfit.replaceChildren(...(lines.reason ? [h("p", { class: "notice" }, lines.reason)] : []), ...(measured ? [table(measured)] : lines.reason ? [] : [h("p", { class: "soft" }, "Choose a recording to lay the twin's lines over.")])), 100);
  }
  function table({ channels, orders, misfit: off }) {
    const least = Math.max(0, orders.length - 12) && orders.length > 40 ? orders.map((_, n) => n).sort((a, b) => Math.max(...off.map((row) => Math.abs(row[b]))) - Math.max(...off.map((row) => Math.abs(row[a])))).slice(0, 12).sort((a, b) => a - b) : orders.map((_, n) => n);
    const cell = (value) => h("td", { class: `number ${value === null ? "soft" : Math.abs(value) > 6 ? "far" : Math.abs(value) < 2 ? "near" : ""}` }, value === null ? "noise" : value < -99 ? "none" : value.toFixed(1));
    return h("section", {}, h("h2", {}, "Misfit by line"), h("p", {}, `The twin over the measured lines in dB${least.length < orders.length ? ", the 12 furthest off" : ""}.`),
      h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Misfit by line" }, h("table", {}, h("thead", {}, h("tr", {}, h("th", {}, "Order"), least.map((n) => h("th", { class: "number" }, `${orders[n]}×`)))),
        h("tbody", {}, channels.map((name, row) => h("tr", {}, h("th", { scope: "row" }, name), least.map((n) => cell(off[row][n]))))))));
  }
  async function draw() {
    // one question at a time; what changes meanwhile is asked next
    if (isAsking) { isWaiting = true; return; }
    isAsking = true;
    do {
      isWaiting = false;
      await attempt(async () => {
        const since = moved;
        show(await send("twin_lines", setting));
        requestAnimationFrame(() => (figures.delays ??= []).push(performance.now() - since));
      });
    } while (isWaiting && !isGone);
    isAsking = false;
    if (!isGone) keep();
  }
  const keep = () => { clearTimeout(keep.timer); keep.timer = setTimeout(() => isGone || remember("twin", { setting: JSON.stringify(setting) }), 400); };
  async function renew() {
    menu();
    await attempt(async () => {
      const lines = await send("twin_lines", setting);
      build(lines);
      show(lines);
      keep();
    }, misfit);
  }

  async function follow() {
    const now = await ask("twin_job").catch(() => null);
    if (!now || isGone) return;
    const isRunning = now.state === "running";
    calibrate.hidden = isRunning;
    job.replaceChildren(...(isRunning ? [h("progress", { max: now.total || 1, value: now.done, "aria-label": "Calibration" }), ` step ${now.done}${now.total ? ` of ${now.total}` : ""}${now.loss === null ? "" : `, misfit ${short(now.loss, 3)}`} `, h("button", { onclick: () => attempt(() => send("twin_stop", {})) }, "Stop")] : [{ stopped: "Stopped; nothing changed.", failed: now.error, done: "Calibrated." }[now.state] ?? ""]));
    if (isRunning) { setTimeout(follow, 400); return; }
    if (now.state === "done" && follow.isMine) {
      follow.isMine = false;
      Object.assign(known, await ask("twin_starts"));
      Object.assign(setting, { start: "result", values: null, scales: {}, fault: "start", dimensions: {} });
      origin = null;
      await renew();
    }
    saving.hidden = !known.starts.includes("result");
  }
  const others = h("input", { type: "checkbox", checked: true });
  const calibrate = h("button", { class: "primary", onclick: () => attempt(async () => { await send("twin_calibrate", { setting, comparable: others.checked }); follow.isMine = true; follow(); }) }, "Calibrate from here");
  const form = (title, fields, button, work) => h("details", { class: "card" }, h("summary", {}, title), h("form", { class: "stack", onsubmit: (event) => { event.preventDefault(); say("Working …"); attempt(() => work(Object.fromEntries(new FormData(event.target)))); } },
    fields.map(([name, words, hint, value = ""]) => h("label", {}, words, " ", h("input", { name, placeholder: hint, value, required: name !== "mass" }))), h("button", {}, button)));
  const saving = form("Save the calibration", [["name", "Name", "calibration", "calibration"]], "Save", async ({ name }) => { const { file } = await send("twin_save", { name }); say(`${file} is written beside the recordings.`); Object.assign(known, await ask("twin_starts")); menu(); });
  saving.hidden = true;
  place.append(h("div", { class: "row tight" }, start, recordings, faults), facts,
    h("div", { class: "twin" }, h("div", {}, sliders, h("div", { class: "row tight" }, calibrate, h("label", {}, others, "with all of the same machine, point and class"), h("button", { onclick: () => { Object.assign(setting, { values: null, scales: {}, rpm: null, mpa: null }); renew(); } }, "Back to the start")), job, saving,
      form("Add to training: synthetic windows of this twin", [["name", "Name", "windows", "windows"], ["count", "Number", "150", "150"]], "Make windows", async ({ name, count }) => {
        const made = await send("twin_windows", { setting, name, count: Number(count) });
        say(`${made.file}: ${made.count} windows of ${made.label}, laid over the noise of the labeled recordings here, which are training data from now on. ${made.notes.join(" ")}`);
      }),
      form("New pump from its nameplate", [["name", "Name", "my-pump"], ["displacement", "Displacement", "45 cm3/rev"], ["pistons", "Pistons", "9"], ["speed", "Rated speed", "1500 rpm"], ["pressure", "Rated pressure", "280 bar"], ["mass", "Mass, if known", "21 kg"]], "Write the pump file", async ({ name, ...plate }) => {
        const made = await send("twin_pump", { name, plate });
        Object.assign(known, made);
        Object.assign(setting, { start: made.start, values: null, scales: {}, fault: "start", dimensions: {} });
        origin = null;
        await renew();
        say(`${made.start} is written; replace its guesses by what you know.`);
      }), notes), h("div", {}, figures)), cutaway, misfit);
  figures.id = "twin-lines";
  await renew();
  place.querySelector("#twin-wait").remove();
  follow();
  return { leave: () => { isGone = true; } };
}
