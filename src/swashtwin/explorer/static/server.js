/** Requests to the server. */
import { element, showMessage } from "./elements.js";

const tokenTag = /** @type {HTMLMetaElement} */ (document.querySelector("meta[name=token]"));

/**
 * Return an answer of the server; an error holds the reason that it states.
 *
 * @param {string} path
 * @param {Record<string, any> | URLSearchParams} values empty ones are left out
 */
export async function request(path, values = {}) {
  const query = values instanceof URLSearchParams ? values : queryOf(values);
  return readAnswer(await fetch(`/api/${path}?${query}`));
}

/**
 * Return samples, or extremes of bins, and the share of the recording that was read for them.
 *
 * @param {Record<string, any>} values
 * @returns {Promise<{values: Float32Array<ArrayBuffer>, known: number}>}
 */
export async function requestSamples(values) {
  const answer = await fetch(`/api/samples?${queryOf(values)}`);
  const known = Number(answer.headers.get("x-known") ?? 1);
  return { values: await readAnswer(answer), known };
}

/**
 * Change something at the server, and return its answer.
 *
 * @param {string} path
 * @param {any} content
 */
export async function send(path, content) {
  return post(path, JSON.stringify(content), "application/json");
}

/**
 * Send a file, and return the server's answer.
 *
 * @param {string} path
 * @param {File} file
 */
export async function sendFile(path, file) {
  return post(path, file, "application/octet-stream");
}

/**
 * @param {string} path
 * @param {BodyInit} body
 * @param {string} contentType
 */
async function post(path, body, contentType) {
  const headers = { "x-explorer": tokenTag.content, "content-type": contentType };
  return readAnswer(await fetch(`/api/${path}`, { method: "POST", body, headers }));
}

/** @param {Response} answer */
async function readAnswer(answer) {
  if (answer.headers.get("content-type")?.startsWith("application/octet")) {
    return new Float32Array(await answer.arrayBuffer());
  }

  const silence = { detail: "The server did not answer. Is swashtwin explore still running?" };
  const content = await answer.json().catch(() => silence);
  if (!answer.ok) {
    const isText = typeof content.detail === "string";
    throw new Error(isText ? content.detail : "The server refused an invalid value.");
  }
  return content;
}

/** @param {Record<string, any>} values */
function queryOf(values) {
  const isGiven = (/** @type {any} */ value) =>
    value !== null && value !== undefined && value !== "";
  return new URLSearchParams(Object.entries(values).filter(([, value]) => isGiven(value)));
}

/**
 * Do some work, and show the reason if it fails.
 *
 * @param {() => any} work
 * @param {HTMLElement | null} place where the reason is shown; otherwise as a message
 */
export async function attempt(work, place = null) {
  try {
    return await work();
  } catch (error) {
    const reason = /** @type {Error} */ (error).message;
    if (place) place.replaceChildren(element("p", { class: "notice" }, reason));
    else showMessage(reason);
    return null;
  }
}

/**
 * Do some work; return null if it fails.
 *
 * @template T
 * @param {() => Promise<T>} work
 * @returns {Promise<T | null>}
 */
export async function attemptQuietly(work) {
  try {
    return await work();
  } catch {
    return null;
  }
}
