// A model's verdict on a recording, how sure it is, and what it rests on.
import { Chart, channelLines, h, short } from "./chart.js";
import { address, ask, attempt, remember, send, state, step } from "./explorer.js";

export async function diagnoseRoom(place, values) {
  let name = values.name ?? state.current ?? [...state.rows.values()].find((row) => row.state === "ready")?.name;
  let asked = 0;
  const model = h("p", { role: "status" }), answer = h("div");
  const words = (label) => label.replace(/_/g, " ");
  const told = (text) => { model.replaceChildren(text ? h("span", {}, "Model: ", h("strong", {}, text)) : "No model yet."); };
  const take = (work) => attempt(async () => { asked++; answer.replaceChildren(); model.replaceChildren("reading the model …"); told((await work()).model); await show(); }, model);
  const dropped = (file) => file && take(() => send(`drop?${new URLSearchParams({ name: file.name })}`, file, true));
  const file = h("input", { type: "file", accept: ".safetensors", "aria-label": "Model file", onchange: () => dropped(file.files[0]) });
  const zone = h("div", { class: "card drop" }, model, h("div", { class: "row tight" }, h("label", {}, "Drop a model or a prior here, or choose its file: ", file),
    h("button", { onclick: () => take(() => send("prior", {})) }, "Take the shipped prior, adapted to the healthy recordings here")));
  zone.addEventListener("dragover", (event) => { event.preventDefault(); zone.classList.add("over"); });
  zone.addEventListener("dragleave", () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => { event.preventDefault(); zone.classList.remove("over"); dropped(event.dataTransfer.files[0]); });
  const ready = state.names.map((key) => state.rows.get(key)).filter((row) => row.state === "ready");
  const choice = h("select", { onchange: () => { name = choice.value; show(); } }, ready.map((row) => h("option", { value: row.name, selected: row.name === name }, `${row.id} (${row.label ?? "no class"})`)));
  place.append(h("h1", {}, "Diagnose"), zone, h("div", { class: "row tight" }, h("label", {}, "Recording ", choice)), answer);

  async function show() {
    if (!name) return;
    remember("diagnose", { name });
    choice.value = name;
    answer.replaceChildren(h("p", { class: "soft" }, "asking the model …"));
    const number = ++asked;
    await attempt(async () => {
      const found = await ask("diagnosis", { name }).catch((error) => { if (number === asked) throw error; });
      if (number === asked) draw(found);
    }, answer);
  }
  function draw(found) {
    told(found.model);
    const shares = Object.entries(found.probabilities ?? {}).sort((a, b) => b[1] - a[1]);
    const list = (title, items) => (items.length ? h("section", {}, h("h2", {}, title), h("ul", {}, items.map((item) => h("li", {}, item)))) : null);
    const figure = h("div");
    const row = state.rows.get(name);
    answer.replaceChildren(
      h("p", { class: "verdict" }, words(found.verdict), row.label ? h("small", {}, ` · its facts say ${words(row.label)}`) : ""), h("p", {}, found.sentence), found.spectrum ? h("p", {}, found.spectrum) : "",
      h("div", { class: "columns" },
        shares.length ? h("section", {}, h("h2", {}, "How sure"), h("table", { class: "shares" }, h("tbody", {}, shares.map(([label, share]) => h("tr", {}, h("th", { scope: "row" }, words(label)), h("td", {}, h("meter", { min: 0, max: 1, value: share, "aria-label": words(label) })), h("td", { class: "number" }, `${Math.round(100 * share)} %`))))),
          found.p_value === null || (found.verdict === "unknown" && found.p_value > found.error_rate) ? "" : h("p", { class: "soft" }, `Resembles the training with p = ${short(found.p_value, 2)} (${found.n_basis} recordings).`)) : found.p_value === null ? "" : h("section", {}, h("h2", {}, "How sure"), h("p", {}, `Chance from the healthy machine p = ${short(found.p_value, 2)}, of ${found.n_basis} healthy recordings.`)),
        found.nearest.length ? h("section", {}, h("h2", {}, "Nearest training recordings"), h("ol", {}, found.nearest.map((near) => h("li", {}, near.name ? h("a", { href: address("recording", { name: near.name }) }, near.recording_id) : near.recording_id, ` ${words(near.label)}, distance ${short(near.distance)}`)))) : "",
        list("What to check next", found.checks.map((check) => [h("strong", {}, check.what), ` ${check.why}`]))),
      figure, list("Evidence", found.evidence) ?? "", list("Before trusting it", found.notes) ?? "");
    attempt(async () => {
      const spectrum = await ask("spectrum", { name, healthy: "true" });
      const split = (text) => channelLines(spectrum.channels, text, spectrum.step);
      const areas = spectrum.healthy?.length ? split(spectrum.low).map((low, n) => ({ low, high: split(spectrum.high)[n] })) : [];
      const end = Math.min(spectrum.step * spectrum.lines, Math.max(3000, 1.2 * Math.max(0, ...found.bands.map((band) => (band.high < 20000 ? band.high : 0)))));
      const chart = new Chart({ title: `Spectrum${found.bands.length ? " with the evidence marked" : ""}${areas.length ? ", over healthy ones" : ""}`, x: "Hz", y: spectrum.unit, unit: spectrum.unit, log: true, shaft: spectrum.shaft, limits: [0, spectrum.step * spectrum.lines], view: [0, end], areas, series: split(spectrum.amplitude),
        marks: found.bands.map((band) => [(band.low + band.high) / 2, `${band.description.split(" (")[0]}, ${band.channel}`, true]),
        over: (pen, { across, color, bottom }) => { for (const band of found.bands) pen.line([across(band.low), 30, across(band.high), 30, across(band.high), bottom, across(band.low), bottom], "", { fill: `${color("amber")}22` }); } });
      figure.replaceChildren(chart.element);
    }, figure);
  }
  await attempt(async () => {
    const { model: text } = await ask("model");
    told(text);
    if (text) await show();
  }, answer);
  return { keys: (event) => {
    const by = { j: 1, ArrowDown: 1, k: -1, ArrowUp: -1 }[event.key];
    if (by) { name = step(name, by); show(); }
    else if (event.key === "Enter" && name) location.hash = address("recording", { name });
    else return false;
    return true;
  } };
}
