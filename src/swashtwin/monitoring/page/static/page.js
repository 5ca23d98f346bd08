"use strict";
// Times in the reader's zone, figures in the page's colors, and regions that follow the history without a reload.

const root = document.documentElement;
const color = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();

function showTimes(part) {
  const format = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium", timeStyle: "medium" });
  for (const time of part.querySelectorAll("time[datetime]")) {
    time.title = time.textContent;
    time.textContent = format.format(new Date(time.dateTime));
  }
}

function localTime(text) {
  // plotly draws times as they are written, so write them in the reader's zone
  const time = new Date(text);
  return new Date(time - time.getTimezoneOffset() * 60000).toISOString().slice(0, -1);
}

const isTime = (value) => typeof value === "string" && /^\d{4}-\d\d-\d\dT/.test(value);
const local = (value) => (isTime(value) ? localTime(value) : value);

function paint(figure) {
  const colors = { main: "main", alarm: "red", sensor: "violet", median: "median", mark: "mark" };
  for (const trace of figure.data) {
    const role = trace.meta.role;
    trace.x = trace.x.map(local);
    if (role === "band") Object.assign(trace, { fillcolor: color("band"), line: { width: 0, color: color("median") } });
    if (role === "main") {
      trace.line = { ...trace.line, color: color("main") };
      trace.marker = { ...trace.marker, color: color("main") };
      if (trace.error_y) trace.error_y.color = color("soft");
    }
  }
  for (const shape of figure.layout.shapes || []) {
    shape.line.color = color(colors[shape.name]);
    shape.x0 = local(shape.x0);
    shape.x1 = local(shape.x1);
  }
  const ink = color("ink");
  const layout = { ...figure.layout, autosize: true, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)" };
  layout.font = { color: ink, size: 12, family: getComputedStyle(document.body).fontFamily };
  const top = layout.annotations?.length ? 24 : 8;
  layout.margin = { l: 62, r: 14, t: layout.showlegend ? top + 26 : top + 8, b: 44 };
  layout.legend = { orientation: "h", x: 0, y: 1, yanchor: "top", yref: "container", bgcolor: "rgba(0,0,0,0)" };
  layout.hovermode = "closest";
  layout.dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom";
  layout.hoverlabel = { bgcolor: color("card"), bordercolor: color("line"), font: { color: ink } };
  layout.uirevision = "same";
  for (const name of Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key))) {
    layout[name] = { ...layout[name], gridcolor: color("grid"), linecolor: color("line"), zerolinecolor: color("grid"), automargin: true };
  }
  return layout;
}

function thinMarks(figure, width) {
  // names of lines that would overlap are left out, that of the shaft first
  const [shaft, ...pistons] = figure.layout.annotations || [];
  const end = figure.layout.xaxis.range?.[1];
  const shown = [];
  for (const mark of [...pistons, shaft].filter(Boolean)) {
    if (shown.every((other) => (Math.abs(other.x - mark.x) / end) * width >= 34)) shown.push(mark);
  }
  figure.layout.annotations = shown;
}

async function draw(holder) {
  const plot = holder.querySelector(".plot");
  try {
    const answer = await fetch(holder.dataset.figure, { headers: { accept: "application/json" } });
    if (answer.status === 404) holder.hidden = true; // a dead channel has no spectrum
    if (!answer.ok) return;
    const figure = await answer.json();
    thinMarks(figure, plot.clientWidth - 76);
    const layout = paint(figure);
    const config = { displayModeBar: false, responsive: true, locale: root.lang, scrollZoom: false };
    await Plotly.react(plot, figure.data, layout, config);
    if (!holder.dataset.ready) {
      plot.on("plotly_click", (event) => {
        const identity = event.points[0].customdata;
        if (Number.isInteger(identity)) location.href = `/recordings/${identity}`;
      });
    }
    holder.dataset.ready = "yes";
  } catch (error) {
    if (!(error instanceof TypeError)) throw error; // no connection: the next change tries again
  }
}

const drawAll = () => {
  if (window.Plotly) for (const holder of document.querySelectorAll("[data-figure]")) draw(holder);
};

function replaceRegion(region, fresh) {
  const active = document.activeElement;
  const isInside = region.contains(active);
  if (isInside && active.matches("input, select, textarea")) return; // somebody types there
  if (region.dataset.source === fresh.innerHTML) return;
  const links = "a, button, summary, [tabindex]";
  const place = isInside ? [...region.querySelectorAll(links)].indexOf(active) : -1;
  region.dataset.source = fresh.innerHTML;
  region.replaceChildren(...fresh.childNodes);
  showTimes(region);
  if (place >= 0) region.querySelectorAll(links)[place]?.focus({ preventScroll: true });
}

async function refresh() {
  const answer = await fetch(location.href, { headers: { accept: "text/html" } });
  if (answer.redirected) return location.reload(); // the login ended
  if (!answer.ok) return;
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const region of document.querySelectorAll("[data-region]")) {
    const other = fresh.querySelector(`[data-region="${region.dataset.region}"]`);
    if (other) replaceRegion(region, other);
  }
  drawAll();
}

async function follow() {
  // asks for the history's number, and loads the regions anew when it has changed
  const light = document.getElementById("live");
  if (!light) return;
  let last = null;
  while (true) {
    const answer = await fetch("/api/sequence").catch(() => null);
    if (answer?.status === 401) return location.reload(); // the login ended
    light.className = `live ${answer?.ok ? "on" : "off"}`;
    const text = answer?.ok ? document.body.dataset.connected : document.body.dataset.lost;
    if (light.textContent !== text) light.textContent = text;
    if (answer?.ok) {
      const number = await answer.text();
      const isShown = last === null || number === last || (await refresh().then(() => true, () => false));
      if (isShown) last = number;
    }
    await new Promise((done) => setTimeout(done, document.hidden ? 10000 : 1000));
  }
}

for (const region of document.querySelectorAll("[data-region]")) region.dataset.source = region.innerHTML;
showTimes(document);
drawAll();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
follow();
