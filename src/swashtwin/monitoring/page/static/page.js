"use strict";
// Times in the reader's zone, figures to zoom, and regions that follow the history without a reload.

const root = document.documentElement;

function showTimes(part) {
  const format = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium", timeStyle: "medium" });
  for (const time of part.querySelectorAll("time[datetime]")) {
    time.title = time.textContent;
    time.textContent = format.format(new Date(time.dateTime));
  }
}

const percent = (share) => `${100 * share}%`;
const windows = {}; // what part of a figure is shown, by the name of its region

function axisOf(drawing, name) {
  const [low, high] = drawing.dataset[name].split(" ").map(Number);
  return { low, high, kind: drawing.dataset[`${name}Kind`] };
}

function ticksOf({ low, high, kind }, most) {
  // round values of a part of a horizontal axis, times in the reader's zone
  const span = high - low;
  const minutes = [1 / 60, 1, 5, 15, 60, 180, 360, 720, 1440, 2880, 10080, 20160, 43200, 131040, 525600];
  const power = 10 ** Math.floor(Math.log10(span / most));
  const steps = kind === "time" ? minutes.map((count) => 60 * count) : [1, 2, 5, 10, 20].map((factor) => factor * power);
  const step = steps.find((length) => span / length <= most) ?? steps.at(-1);
  const zone = kind === "time" ? 60 * new Date(1000 * low).getTimezoneOffset() : 0;
  const style = step < 86400 ? { hour: "2-digit", minute: "2-digit" } : { month: "short", day: "numeric" };
  const words = new Intl.DateTimeFormat(root.lang, style);
  const ticks = [];
  for (let value = Math.ceil((low - zone) / step) * step + zone; value <= high; value += step) {
    const text = kind === "time" ? words.format(new Date(1000 * value)) : String(Number(value.toPrecision(6)));
    ticks.push([(value - low) / span, text]);
  }
  return ticks;
}

function showPart(drawing, [start, end]) {
  const field = drawing.querySelector(".field");
  const height = field.viewBox.baseVal.height;
  field.setAttribute("viewBox", `${1000 * start} 0 ${1000 * (end - start)} ${height}`);
  for (const name of drawing.querySelectorAll("[data-share]")) {
    const share = (name.dataset.share - start) / (end - start);
    name.setAttribute("x", percent(share));
    name.setAttribute("visibility", share < 0 || share > 1 ? "hidden" : "visible");
  }
  for (const tick of drawing.querySelectorAll(".tick")) tick.remove();
  const { low, high, kind } = axisOf(drawing, "x");
  const part = { low: low + start * (high - low), high: low + end * (high - low), kind };
  for (const [share, text] of ticksOf(part, Math.min(6, Math.max(2, drawing.clientWidth / 90)))) {
    if (share < 0.02 || share > 0.98) continue; // its text would be cut off
    const tick = document.createElementNS(drawing.namespaceURI, "text");
    tick.setAttribute("class", "tick");
    tick.setAttribute("x", percent(share));
    tick.setAttribute("y", drawing.getAttribute("height") - 6);
    tick.textContent = text;
    drawing.append(tick);
  }
}

function wordsAt(drawing, x, y) {
  // the values of a point, of which the shares are known
  const [across, up] = [axisOf(drawing, "x"), axisOf(drawing, "y")];
  const place = across.low + x * (across.high - across.low);
  const height = up.low + y * (up.high - up.low);
  const value = Number((up.kind === "log" ? 10 ** height : height).toPrecision(3));
  const order = drawing.dataset.shaft ? ` (${(place / drawing.dataset.shaft).toFixed(2)}×)` : "";
  const format = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium", timeStyle: "short" });
  const where = across.kind === "time" ? format.format(new Date(1000 * place)) : `${place.toFixed(0)} Hz${order}`;
  return `${where}: ${value} ${drawing.dataset.unit}`;
}

function follows(figure) {
  // zoom by dragging, back by a double click, values at the pointer, and a recording by a click on its point
  const name = figure.closest("[data-region]").dataset.region;
  const drawings = [...figure.querySelectorAll(".drawing")];
  const tip = figure.querySelector(".tip");
  let from = null;
  const show = (part) => {
    windows[name] = part;
    for (const drawing of drawings) showPart(drawing, part);
  };
  show(windows[name] ?? [0, 1]);
  for (const drawing of drawings) {
    const field = drawing.querySelector(".field");
    const numbers = (field.querySelector(".main").getAttribute("d").match(/[\d.-]+/g) ?? []).map(Number);
    const points = Array.from({ length: numbers.length / 2 }, (_, n) => [numbers[2 * n] / 1000, numbers[2 * n + 1]]);
    const height = field.viewBox.baseVal.height;
    const shareAt = (event) => {
      const box = drawing.getBoundingClientRect();
      const [start, end] = windows[name];
      return start + ((end - start) * Math.min(Math.max(event.clientX - box.left, 0), box.width)) / box.width;
    };
    const nearest = (event) => {
      const share = shareAt(event);
      let best = 0;
      points.forEach(([x], n) => { if (Math.abs(x - share) < Math.abs(points[best][0] - share)) best = n; });
      return best;
    };
    drawing.addEventListener("pointermove", (event) => {
      if (points.length) {
        const [x, y] = points[nearest(event)];
        tip.textContent = wordsAt(drawing, x, 1 - y / height);
      }
    });
    drawing.addEventListener("pointerleave", () => { tip.textContent = ""; });
    drawing.addEventListener("pointerdown", (event) => { from = [shareAt(event), event.clientX]; });
    drawing.addEventListener("pointerup", (event) => {
      if (from === null || event.pointerType === "touch") return;
      const [start, end] = [from[0], shareAt(event)].sort((a, b) => a - b);
      const ids = drawing.dataset.ids?.split(" ") ?? [];
      if (Math.abs(event.clientX - from[1]) > 8) show([start, Math.max(end, start + 1e-3)]);
      else if (event.detail < 2 && ids[nearest(event)] && event.target.matches(".dots")) location.href = `/recordings/${ids[nearest(event)]}`;
      from = null;
    });
    drawing.addEventListener("dblclick", () => show([0, 1]));
  }
}

const showFigures = (part) => {
  for (const figure of part.querySelectorAll("figure.chart")) follows(figure);
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
  showFigures(region);
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
showFigures(document);
follow();
