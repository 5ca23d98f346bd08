/** Listen to the same part of two recordings in turns, with the same gain. */
import { requestSamples } from "./server.js";
import { MAX_RATE, MIN_RATE, PEAK } from "./sound.js";

/** Length of the part that is repeated [s]. */
export const PART_S = 3;
/** Center frequency over bandwidth of what is heard near a frequency. */
const QUALITY = 4;
/** Time in which one recording is faded into the other [s], so that no click is heard. */
const FADE_S = 0.02;

export class PairSound {
  constructor() {
    /** @type {AudioContext | null} */
    this.context = null;
    /** @type {{source: AudioBufferSourceNode, gain: GainNode, filter: BiquadFilterNode}[]} */
    this.voices = [];
    /** Number of the request whose recordings are to be heard. */
    this.request = 0;
  }

  get isPlaying() {
    return this.voices.length > 0;
  }

  /**
   * Repeat a part of both recordings at the same time; one of them is heard.
   *
   * @param {import("./types.js").Row[]} rows
   * @param {number} channel
   * @param {number} start [s]
   * @param {number} heard index of the recording that is heard
   * @param {number | null} frequency heard alone [Hz]; all if it is null
   */
  async play(rows, channel, start, heard, frequency) {
    this.request += 1;
    const { request } = this;
    const parts = await Promise.all(rows.map((row) => readPart(row, channel, start)));
    // stopped, or asked for other recordings, while these were read
    if (request !== this.request) return;
    this.silence();
    const peak = Math.max(...parts.map(peakOf)) || 1;
    this.context ??= new AudioContext();
    for (const [n, values] of parts.entries()) {
      this.voices.push(this.startVoice(values, PEAK / peak, rows[n].rate));
    }
    this.hear(heard);
    this.tune(frequency);
    await this.context.resume();
  }

  /**
   * @param {Float32Array<ArrayBuffer>} values
   * @param {number} factor
   * @param {number} recordedRate [Hz]
   */
  startVoice(values, factor, recordedRate) {
    const { context } = this;
    const rate = Math.min(Math.max(recordedRate, MIN_RATE), MAX_RATE);
    const buffer = context.createBuffer(1, values.length, rate);
    buffer.copyToChannel(
      values.map((value) => factor * value),
      0,
    );
    const playbackRate = recordedRate / rate;
    const source = new AudioBufferSourceNode(context, { buffer, playbackRate, loop: true });
    const gain = new GainNode(context, { gain: 0 });
    const filter = new BiquadFilterNode(context, { type: "allpass", Q: QUALITY });
    source.connect(filter).connect(gain).connect(context.destination);
    source.start();
    return { source, gain, filter };
  }

  /**
   * Let one of the recordings be heard.
   *
   * @param {number} heard
   */
  hear(heard) {
    const now = this.context?.currentTime ?? 0;
    const end = now + FADE_S;
    for (const [n, { gain }] of this.voices.entries()) {
      // without this point, the ramp begins at the previous switch and ends in a jump
      gain.gain.setValueAtTime(gain.gain.value, now);
      gain.gain.linearRampToValueAtTime(n === heard ? 1 : 0, end);
    }
  }

  /**
   * Let only what is near a frequency be heard.
   *
   * @param {number | null} frequency [Hz]
   */
  tune(frequency) {
    for (const { filter } of this.voices) {
      filter.type = frequency ? "bandpass" : "allpass";
      if (frequency) filter.frequency.value = frequency;
    }
  }

  stop() {
    this.request += 1;
    this.silence();
  }

  silence() {
    for (const { source } of this.voices) source.stop();
    this.voices = [];
  }
}

/**
 * Return the samples of a part, without their mean.
 *
 * @param {import("./types.js").Row} row
 * @param {number} channel
 * @param {number} start [s]
 */
async function readPart(row, channel, start) {
  const count = Math.min(Math.ceil(PART_S * row.rate), row.samples);
  const first = Math.max(0, Math.min(Math.floor(start * row.rate), row.samples - count));
  const { values } = await requestSamples({ name: row.name, start: first, count, channel });
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  return values.map((value) => value - mean);
}

/** @param {Float32Array} values */
function peakOf(values) {
  return values.reduce((peak, value) => Math.max(peak, Math.abs(value)), 0);
}
