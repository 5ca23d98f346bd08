// Rooms, addresses, keys, and the table of recordings with its facts.
import { h, say, short } from "./chart.js";
import { compareRoom } from "./compare.js";
import { diagnoseRoom } from "./diagnose.js";
import { recordingRoom } from "./recording.js";
import { twinRoom } from "./twin.js";

const main = document.getElementById("main");
const token = document.querySelector("meta[name=token]").content;

export const state = { rows: new Map(), names: [], selected: new Set(), order: [], revision: -1, filter: "", sort: ["state", 1], undo: [] };

export async function ask(path, values = {}) {
  // an answer of the server; an error shows its reason
  const query = new URLSearchParams(Object.entries(values).filter(([, value]) => value !== null && value !== undefined && value !== ""));
  return finish(await fetch(`/api/${path}${path.includes("?") ? "" : `?${query}`}`));
}

export const send = async (path, body, isFile = false) =>
  finish(await fetch(`/api/${path}`, { method: "POST", body: isFile ? body : JSON.stringify(body), headers: { "x-explorer": token, "content-type": isFile ? "application/octet-stream" : "application/json" } }));

async function finish(answer) {
  if (answer.headers.get("content-type")?.startsWith("application/octet")) return new Float32Array(await answer.arrayBuffer());
  const content = await answer.json().catch(() => ({ detail: "The server did not answer; is swashtwin explore still running?" }));
  if (!answer.ok) throw new Error(typeof content.detail === "string" ? content.detail : "A value cannot be.");
  return content;
}

export const attempt = async (work, place = null) => {
  try {
    return await work();
  } catch (error) {
    if (place) place.replaceChildren(h("p", { class: "notice" }, error.message));
    else say(error.message);
    return null;
  }
};

export const address = (room, values = {}) => `#${room}${Object.keys(values).length ? `?${new URLSearchParams(values)}` : ""}`;
export const remember = (room, values) => {
  // a deep link, unless somebody went elsewhere meanwhile
  if (location.hash.startsWith(`#${room}?`) || location.hash === `#${room}`) history.replaceState(null, "", address(room, values));
};

function take(table) {
  const isNew = table.revision !== state.revision;
  for (const row of table.rows) state.rows.set(row.name, row);
  state.names = table.names;
  Object.assign(state, { revision: table.revision, waiting: table.waiting, findings: table.findings, skipped: table.skipped });
  Object.assign(state, { source: table.source, questions: table.questions, editable: table.editable, unwritten: table.unwritten, classes: classesOf() });
  for (const name of state.rows.keys()) if (!table.names.includes(name)) state.rows.delete(name);
  return isNew;
}

const classesOf = () => [...new Set([...state.rows.values()].map((row) => row.label).filter(Boolean))].sort((a, b) => (b === "normal") - (a === "normal") || a.localeCompare(b));

async function poll() {
  const table = await ask("rows", { since: state.revision }).catch(() => null);
  if (table && take(table)) room?.update?.();
  setTimeout(poll, state.waiting ? 500 : 2500);
}

// facts

export const FACTS = { label: "Class", specimen: "Machine", speed: "Speed", pressure: "Pressure", sensitivity: "Sensitivity", unit: "Unit", sample_rate: "Sample rate" };

export async function change(names, fact, value) {
  const changes = names.map((name) => ({ entry: name, fact, previous: state.rows.get(name).specified[fact] ?? null, value: value || null }))
    .filter(({ previous }) => String(previous ?? "") !== String(value ?? ""));
  if (!changes.length) return;
  await write(changes, false);
  say(`${FACTS[fact]} of ${changes.length === 1 ? names[0] : `${changes.length} recordings`}: ${value || "none"}.`);
}

async function write(changes, isUndo) {
  const table = await attempt(() => send("facts", { changes, undo: isUndo }));
  if (!table) return attempt(async () => { take(await ask("rows")); room?.update?.(); });
  take(table);
  if (!isUndo && changes.length) state.undo.push(changes);
  document.getElementById("undo").hidden = !state.undo.length;
  room?.update?.();
}

async function undo() {
  const changes = state.undo.pop();
  if (!changes) return;
  const text = (value) => (Array.isArray(value) ? value.join(", ") : value);
  await write(changes.map(({ entry, fact, previous }) => ({ entry, fact, previous: state.rows.get(entry)?.specified[fact] ?? null, value: text(previous) })), true);
  say("The last change is undone.");
}

export function factCell(row, fact) {
  // a fact that becomes a field when it is clicked; of a selected recording it is that of all selected ones
  const shown = { label: row.label, specimen: row.specimen, speed: row.rpm && `${short(row.rpm, 4)} rpm`, pressure: row.mpa && `${short(row.mpa, 4)} MPa` }[fact];
  const stated = row.specified[fact];
  const text = (Array.isArray(stated) ? stated.join(", ") : stated) ?? shown ?? "";
  if (!state.editable) return text || "—";
  const button = h("button", { class: "cell", title: `Edit ${FACTS[fact].toLowerCase()}`, onclick: (event) => { event.stopPropagation(); edit(); } }, String(shown ?? text) || "—");
  const edit = () => {
    const field = h("input", { "aria-label": FACTS[fact], value: String(text), list: fact === "label" ? "classes" : null, size: 12 });
    const names = state.selected.has(row.name) ? [...state.selected] : [row.name];
    let isDone = false;
    const done = (isKept) => {
      if (isDone) return;
      isDone = true;
      field.replaceWith(button);
      if (isKept && field.value.trim() !== String(text)) change(names, fact, field.value.trim());
    };
    field.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key !== "Enter" && event.key !== "Escape") return;
      event.preventDefault(); // else the button that gets the focus is pressed
      done(event.key === "Enter");
      button.focus();
    });
    field.addEventListener("blur", () => done(true));
    button.replaceWith(field);
    field.focus();
    field.select();
  };
  return button;
}

const worst = (row) => (row.state === "broken" || row.findings.some((finding) => finding.severity === "error") ? 0 : row.findings.some((finding) => finding.severity === "warning") ? 1 : 2);

export function badge(row) {
  const [kind, sign, words] = row.state === "waiting" ? ["learning", "…", "reading"] : [["alarm", "▲", "broken"], ["unusual", "●", "look"], ["normal", "✓", "no finding"]][worst(row)];
  return h("span", { class: `badge ${kind}` }, sign, h("span", { class: "words" }, ` ${words}`));
}

export const breakable = (text) => text.split(/(?<=[_/.-])/).flatMap((part) => [part, h("wbr")]);

export function step(name, by) {
  const order = state.order.length ? state.order : state.names;
  return order[Math.min(Math.max(order.indexOf(name) + by, 0), order.length - 1)];
}

export function listen(row, key) {
  // keys that mean the same for a row of the table and for an opened recording
  const label = state.classes?.[Number(key) - 1];
  if (!label || !row) return false;
  change(state.selected.has(row.name) ? [...state.selected] : [row.name], "label", label);
  return true;
}

// the table

function spark(levels) {
  if (levels.length < 2) return "";
  const most = Math.max(...levels) || 1;
  const path = levels.map((level, n) => `${n ? "L" : "M"}${(100 * n) / (levels.length - 1)} ${(22 - (20 * level) / most).toFixed(1)}`).join("");
  const holder = h("span", { class: "spark" });
  holder.innerHTML = `<svg viewBox="0 0 100 24" preserveAspectRatio="none" role="img" aria-label="Level along the recording"><path class="main" d="${path}"/></svg>`;
  return holder;
}

const reasons = (row) => h("small", { class: "reasons" }, row.findings.map((finding) => `${finding.channel ? `${finding.channel}: ` : ""}${finding.message}`).join(" "));

const COLUMNS = [
  ["state", "State", (row) => worst(row), (row) => badge(row)],
  ["name", "Recording", (row) => row.id ?? row.name, (row) => [h("a", { href: address("recording", { name: row.name }), "aria-label": row.id ?? row.name }, breakable(row.id ?? row.name)), reasons(row)]],
  ["label", "Class", (row) => row.label ?? "", (row) => factCell(row, "label")],
  ["specimen", "Machine", (row) => row.specimen ?? "", (row) => factCell(row, "specimen")],
  ["rpm", "Speed", (row) => row.rpm ?? -1, (row) => factCell(row, "speed")],
  ["mpa", "Pressure", (row) => row.mpa ?? -1, (row) => factCell(row, "pressure")],
  ["duration", "Length", (row) => row.duration ?? -1, (row) => (row.duration ? `${short(row.duration)} s` : "—")],
  ["level", "Level", (row) => Math.max(0, ...row.rms), (row) => spark(row.rms)],
];
const MORE = ["sensitivity", "unit", "sample_rate"].map((fact) => [fact, FACTS[fact], (row) => String(row.specified[fact] ?? ""), (row) => factCell(row, fact)]);

function recordingsRoom(place, values) {
  state.filter = values.filter ?? state.filter;
  let current = state.current ?? null, columns = COLUMNS;
  const body = h("tbody"), head = h("tr"), summary = h("div"), count = h("span", { class: "soft", role: "status" });
  const filter = h("input", { type: "search", class: "wide", value: state.filter, placeholder: "Filter: words of any column", "aria-label": "Filter", oninput: () => { state.filter = filter.value; remember("recordings", state.filter ? { filter: state.filter } : {}); update(); } });
  const facts = h("button", { "aria-pressed": false, onclick: () => { columns = columns === COLUMNS ? [...COLUMNS, ...MORE] : COLUMNS; facts.setAttribute("aria-pressed", columns !== COLUMNS); update(true); } }, "All facts");
  const compare = h("button", { onclick: () => { location.hash = address("compare", { a: [...state.selected].join("|") }); } }, "Compare selected");
  place.append(h("h1", {}, "Recordings"), summary, h("div", { class: "row" }, filter, facts, compare, count),
    h("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": "Table of recordings" }, h("table", { class: "recordings" }, h("thead", {}, head), body)),
    h("datalist", { id: "classes" }));
  const cells = new Map(); // rows that are shown, by name

  function update(isWhole = false) {
    const words = state.filter.toLowerCase().split(/\s+/).filter(Boolean);
    const [key, sign] = state.sort, of = columns.find(([name]) => name === key)?.[2] ?? COLUMNS[0][2];
    const compareRows = (a, b) => { const [x, y] = [of(a), of(b)]; return sign * (typeof x === "number" ? x - y : x.localeCompare(y, undefined, { numeric: true })); };
    const rows = state.names.map((name) => state.rows.get(name)).filter((row) => {
      const text = `${row.name} ${row.label} ${row.specimen} ${row.rpm && Math.round(row.rpm)} ${row.mpa} ${["broken", "look", "no finding"][worst(row)]} ${row.findings.map((finding) => finding.message).join(" ")}`.toLowerCase();
      return words.every((word) => text.includes(word));
    }).sort(compareRows);
    state.order = rows.map((row) => row.name);
    if (body.contains(document.activeElement) && document.activeElement.matches("input:not([type=checkbox])")) return; // somebody types there
    const isAll = rows.length > 0 && rows.every((row) => state.selected.has(row.name));
    const all = h("input", { type: "checkbox", checked: isAll, "aria-label": "Select all shown", onchange: () => { for (const row of rows) state.selected[isAll ? "delete" : "add"](row.name); update(); } });
    head.replaceChildren(h("th", {}, all), ...columns.map(([name, text]) =>
      h("th", { class: `column-${name}`, "aria-sort": name === key ? (sign > 0 ? "ascending" : "descending") : null }, h("button", { class: "cell", onclick: () => { state.sort = [name, name === key ? -sign : 1]; update(); } }, `${text}${name === key ? (sign > 0 ? " ▲" : " ▼") : ""}`))));
    if (isWhole) cells.clear();
    body.replaceChildren(...rows.map((row) => {
      const known = cells.get(row.name);
      const seen = JSON.stringify([row.revision, row, state.selected.has(row.name), current === row.name]);
      if (known?.seen === seen) return known.line;
      const box = h("input", { type: "checkbox", checked: state.selected.has(row.name), "aria-label": `Select ${row.name}`, onchange: () => toggle(row.name) });
      const line = h("tr", { class: current === row.name ? "current" : "", onclick: () => { current = state.current = row.name; } }, h("td", {}, box), columns.map(([name, , , cell]) => h("td", { class: `column-${name}` }, cell(row))));
      cells.set(row.name, { line, seen });
      return line;
    }));
    count.textContent = `${rows.length} of ${state.names.length}${state.waiting ? `, ${state.waiting} still being read` : ""}${state.selected.size ? `, ${state.selected.size} selected` : ""}`;
    document.getElementById("classes").replaceChildren(...(state.classes ?? []).map((label) => h("option", { value: label })));
    summary.replaceChildren(...about());
    compare.hidden = state.selected.size < 2;
  }
  const toggle = (name) => { if (!state.selected.delete(name)) state.selected.add(name); update(); };

  function about() {
    const parts = [h("p", { class: "soft" }, state.source, ...(state.unwritten ? [" has no index yet; the first change of a fact writes recordings.toml. ", h("button", { class: "small", onclick: () => write([], false) }, "Write it now")] : []))];
    if (Object.keys(state.questions ?? {}).length) parts.push(questions());
    const list = [...(state.findings ?? []).map((finding) => finding.message), ...(state.skipped ?? []).map((text) => `Left out: ${text}`)];
    if (list.length) parts.push(h("details", {}, h("summary", {}, `${list.length} remark${list.length > 1 ? "s" : ""} on the whole`), h("ul", {}, list.map((text) => h("li", {}, text)))));
    return parts;
  }
  function questions() {
    const fields = Object.entries(state.questions).map(([key, text]) => h("label", { class: "question" }, text.replace(/ \[.*\]$/, ""), h("input", { name: key, required: key !== "label_pattern" })));
    return h("form", { class: "stack card", onsubmit: async (event) => {
      event.preventDefault();
      const table = await attempt(() => send("answers", Object.fromEntries(new FormData(event.target))));
      if (table) { take(table); update(); }
    } }, fields, h("button", { class: "primary" }, "Read the files"));
  }
  function keys(event) {
    const moves = { j: 1, ArrowDown: 1, k: -1, ArrowUp: -1 };
    if (moves[event.key]) {
      current = state.current = current && state.order.includes(current) ? step(current, moves[event.key]) : state.order[0];
      update();
      cells.get(current)?.line.scrollIntoView({ block: "nearest" });
    } else if (event.key === "Enter" && current) location.hash = address("recording", { name: current });
    else if (event.key === "x" && current) toggle(current);
    else if (event.key === "/") filter.focus();
    else return listen(state.rows.get(current), event.key);
    return true;
  }
  update();
  return { update, keys };
}

// rooms and keys

const ROOMS = { recordings: recordingsRoom, recording: recordingRoom, compare: compareRoom, twin: twinRoom, diagnose: diagnoseRoom };
let room = null, opened = 0;

async function open() {
  const [name, query = ""] = location.hash.slice(1).split("?");
  const key = ROOMS[name] ? name : "recordings";
  room?.leave?.();
  room = null;
  const place = h("div"), number = ++opened;
  main.replaceChildren(place);
  for (const link of document.querySelectorAll(".bar nav a")) {
    if (link.hash === `#${key}` || (key === "recording" && link.hash === "#recordings")) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${key[0].toUpperCase()}${key.slice(1)} · swashtwin`;
  scrollTo(0, 0);
  const values = Object.fromEntries(new URLSearchParams(query)), wanted = () => (key === "recording" ? state.rows.get(values.name)?.state === "waiting" : state.waiting);
  place.append("reading the recordings …");
  for (let tries = 0; key !== "recordings" && wanted() && number === opened && tries < 30; tries++) { // a link that was opened first
    await new Promise((done) => setTimeout(done, 300));
    await attempt(async () => take(await ask("rows", { since: state.revision })));
  }
  if (number !== opened) return;
  place.replaceChildren();
  const made = await attempt(() => ROOMS[key](place, values), place);
  if (number === opened) room = made;
  else made?.leave?.();
}

let isGoing = false;
document.addEventListener("keydown", (event) => {
  if (event.target.matches("input:not([type=checkbox]):not([type=range]), select, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
  const target = isGoing && { r: "recordings", c: "compare", t: "twin", d: "diagnose" }[event.key];
  isGoing = event.key === "g";
  if (target) location.hash = target;
  else if (event.key === "?") document.getElementById("help").showModal();
  else if (event.key === "u") undo();
  else if (event.target.matches("button, a, summary, [type=range]") && [" ", "Enter", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"].includes(event.key)) return;
  else if (!room?.keys?.(event)) return;
  event.preventDefault();
});
document.getElementById("keys").addEventListener("click", () => document.getElementById("help").showModal());
document.getElementById("undo").addEventListener("click", undo);
addEventListener("hashchange", open);
take(await ask("rows"));
await open();
poll();
