// One recording: waveform, spectra, envelope, waterfall, level, and its sound.
import { Chart, Lines, channelLines, choose, decibel, h, inUnits, say, short } from "./chart.js";
import { FACTS, address, ask, attempt, badge, breakable, factCell, listen, remember, state, step } from "./explorer.js";

const TILE = 4096, WIDEST = 4 ** 12;

class Tiles {
  // samples and their extremes in pieces, fetched where they are looked at; coarser ones stand in until they are there
  constructor(row, loaded) { Object.assign(this, { row, loaded, pieces: new Map() }); }
  width(span, columns) {
    let width = 1;
    while (width * columns * 2 < span * this.row.rate && width < WIDEST) width *= 4;
    return width;
  }
  piece(width, number, isWanted) {
    const key = `${width}/${number}`;
    const known = this.pieces.get(key);
    if (known) return known.values;
    if (!isWanted || number < 0 || number * TILE * width >= this.row.samples) return null;
    const piece = { values: null };
    this.pieces.set(key, piece);
    if (this.pieces.size > 400) this.pieces.delete([...this.pieces.keys()][10]);
    ask("samples", { name: this.row.name, width, start: number * TILE, count: TILE }).then((values) => { piece.values = values; this.loaded(); }, (error) => say(error.message));
    return null;
  }
  columns(channel, low, high, columns) {
    const width = this.width(high - low, columns), length = width / this.row.rate;
    const first = Math.max(0, Math.floor(low / length)), last = Math.min(Math.ceil(this.row.samples / width) - 1, Math.ceil(high / length));
    const each = Math.max(1, Math.floor((last - first + 1) / columns)), points = [];
    this.piece(width, Math.floor(first / TILE) - 1, true); // those beside it, before somebody gets there
    this.piece(width, Math.floor(last / TILE) + 1, true);
    let number = -1, values = null, offset = 0;
    for (let bin = first - (first % each); bin <= last; bin += each) {
      let least = Infinity, most = -Infinity;
      for (let n = bin; n < bin + each && n <= last; n++) {
        if (Math.floor(n / TILE) !== number) {
          number = Math.floor(n / TILE);
          values = this.piece(width, number, true);
          offset = values ? (channel * values.length) / this.row.channels.length : 0;
        }
        const at = offset + 2 * (n % TILE), pair = values ? null : this.bin(channel, width, n);
        const a = pair ? pair[0] : values[at], b = pair ? pair[1] : values[at + 1];
        if (a < least) least = a;
        if (b > most) most = b;
      }
      if (most >= least) points.push((bin + each / 2) * length - (width === 1 ? length / 2 : 0), least, most);
    }
    return points;
  }
  bin(channel, width, number, isWanted = true) {
    const values = this.piece(width, Math.floor(number / TILE), isWanted);
    if (values) {
      const count = values.length / this.row.channels.length / 2, at = 2 * (channel * count + (number % TILE));
      return [values[at], values[at + 1]];
    }
    const coarser = width * 4;
    return coarser > WIDEST ? [NaN, NaN] : this.bin(channel, coarser, Math.floor((number * width) / coarser), false);
  }
}

class Sound {
  // one channel through the loudspeaker, slower or faster
  async toggle(row, channel, [low, high], rate, ended) {
    if (this.source) return this.stop();
    const start = Math.max(0, Math.floor(low * row.rate)), count = Math.min(Math.ceil((high - low) * row.rate), row.samples - start, 4e6);
    const values = await ask("samples", { name: row.name, start, count, channel });
    const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
    const most = values.reduce((peak, value) => Math.max(peak, Math.abs(value - mean)), 0) || 1;
    this.context ??= new AudioContext();
    const whole = Math.min(Math.max(row.rate, 3000), 192000); // what browsers take
    const buffer = this.context.createBuffer(1, values.length, whole);
    buffer.copyToChannel(values.map((value) => (0.9 * (value - mean)) / most), 0);
    this.source = new AudioBufferSourceNode(this.context, { buffer, playbackRate: (rate * row.rate) / whole });
    this.source.onended = () => { this.source = null; ended(); };
    this.source.connect(this.context.destination);
    await this.context.resume();
    this.source.start();
  }
  stop() { this.source?.stop(); }
}

const SHADES = [[18, 12, 60], [90, 20, 110], [180, 50, 90], [235, 110, 50], [252, 200, 60], [252, 255, 180]]; // even in lightness
const shade = (share) => {
  const place = Math.min(share, 0.9999) * (SHADES.length - 1), n = Math.floor(place);
  return SHADES[n].map((value, part) => value + (SHADES[n + 1][part] - value) * (place - n));
};

export async function recordingRoom(place, values) {
  const name = values.name;
  let row = state.rows.get(name);
  if (!row) throw new Error(`There is no recording ${name}; choose one in the table.`);
  const chosen = { kind: "amplitude", healthy: "band", map: "time", pistons: "7", channels: "", speed: "1", ...JSON.parse(localStorage.getItem("view") ?? "{}"), ...values };
  const keep = () => {
    const { kind, healthy, map, pistons, bodies, ratio, channels } = chosen;
    localStorage.setItem("view", JSON.stringify({ kind, healthy, map, pistons, bodies, ratio, channels }));
    remember("recording", Object.fromEntries(Object.entries({ name, kind, healthy, map, pistons, bodies, ratio, channels, from: chosen.from, to: chosen.to, low: chosen.low, high: chosen.high }).filter(([key, value]) => value || key === "healthy")));
  };
  const title = h("h1"), facts = h("dl", { class: "facts" }), remarks = h("div");
  const holders = Object.fromEntries(["wave", "level", "spectrum", "envelope", "map"].map((key) => [key, h("section", { "aria-label": key })]));
  const sound = new Sound();
  const play = h("button", { class: "primary", onclick: () => listenTo() }, "▶ Play");

  function head() {
    row = state.rows.get(name) ?? row;
    const [before, after] = [step(name, -1), step(name, 1)];
    title.replaceChildren(row.id ?? name, " ", badge(row));
    facts.replaceChildren(...Object.entries(FACTS).map(([fact, words]) => h("div", {}, h("dt", {}, words), h("dd", {}, factCell(row, fact)))),
      ...(row.samples ? [["Length", `${short(row.duration, 4)} s`], ["Rate", `${short(row.rate, 6)} Hz`], ["File", breakable(row.file ?? "—")]] : []).map(([words, text]) => h("div", {}, h("dt", {}, words), h("dd", {}, text))));
    remarks.replaceChildren(...(row.findings.length ? [h("ul", {}, row.findings.map((finding) => h("li", {}, `${finding.channel ? `${finding.channel}: ` : ""}${finding.message}`)))] : []));
    crumbs.replaceChildren(h("a", { href: "#recordings" }, "Recordings"), " › ", h("a", { href: address("recording", { name: before }), rel: "prev" }, "← previous"), " ", h("a", { href: address("recording", { name: after }), rel: "next" }, "next →"),
      ` · class keys: ${(state.classes ?? []).slice(0, 9).map((label, n) => `${n + 1} ${label}`).join(", ")}`);
  }
  const crumbs = h("nav", { class: "crumbs", "aria-label": "Path" });
  const propose = h("button", { class: "small", onclick: () => attempt(async () => {
    const pistons = chosen.pistons || 7;
    const speed = await ask("speed", { name, pistons });
    proposal.replaceChildren(`The lines of ${pistons} pistons are those of ${short(speed.rpm, 5)} rpm (${Math.round(100 * speed.clarity)} % clear). `,
      state.editable ? h("button", { class: "small", onclick: () => { proposal.replaceChildren(); import("./explorer.js").then(({ change }) => change([name], "speed", `${short(speed.rpm, 5)} rpm`)); } }, "Take it over") : "");
  }, proposal) }, "Speed from the lines");
  const proposal = h("span", { role: "status" });
  head();
  place.append(crumbs, title, remarks, facts, h("p", { class: "row tight" }, propose, proposal));
  if (!row.samples) return { update: () => { const wasEmpty = !row.samples; head(); if (wasEmpty && row.samples) location.reload(); }, keys: move };

  const isShown = (channel) => !chosen.channels || chosen.channels.split(",").includes(String(channel));
  const shownChannels = () => row.channels.map((_, n) => n).filter(isShown);
  const boxes = row.channels.map((channel, n) => h("label", { class: `key line-${n % 6}` }, h("input", { type: "checkbox", checked: isShown(n), onchange: () => {
    chosen.channels = boxes.map((box, k) => (box.firstChild.checked ? k : "")).filter((k) => k !== "").join(",");
    if (shownChannels().length === row.channels.length) chosen.channels = "";
    refresh();
  } }), ` ${channel}`));
  const field = (key, words, size) => h("label", {}, words, " ", h("input", { value: chosen[key] ?? "", size, inputMode: "decimal", onchange: (event) => { chosen[key] = event.target.value.trim(); refresh(); } }));
  place.append(h("div", { class: "row tight" }, boxes,
    choose("Speed of sound", [["0.1", "a tenth"], ["0.25", "a quarter"], ["0.5", "half"], ["1", "as it was"], ["2", "double"], ["4", "fourfold"]], chosen.speed, (value) => { chosen.speed = value; }), play),
  holders.wave, holders.level,
  h("div", { class: "row tight" },
    choose("Spectrum over", [["amplitude", "frequency"], ["order", "orders of the shaft"]], chosen.kind, (value) => { chosen.kind = value; refresh(); }),
    choose("Healthy ones", [["", "not shown"], ["band", "as a band"], ["difference", "difference in dB"]], chosen.healthy, (value) => { chosen.healthy = value; refresh(); }),
    field("pistons", "Pistons", 3), field("bodies", "Rolling bodies", 3), field("ratio", "Ball over pitch ⌀", 5)),
  holders.spectrum, holders.envelope,
  h("div", { class: "row tight" }, choose("Map over", [["time", "frequency"], ["orders", "orders of the shaft"]], chosen.map, (value) => { chosen.map = value; keep(); drawMap(); })), holders.map);

  const colored = (channels, text, step) => channelLines(channels, text, step).filter((line) => isShown(line.color));
  const show = (holder, chart) => { holder.replaceChildren(chart.element); return chart; };
  let wave = null;
  const tiles = new Tiles(row, () => wave?.request());

  function drawWave() {
    const series = shownChannels().map((n) => ({ name: row.channels[n], color: n, columns: (low, high, count) => tiles.columns(n, low, high, count), at: (x) => tiles.bin(n, tiles.width(wave.view[1] - wave.view[0], wave.width), Math.round((x * row.rate) / tiles.width(wave.view[1] - wave.view[0], wave.width)), false)[1] }));
    const view = wave?.view ?? (chosen.from && chosen.to ? [Number(chosen.from), Number(chosen.to)] : [0, row.duration]);
    wave = show(holders.wave, new Chart({ title: "Waveform", x: "s", y: row.unit, unit: row.unit, limits: [0, row.duration], view, series, onmove: ([low, high]) => {
      [chosen.from, chosen.to] = high - low < row.duration * 0.999 ? [low.toPrecision(6), high.toPrecision(6)] : ["", ""];
      clearTimeout(drawWave.timer);
      drawWave.timer = setTimeout(keep, 300);
    } }));
    holders.wave.chart = wave;
  }
  async function drawLevel() {
    const level = await ask("rms", { name });
    show(holders.level, new Chart({ title: "Level against time (RMS)", x: "s", y: level.unit, unit: level.unit, height: 150, limits: [0, row.duration], series: colored(row.channels, level.amplitude, level.step) }));
  }
  const details = () => ({ name, pistons: chosen.pistons, bodies: chosen.bodies, ratio: chosen.ratio, healthy: chosen.healthy ? "true" : "" });
  async function drawSpectrum() {
    const spectrum = await ask("spectrum", { ...details(), kind: chosen.kind });
    const isOrder = chosen.kind === "order", end = spectrum.step * spectrum.lines;
    const options = { x: isOrder ? "order" : "Hz", shaft: isOrder ? null : spectrum.shaft, limits: [0, end], marks: spectrum.marks, unit: spectrum.unit, log: true, y: spectrum.unit };
    let series = colored(spectrum.channels, spectrum.amplitude, spectrum.step), note = "Drag to move, Shift and drag to zoom.";
    if (chosen.healthy && spectrum.healthy?.length) {
      note = `Bands and differences are of ${spectrum.healthy.length} healthy recording${spectrum.healthy.length > 1 ? "s" : ""} of the same machine and point.`;
      const middle = colored(spectrum.channels, spectrum.middle, spectrum.step);
      if (chosen.healthy === "difference") {
        series = series.map((line, n) => new Lines(line.step, line.values.map((value, k) => 20 * Math.log10(value / middle[n].values[k])), line));
        Object.assign(options, { log: false, unit: "dB", y: "dB over healthy" });
      } else {
        const [low, high] = ["low", "high"].map((key) => colored(spectrum.channels, spectrum[key], spectrum.step));
        options.areas = low.map((line, n) => ({ low: line, high: high[n] }));
      }
    } else if (chosen.healthy) note = "No healthy recording of the same machine and point to compare with.";
    const chart = show(holders.spectrum, new Chart({ title: isOrder ? "Order spectrum" : "Spectrum", series, ...options, onband: isOrder ? null : (low, high) => { Object.assign(chosen, { low: low.toFixed(0), high: high.toFixed(0) }); keep(); draw("envelope", drawEnvelope); } }));
    holders.spectrum.append(h("p", { class: "soft" }, note));
    if (end > 0) chart.show([0, isOrder ? Math.min(end, 80) : Math.min(end, 5000)]);
  }
  async function drawEnvelope() {
    const spectrum = await ask("spectrum", { ...details(), kind: "envelope", healthy: "", low: chosen.low, high: chosen.high });
    const bands = shownChannels().map((n) => spectrum.bands[n].map((edge) => short(edge, 4)).join("–"));
    const end = spectrum.step * spectrum.lines;
    const words = `Envelope spectrum of ${[...new Set(bands)].join(", ")} Hz`;
    const chart = show(holders.envelope, new Chart({ title: words, x: "Hz", y: spectrum.unit, unit: spectrum.unit, log: true, shaft: spectrum.shaft, limits: [0, end], marks: spectrum.marks, series: colored(spectrum.channels, spectrum.amplitude, spectrum.step) }));
    chart.show([0, Math.min(end, Math.max(500, 30 * (spectrum.shaft ?? 0)))]);
    holders.envelope.append(h("p", { class: "soft" }, chosen.low ? "" : "The kurtogram chose the band. ", "“Band” on the spectrum above lets you drag another. ",
      chosen.low ? h("button", { class: "small", onclick: () => { Object.assign(chosen, { low: "", high: "" }); keep(); draw("envelope", drawEnvelope); } }, "The kurtogram's band") : ""));
  }
  async function drawMap() {
    const channel = shownChannels()[0] ?? 0;
    await attempt(async () => {
      const map = await ask("waterfall", { name, channel, orders: chosen.map === "orders" });
      const shades = Uint8Array.from(atob(map.shades), (letter) => letter.charCodeAt(0));
      const canvas = h("canvas", { width: map.frames, height: map.bands }), context = canvas.getContext("2d"), picture = context.createImageData(map.frames, map.bands);
      for (let frame = 0; frame < map.frames; frame++) {
        for (let band = 0; band < map.bands; band++) picture.data.set([...shade(shades[frame * map.bands + band] / 255), 255], 4 * ((map.bands - 1 - band) * map.frames + frame));
      }
      context.putImageData(picture, 0, 0);
      const isOrder = chosen.map === "orders";
      const words = (x, y) => {
        const frame = Math.min(map.frames - 1, Math.floor((x / map.end) * map.frames)), band = Math.min(map.bands - 1, Math.max(0, Math.floor((y / map.high) * map.bands)));
        const value = 10 ** ((map.top - map.range * (1 - shades[frame * map.bands + band] / 255)) / 20);
        return `${short(y, 4)} ${isOrder ? "×" : "Hz"}: ${inUnits(value, map.unit)}, ${decibel(value, map.unit)}`;
      };
      show(holders.map, new Chart({ title: `${isOrder ? "Order map" : "Waterfall"} of ${row.channels[channel]}`, x: isOrder ? "turns" : "s", y: isOrder ? "order" : "Hz", height: 320, limits: [0, map.end], image: { canvas, x: map.end, y: map.high, words } }));
    }, holders.map);
  }
  const draw = (key, work) => attempt(work, holders[key]);
  function refresh() {
    keep();
    drawWave();
    draw("spectrum", drawSpectrum);
    draw("envelope", drawEnvelope);
    draw("level", drawLevel);
    drawMap();
  }
  function listenTo() {
    const isPlaying = Boolean(sound.source);
    play.textContent = isPlaying ? "▶ Play" : "■ Stop";
    return attempt(() => sound.toggle(row, shownChannels()[0] ?? 0, wave.view, Number(chosen.speed), () => { play.textContent = "▶ Play"; }));
  }
  function move(event) {
    const moves = { j: 1, n: 1, ArrowDown: 1, k: -1, ArrowUp: -1 };
    if (moves[event.key]) location.hash = address("recording", { name: step(name, moves[event.key]) });
    else if (event.key === " " || event.key === "p") listenTo();
    else if (event.key === "Escape") location.hash = "recordings";
    else return listen(row, event.key);
    return true;
  }
  refresh();
  return { update: head, keys: move, leave: () => sound.stop() };
}
