/** Make elements of the page. */

const MESSAGE_MS = 6000;
let messageTimer = 0;

/**
 * Return a new element.
 *
 * Attributes that begin with "on" are listeners; null and undefined leave an attribute out.
 *
 * @param {string} tag
 * @param {Record<string, any>} attributes
 * @param {...any} children
 * @returns {any} an HTML element; its kind follows from the tag
 */
export function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined) continue;

    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name in node && typeof value !== "string") /** @type {any} */ (node)[name] = value;
    else node.setAttribute(name, value);
  }

  const presentChildren = children.flat().filter((child) => child !== null && child !== undefined);
  node.append(...presentChildren);
  return node;
}

/**
 * Return a labeled menu.
 *
 * @param {string} label
 * @param {[any, string][]} options values and their texts
 * @param {any} selected
 * @param {(value: string) => void} onSelect
 */
export function selectMenu(label, options, selected, onSelect) {
  const choices = options.map(([value, text]) =>
    element("option", { value, selected: String(value) === String(selected) }, text),
  );
  const onchange = (/** @type {any} */ event) => onSelect(event.target.value);
  return element("label", {}, label, " ", element("select", { onchange }, choices));
}

/**
 * Return a table in a region that scrolls sideways.
 *
 * @param {string} label
 * @param {any[]} headers header cells
 * @param {any[]} rows rows of the body
 * @param {string} [style] class of the table
 */
export function scrollTable(label, headers, rows, style) {
  const head = element("thead", {}, element("tr", {}, headers));
  const table = element("table", { class: style }, head, element("tbody", {}, rows));
  const attributes = { class: "scroll", tabIndex: 0, role: "region", "aria-label": label };
  return element("div", attributes, table);
}

/**
 * Return a list with a title; null if it has no items.
 *
 * @param {string} title
 * @param {any[]} items
 * @param {string} [tag]
 */
export function titledList(title, items, tag = "ul") {
  if (!items.length) return null;
  const list = element(tag, {}, listItems(items));
  return element("section", {}, element("h2", {}, title), list);
}

/**
 * Return a list that is closed at first; null if it has no items.
 *
 * @param {string} title
 * @param {string[]} texts
 */
export function foldedList(title, texts) {
  if (!texts.length) return null;
  return element("details", {}, element("summary", {}, title), element("ul", {}, listItems(texts)));
}

/** @param {any[]} items */
export function listItems(items) {
  return items.map((item) => element("li", {}, item));
}

/**
 * Return a text that may break after slashes, dots and dashes.
 *
 * @param {string} text
 */
export function breakable(text) {
  return text.split(/(?<=[_/.-])/).flatMap((part) => [part, element("wbr")]);
}

/**
 * Show a message at the bottom of the page for some seconds.
 *
 * @param {string} text
 */
export function showMessage(text) {
  const box = document.getElementById("message");
  box.textContent = text;
  clearTimeout(messageTimer);
  messageTimer = setTimeout(() => {
    box.textContent = "";
  }, MESSAGE_MS);
}
