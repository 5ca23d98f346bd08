/** Play one channel of a recording, slower or faster. */
import { requestSamples } from "./server.js";

const MAX_SAMPLES = 4e6;
/** Sample rates that browsers accept [Hz]. */
export const MIN_RATE = 3000;
export const MAX_RATE = 192000;
/** Peak of what is played, so that it is not clipped. */
export const PEAK = 0.9;

export class Sound {
  constructor() {
    /** @type {AudioBufferSourceNode | null} */
    this.source = null;
    /** @type {AudioContext | null} */
    this.context = null;
  }

  get isPlaying() {
    return this.source !== null;
  }

  /**
   * @param {import("./types.js").Row} row
   * @param {number} channel
   * @param {import("./types.js").Range} range [s]
   * @param {number} speed 1 for the original speed
   * @param {() => void} onEnd
   */
  async play(row, channel, [low, high], speed, onEnd) {
    const start = Math.max(0, Math.floor(low * row.rate));
    const length = Math.ceil((high - low) * row.rate);
    const count = Math.min(length, row.samples - start, MAX_SAMPLES);
    const { values } = await requestSamples({ name: row.name, start, count, channel });

    this.context ??= new AudioContext();
    const rate = Math.min(Math.max(row.rate, MIN_RATE), MAX_RATE);
    const buffer = this.context.createBuffer(1, values.length, rate);
    buffer.copyToChannel(normalize(values), 0);

    const playbackRate = (speed * row.rate) / rate;
    this.source = new AudioBufferSourceNode(this.context, { buffer, playbackRate });
    this.source.onended = () => {
      this.source = null;
      onEnd();
    };
    this.source.connect(this.context.destination);
    await this.context.resume();
    this.source.start();
  }

  stop() {
    this.source?.stop();
  }
}

/**
 * Return values without their mean, scaled to the peak.
 *
 * @param {Float32Array<ArrayBuffer>} values
 */
function normalize(values) {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const largest = values.reduce((peak, value) => Math.max(peak, Math.abs(value - mean)), 0) || 1;
  return values.map((value) => (PEAK * (value - mean)) / largest);
}
