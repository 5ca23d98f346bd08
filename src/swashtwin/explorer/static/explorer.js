/** Open pages by their addresses, and listen to keys. */
import { openCompare } from "./compare_page.js";
import { openDiagnose } from "./diagnose_page.js";
import { element } from "./elements.js";
import { undoChange } from "./facts.js";
import { openRecording } from "./recording_page.js";
import { openRecordings } from "./recordings_page.js";
import { attempt, attemptQuietly } from "./server.js";
import { announceChange, loadRows, onRecordingsChanged, state } from "./state.js";
import { openTwin } from "./twin_page.js";

/** @typedef {import("./types.js").Page} Page */

/** @type {Record<string, (place: HTMLElement, values: any) => Page | Promise<Page>>} */
const PAGES = {
  recordings: openRecordings,
  recording: openRecording,
  compare: openCompare,
  twin: openTwin,
  diagnose: openDiagnose,
};
/** Keys that open a page after "g". */
const PAGE_KEYS = { r: "recordings", c: "compare", t: "twin", d: "diagnose" };
/** Keys that buttons, links and sliders use themselves. */
const CONTROL_KEYS = [" ", "Enter", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"];
const TYPED_IN = "input:not([type=checkbox]):not([type=range]), select, textarea";
const CONTROLS = "button, a, summary, [type=range]";

/** Time between requests while recordings are read, and afterwards. */
const BUSY_POLL_MS = 500;
const IDLE_POLL_MS = 2500;
/** How long a page waits for recordings that are being read. */
const WAIT_MS = 300;
const MAX_WAITS = 30;

const main = document.getElementById("main");
const help = /** @type {HTMLDialogElement} */ (document.getElementById("help"));

/** @type {Page | null} */
let page = null;
/** Number of the newest page; a previous one that is ready later is not shown. */
let openedCount = 0;
let isAfterG = false;

/** Open the page of the address. */
async function openPage() {
  const [name, query = ""] = location.hash.slice(1).split("?");
  const key = PAGES[name] ? name : "recordings";
  const values = Object.fromEntries(new URLSearchParams(query));
  openedCount += 1;
  const number = openedCount;
  page?.leave?.();
  page = null;

  markNavigation(key === "recording" ? "recordings" : key);
  document.title = `${key[0].toUpperCase()}${key.slice(1)} · swashtwin`;
  scrollTo(0, 0);
  const place = element("div", {}, "Reading the recordings …");
  main.replaceChildren(place);

  const isPresent = () => number === openedCount;
  const isOpened = (/** @type {any} */ row) => row?.state !== "waiting" || row.samples > 0;
  const isReading = () =>
    key === "recording" ? !isOpened(state.rows.get(values.name)) : state.waiting > 0;
  if (key !== "recordings") await waitWhile(() => isReading() && isPresent());
  if (!isPresent()) return;

  place.replaceChildren();
  const opened = await attempt(() => PAGES[key](place, values), place);
  if (isPresent()) page = opened;
  else opened?.leave?.();
}

/** @param {string} key */
function markNavigation(key) {
  for (const link of document.querySelectorAll(".bar nav a")) {
    const isPresent = /** @type {HTMLAnchorElement} */ (link).hash === `#${key}`;
    if (isPresent) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

/**
 * Wait while recordings are being read: a link may be opened before they are.
 *
 * @param {() => boolean} isReading
 */
async function waitWhile(isReading) {
  for (let count = 0; isReading() && count < MAX_WAITS; count++) {
    await new Promise((resolve) => setTimeout(resolve, WAIT_MS));
    await attempt(loadRows);
  }
}

/** Load changed recordings again and again. */
async function poll() {
  const hasChanged = await attemptQuietly(loadRows);
  if (hasChanged) announceChange();
  setTimeout(poll, state.waiting ? BUSY_POLL_MS : IDLE_POLL_MS);
}

/** @param {KeyboardEvent} event */
function useKey(event) {
  const target = /** @type {HTMLElement} */ (event.target);
  const hasModifier = event.ctrlKey || event.metaKey || event.altKey;
  if (hasModifier || target.matches(TYPED_IN)) return;

  const pageName = PAGE_KEYS[/** @type {keyof typeof PAGE_KEYS} */ (event.key)];
  const isPageKey = isAfterG && pageName !== undefined;
  isAfterG = event.key === "g";

  if (isPageKey) location.hash = pageName;
  else if (event.key === "?") help.showModal();
  else if (event.key === "u") undoChange();
  else if (target.matches(CONTROLS) && CONTROL_KEYS.includes(event.key)) return;
  else if (!page?.keys?.(event)) return;
  event.preventDefault();
}

// The token is in a cookie now; in the address it would be copied with links.
if (location.search) history.replaceState(null, "", location.pathname + location.hash);

onRecordingsChanged(() => page?.update?.());
document.addEventListener("keydown", useKey);
document.getElementById("keys").addEventListener("click", () => help.showModal());
document.getElementById("undo").addEventListener("click", undoChange);
addEventListener("hashchange", openPage);

await loadRows();
await openPage();
poll();
