/**
 * The script of the watch's page: times in the reader's zone, figures to zoom, and regions that
 * follow the history without a reload.
 */

/**
 * @typedef {[number, number]} Part Shares of a figure's width, from 0 to 1.
 * @typedef {{low: number, high: number, kind: string}} Axis Its kind is empty, "log" or "time".
 */

const root = document.documentElement;

/** @type {Record<string, Part>} shown parts of figures, by the name of their region */
const shownParts = {};

const MINUTE_S = 60;
const DAY_S = 86400;
/** Distances of marked times [s]. */
const TIME_STEPS_S = [
  1,
  ...[1, 5, 15, 60, 180, 360, 720].map((count) => count * MINUTE_S),
  ...[1, 2, 7, 14, 30, 91, 365].map((count) => count * DAY_S),
];
const FIELD_WIDTH = 1000;
/** Width of a tick's text [px], and share of the width at both ends where it would be cut off. */
const TICK_WIDTH = 90;
const TICK_MARGIN = 0.02;
const MAX_TICKS = 6;
const MIN_PART = 1e-3;
/** Distance of a drag that is not a click [px]. */
const MIN_DRAG = 8;
const POLL_MS = 1000;
const HIDDEN_POLL_MS = 10000;
const FOCUSABLE = "a, button, summary, [tabindex]";

/**
 * Show times in the reader's zone; the title keeps them in UTC.
 *
 * @param {ParentNode} part
 */
function showTimes(part) {
  const dayFormat = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium" });
  const format = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium", timeStyle: "medium" });
  for (const time of part.querySelectorAll("time")) {
    time.title = time.textContent;
    const shownFormat = time.classList.contains("day") ? dayFormat : format;
    time.textContent = shownFormat.format(new Date(time.dateTime));
  }
}

/**
 * @param {any} drawing
 * @param {string} name
 * @returns {Axis}
 */
function axisOf(drawing, name) {
  const [low, high] = drawing.dataset[name].split(" ").map(Number);
  return { low, high, kind: drawing.dataset[`${name}Kind`] };
}

/**
 * Return round values of a horizontal axis, as shares of it with their texts.
 *
 * @param {Axis} axis
 * @param {number} maxCount
 * @returns {[number, string][]}
 */
function ticksOf({ low, high, kind }, maxCount) {
  const isTime = kind === "time";
  const step = isTime ? timeStep(high - low, maxCount) : roundStep(high - low, maxCount);
  // Times are round in the reader's zone.
  const zone = isTime ? MINUTE_S * new Date(1000 * low).getTimezoneOffset() : 0;
  const first = Math.ceil((low - zone) / step) * step + zone;
  const format = isTime ? timeFormat(step) : formatNumber;

  /** @type {[number, string][]} */
  const ticks = [];
  for (let value = first; value <= high; value += step) {
    ticks.push([(value - low) / (high - low), format(value)]);
  }
  return ticks;
}

/**
 * @param {number} span
 * @param {number} maxCount
 */
function timeStep(span, maxCount) {
  return TIME_STEPS_S.find((step) => span / step <= maxCount) ?? TIME_STEPS_S.at(-1);
}

/**
 * @param {number} span
 * @param {number} maxCount
 */
function roundStep(span, maxCount) {
  const power = 10 ** Math.floor(Math.log10(span / maxCount));
  const steps = [1, 2, 5, 10, 20].map((factor) => factor * power);
  return steps.find((step) => span / step <= maxCount) ?? steps.at(-1);
}

/**
 * @param {number} step
 * @returns {(seconds: number) => string}
 */
function timeFormat(step) {
  const format = new Intl.DateTimeFormat(
    root.lang,
    step < DAY_S ? { hour: "2-digit", minute: "2-digit" } : { month: "short", day: "numeric" },
  );
  return (seconds) => format.format(new Date(1000 * seconds));
}

/** @param {number} value */
function formatNumber(value) {
  return String(Number(value.toPrecision(6)));
}

/**
 * Show a part of a drawing.
 *
 * @param {any} drawing
 * @param {Part} part
 */
function showPart(drawing, [start, end]) {
  const field = drawing.querySelector(".field");
  const height = field.viewBox.baseVal.height;
  const width = FIELD_WIDTH * (end - start);
  field.setAttribute("viewBox", `${FIELD_WIDTH * start} 0 ${width} ${height}`);

  for (const name of drawing.querySelectorAll("[data-share]")) {
    const share = (name.dataset.share - start) / (end - start);
    name.setAttribute("x", `${100 * share}%`);
    name.setAttribute("visibility", share < 0 || share > 1 ? "hidden" : "visible");
  }
  showTicks(drawing, [start, end]);
}

/**
 * Replace the texts of the horizontal axis by those of a part.
 *
 * @param {any} drawing
 * @param {Part} part
 */
function showTicks(drawing, [start, end]) {
  for (const tick of drawing.querySelectorAll(".tick")) tick.remove();

  const { low, high, kind } = axisOf(drawing, "x");
  const span = high - low;
  const axis = { low: low + start * span, high: low + end * span, kind };
  const maxCount = Math.min(MAX_TICKS, Math.max(2, drawing.clientWidth / TICK_WIDTH));
  for (const [share, text] of ticksOf(axis, maxCount)) {
    if (share < TICK_MARGIN || share > 1 - TICK_MARGIN) continue;
    const tick = document.createElementNS(drawing.namespaceURI, "text");
    tick.setAttribute("class", "tick");
    tick.setAttribute("x", `${100 * share}%`);
    tick.setAttribute("y", String(drawing.getAttribute("height") - 6));
    tick.textContent = text;
    drawing.append(tick);
  }
}

/**
 * Return the values of a point of a drawing.
 *
 * @param {any} drawing
 * @param {number} xShare
 * @param {number} yShare
 */
function describePoint(drawing, xShare, yShare) {
  const x = axisOf(drawing, "x");
  const y = axisOf(drawing, "y");
  const position = x.low + xShare * (x.high - x.low);
  const height = y.low + yShare * (y.high - y.low);
  const value = Number((y.kind === "log" ? 10 ** height : height).toPrecision(3));
  return `${describePosition(drawing, x, position)}: ${value} ${drawing.dataset.unit}`;
}

/**
 * Return the time and the order at a point of a map.
 *
 * @param {any} drawing
 * @param {number} xShare
 * @param {number} clientY
 */
function describeCell(drawing, xShare, clientY) {
  const x = axisOf(drawing, "x");
  const y = axisOf(drawing, "y");
  const box = drawing.querySelector(".field").getBoundingClientRect();
  const yShare = Math.min(Math.max((box.bottom - clientY) / box.height, 0), 0.999);
  const order = Math.round(y.low + yShare * (y.high - y.low));
  return `${describePosition(drawing, x, x.low + xShare * (x.high - x.low))}: order ${order}`;
}

/**
 * @param {any} drawing
 * @param {Axis} axis
 * @param {number} position
 */
function describePosition(drawing, axis, position) {
  if (axis.kind === "time") {
    const format = new Intl.DateTimeFormat(root.lang, { dateStyle: "medium", timeStyle: "short" });
    return format.format(new Date(1000 * position));
  }
  const { shaft } = drawing.dataset;
  if (axis.kind === "order") {
    return `${position.toFixed(2)}× (${(position * shaft).toFixed(1)} Hz)`;
  }
  const order = shaft ? ` (${(position / shaft).toFixed(2)}×)` : "";
  return `${position.toFixed(0)} Hz${order}`;
}

/**
 * Let the drawings of a figure be zoomed together, and read.
 *
 * @param {any} figure
 */
function activateFigure(figure) {
  const name = figure.closest("[data-region]").dataset.region;
  const drawings = [...figure.querySelectorAll(".drawing")];
  const tip = figure.querySelector(".tip");
  const show = (/** @type {Part} */ part) => {
    shownParts[name] = part;
    for (const drawing of drawings) showPart(drawing, part);
  };
  show(shownParts[name] ?? [0, 1]);
  for (const drawing of drawings) {
    activateDrawing(drawing, tip, () => shownParts[name], show);
  }
}

/**
 * Zoom a drawing by dragging, show all by a double-click, state values at the pointer, and open a
 * recording by a click on its point.
 *
 * @param {any} drawing
 * @param {HTMLElement} tip
 * @param {() => Part} shownPart
 * @param {(part: Part) => void} show
 */
function activateDrawing(drawing, tip, shownPart, show) {
  const points = pointsOf(drawing);
  const height = drawing.querySelector(".field").viewBox.baseVal.height;
  const ids = drawing.dataset.ids?.split(" ") ?? [];
  /** @type {{share: number, pixel: number} | null} */
  let dragStart = null;

  const shareAt = (/** @type {MouseEvent} */ event) => {
    const box = drawing.getBoundingClientRect();
    const [start, end] = shownPart();
    const pixel = Math.min(Math.max(event.clientX - box.left, 0), box.width);
    return start + ((end - start) * pixel) / box.width;
  };

  drawing.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
    if (drawing.dataset.map) {
      tip.textContent = describeCell(drawing, shareAt(event), event.clientY);
      return;
    }
    if (!points.length) return;
    const [x, y] = points[nearestIndex(points, shareAt(event))];
    tip.textContent = describePoint(drawing, x, 1 - y / height);
  });
  drawing.addEventListener("pointerleave", () => {
    tip.textContent = "";
  });
  drawing.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
    dragStart = { share: shareAt(event), pixel: event.clientX };
  });
  drawing.addEventListener("pointerup", (/** @type {any} */ event) => {
    // A finger that moves scrolls the page.
    if (dragStart === null || event.pointerType === "touch") return;
    const share = shareAt(event);
    const isDrag = Math.abs(event.clientX - dragStart.pixel) > MIN_DRAG;
    const id = ids[nearestIndex(points, share)];
    if (isDrag) {
      const [start, end] = [dragStart.share, share].sort((a, b) => a - b);
      show([start, Math.max(end, start + MIN_PART)]);
    } else if (event.detail < 2 && id && event.target.matches(".dots")) {
      location.href = `/recordings/${id}`;
    }
    dragStart = null;
  });
  drawing.addEventListener("dblclick", () => show([0, 1]));
}

/**
 * Return the points of a drawing's line: share of the width, and height [px].
 *
 * @param {any} drawing
 * @returns {[number, number][]}
 */
function pointsOf(drawing) {
  const path = drawing.querySelector(".main")?.getAttribute("d") ?? "";
  const numbers = (path.match(/[\d.-]+/g) ?? []).map(Number);
  /** @type {[number, number][]} */
  const points = [];
  for (let n = 0; n + 1 < numbers.length; n += 2) {
    points.push([numbers[n] / FIELD_WIDTH, numbers[n + 1]]);
  }
  return points;
}

/**
 * @param {[number, number][]} points
 * @param {number} share
 */
function nearestIndex(points, share) {
  let nearest = 0;
  points.forEach(([x], n) => {
    if (Math.abs(x - share) < Math.abs(points[nearest][0] - share)) nearest = n;
  });
  return nearest;
}

/** @param {ParentNode} part */
function activateFigures(part) {
  for (const figure of part.querySelectorAll("figure.chart")) activateFigure(figure);
}

/**
 * Replace the content of a region, unless it is the same or somebody types there.
 *
 * @param {HTMLElement} region
 * @param {Element} fresh
 */
function replaceRegion(region, fresh) {
  const active = document.activeElement;
  const hasFocus = region.contains(active);
  if (hasFocus && active.matches("input, select, textarea")) return;
  if (region.dataset.source === fresh.innerHTML) return;

  const focusedIndex = hasFocus ? [...region.querySelectorAll(FOCUSABLE)].indexOf(active) : -1;
  region.dataset.source = fresh.innerHTML;
  region.replaceChildren(...fresh.childNodes);
  showTimes(region);
  activateFigures(region);
  if (focusedIndex >= 0) {
    const focused = region.querySelectorAll(FOCUSABLE)[focusedIndex];
    /** @type {HTMLElement | undefined} */ (focused)?.focus({ preventScroll: true });
  }
}

/** Load the page again, and replace the regions that changed. */
async function refresh() {
  const answer = await fetch(location.href, { headers: { accept: "text/html" } });
  if (answer.redirected) {
    location.reload(); // the login ended
    return;
  }
  if (!answer.ok) return;

  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const region of regions()) {
    const freshRegion = fresh.querySelector(`[data-region="${region.dataset.region}"]`);
    if (freshRegion) replaceRegion(region, freshRegion);
  }
}

/**
 * Fill a place whose content takes the server some seconds, and run the script of that content.
 *
 * @param {HTMLElement} place
 */
async function fillPlace(place) {
  const note = document.createElement("p");
  note.className = "soft";
  note.textContent = "Simulating the pump with the suspected fault …";
  place.replaceChildren(note);

  const answer = await fetch(place.dataset.content);
  // Without content the pump cannot be simulated, and the page is complete.
  place.innerHTML = answer.status === 200 ? await answer.text() : "";
  if (place.firstElementChild) await import(place.dataset.script);
}

/** @returns {NodeListOf<HTMLElement>} */
function regions() {
  return document.querySelectorAll("[data-region]");
}

/** Poll the number of the history, and refresh the page when it has changed. */
async function followHistory() {
  const light = document.getElementById("live");
  if (!light) return;

  /** @type {string | null} */
  let shownNumber = null;
  while (true) {
    const answer = await fetchSequence();
    if (answer?.status === 401) {
      location.reload(); // the login ended
      return;
    }
    showConnection(light, Boolean(answer?.ok));
    if (answer?.ok) {
      const number = await answer.text();
      const isShown = shownNumber === null || number === shownNumber || (await hasRefreshed());
      // After a failure the same number is tried again.
      if (isShown) shownNumber = number;
    }
    const delay = document.hidden ? HIDDEN_POLL_MS : POLL_MS;
    await new Promise((resolve) => setTimeout(resolve, delay));
  }
}

/**
 * Return the answer with the history's number; null if the server cannot be reached.
 *
 * @returns {Promise<Response | null>}
 */
async function fetchSequence() {
  try {
    return await fetch("/api/sequence");
  } catch {
    return null;
  }
}

/** Refresh the page, and return whether that worked. */
function hasRefreshed() {
  return refresh().then(
    () => true,
    () => false,
  );
}

/**
 * @param {HTMLElement} light
 * @param {boolean} isConnected
 */
function showConnection(light, isConnected) {
  const { connected, lost } = document.body.dataset;
  light.className = `live ${isConnected ? "on" : "off"}`;
  const text = isConnected ? connected : lost;
  // A screen reader announces the text whenever it is set.
  if (light.textContent !== text) light.textContent = text;
}

for (const region of regions()) region.dataset.source = region.innerHTML;
showTimes(document);
activateFigures(document);
for (const place of document.querySelectorAll("[data-content]")) {
  fillPlace(/** @type {HTMLElement} */ (place));
}
followHistory();
