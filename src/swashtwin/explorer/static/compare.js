// Recordings or classes over one another, and what differs most.
import { Chart, channelLines, choose, h } from "./chart.js";
import { address, ask, attempt, remember, state } from "./explorer.js";

const MOST = 12;

export async function compareRoom(place, values) {
  const rows = state.names.map((name) => state.rows.get(name)).filter((row) => row.state === "ready");
  if (rows.length < 2) throw new Error("Comparing takes two recordings that can be read.");
  const given = (values.a ?? "").split("|").filter((name) => state.rows.has(name));
  const [own, other] = [state.classes?.[0], state.classes?.find((label) => label !== state.classes[0])];
  const sides = { a: values.b || given.length < 2 ? values.a : given[0], b: values.b ?? (given.length > 1 ? given.slice(1).join("|") : undefined) };
  sides.a ||= own ? `class:${own}` : rows[0].name;
  sides.b ||= other ? `class:${other}` : rows[1].name;
  let channel = Number(values.channel ?? 0), kind = values.kind ?? "amplitude";
  const figures = h("div"), table = h("div");
  const members = (side) => (side.startsWith("class:") ? rows.filter((row) => row.label === side.slice(6)).slice(0, MOST).map((row) => row.name) : side.split("|").filter((name) => state.rows.has(name)));
  const words = (side) => (side.startsWith("class:") ? `class ${side.slice(6).replace(/_/g, " ")}` : side.includes("|") ? `${members(side).length} selected recordings` : state.rows.get(side)?.id ?? side);
  const menu = (key, text) => choose(text, [...(sides[key].includes("|") ? [sides[key]] : []), ...(state.classes ?? []).map((label) => `class:${label}`), ...rows.map((row) => row.name)].map((side) => [side, words(side)]), sides[key], (side) => { sides[key] = side; show(); });
  const first = rows.find((row) => row.name === members(sides.b)[0]) ?? rows[0];
  place.append(h("h1", {}, "Compare"), h("p", { class: "soft" }, `Select recordings in the table, or choose two classes; of a class the first ${MOST} are shown.`),
    h("div", { class: "row tight" }, menu("a", "This"), menu("b", "against"), choose("Channel", first.channels.map((name, n) => [n, name]), channel, (value) => { channel = Number(value); show(); }),
      choose("Spectrum over", [["amplitude", "frequency"], ["order", "orders of the shaft"]], kind, (value) => { kind = value; show(); })), figures, table);

  async function show() {
    remember("compare", { a: sides.a, b: sides.b, channel, kind });
    const [a, b] = [members(sides.a), members(sides.b)];
    figures.replaceChildren(h("p", { class: "soft" }, "computing …"));
    await Promise.all([attempt(() => spectra(a, b), figures), attempt(() => ranking(a, b), table)]);
  }
  async function spectra(a, b) {
    const names = [...a, ...b], series = [];
    let shown = null;
    for (const [n, name] of names.entries()) {
      const spectrum = await ask("spectrum", { name, kind });
      shown ??= spectrum;
      const line = channelLines(spectrum.channels, spectrum.amplitude, spectrum.step)[channel];
      if (line) series.push(Object.assign(line, { name: state.rows.get(name).id, color: n < a.length ? 0 : 1, faint: names.length > 2 ? "73" : "" }));
    }
    const end = Math.max(...series.map((line) => line.step * line.values.length)), isOrder = kind === "order";
    const make = (title, lines, height) => new Chart({ title, x: isOrder ? "order" : "Hz", y: shown.unit, unit: shown.unit, log: true, height, shaft: isOrder ? null : shown.shaft, limits: [0, end], view: [0, Math.min(end, isOrder ? 80 : 3000)], marks: shown.marks, series: lines });
    const charts = [make(`${words(sides.a)} (blue) and ${words(sides.b)} (red)`, series, 300), make(words(sides.a), series.slice(0, a.length), 180), make(words(sides.b), series.slice(a.length), 180)];
    for (const chart of charts) chart.onmove = (view) => { for (const next of charts) if (next !== chart) next.set({ view: [...view] }); };
    figures.replaceChildren(charts[0].element, h("div", { class: "columns" }, charts[1].element, charts[2].element));
  }
  async function ranking(a, b) {
    const query = new URLSearchParams([...a.map((name) => ["first", name]), ...b.map((name) => ["second", name])]);
    const found = await ask(`comparison?${query}`);
    table.replaceChildren(h("section", {}, h("h2", {}, "What differs most"),
      h("p", {}, `Change is ${words(sides.b)} less ${words(sides.a)}${found.freedom ? ", ranked by spreads within both, 1 dB at least." : "; with one recording on either side no spread is known, so 1 dB counts as one."}`),
      h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "What differs most" }, h("table", { class: "changes" }, h("thead", {}, h("tr", {}, ["Level", "Channel", "Change", "Spreads"].map((text, n) => h("th", { class: n > 1 ? "number" : "" }, text)))),
        h("tbody", {}, found.rows.map((row) => h("tr", {}, h("td", {}, row.band), h("td", {}, row.channel), h("td", { class: "number" }, `${row.change > 0 ? "+" : ""}${row.change.toFixed(1)} dB`), h("td", { class: "number" }, row.spreads.toFixed(1))))))),
      ...found.notes.map((text) => h("p", { class: "soft" }, text)), h("p", {}, "Open: ", [...a, ...b].slice(0, 8).flatMap((name) => [h("a", { href: address("recording", { name }) }, state.rows.get(name).id), " "]))));
  }
  await show();
  return {};
}
