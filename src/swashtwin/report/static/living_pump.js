/**
 * A pump that turns with its twin's solution: a section along the shaft, the valve plate seen along
 * it, and the pressure and the waveform of one turn. A page only has to hold the content that
 * `report.describe_turn` returns. Nothing is allocated while the pump turns.
 *
 * @typedef {{rows: number, factor: number, integers: string}} Packed
 *
 * @typedef {object} Fault How a fault is drawn; lengths are in mm and already enlarged.
 * @property {string} label
 * @property {string[]} parts Parts that are marked.
 * @property {string} sentence
 * @property {number | null} piston Index of the only faulty piston.
 * @property {number} scale Factor on displacements.
 * @property {boolean} across Whether displacements are lateral.
 * @property {string} leak
 * @property {number} gap
 * @property {[number, number, number] | null} recess Angle, angle that it spans, depth.
 * @property {boolean} scratch
 * @property {boolean} tilt
 *
 * @typedef {object} Content
 * @property {string} description
 * @property {Record<string, number>} shape Lengths [mm] and angles [rad].
 * @property {{name: string, position: number[]}[]} sensors
 * @property {string} pressureUnit Unit of pressures.
 * @property {Packed} chamber
 * @property {Packed} discharge
 * @property {Packed} contact [N]
 * @property {Packed} displacement [mm]
 * @property {Packed} waveform [m/s²]
 * @property {{channels: string[], waveform: Packed} | null} measured [m/s²]
 * @property {Fault | null} fault
 */

const TURN = 2 * Math.PI;
const SECONDS_PER_TURN = 12;
/** Time between texts while the pump turns; a faster one cannot be read. */
const TEXT_MS = 400;
const SHADES = 48;
/** Colors from low to high pressure, whose lightness alone tells them apart. */
const LIGHT_SHADES = [
  [222, 235, 247],
  [92, 155, 210],
  [8, 48, 107],
];
const DARK_SHADES = [
  [38, 52, 68],
  [54, 120, 180],
  [190, 230, 255],
];
const INKS = ["ink", "soft", "housing", "metal", "steel", "edge", "mark", "tint", "force", "curve"];

const LEFT = 44;
const RIGHT = 10;
const TOP = 20;
const BOTTOM = 20;
const DOT = 4;
/** Width of a measured waveform, over which that of the twin is drawn. */
const MEASURED_WIDTH = 3;
/** Distance of the middles of two names below which they would touch. */
const MIN_NAME_DISTANCE = 88;
/** Size below which a page has not laid out its figures yet. */
const MIN_SIZE = 80;

/** @param {Packed} packed */
function unpack({ rows, factor, integers }) {
  // Loops, because this runs for each picture of a moved slider: a function that is called for each
  // of 33,000 bytes takes 6 ms.
  const text = atob(integers);
  const bytes = new Uint8Array(text.length);
  for (let n = 0; n < bytes.length; n++) bytes[n] = text.charCodeAt(n);
  const values = new Float32Array(new Int16Array(bytes.buffer));
  for (let n = 0; n < values.length; n++) values[n] *= factor;

  const length = values.length / rows;
  return Array.from({ length: rows }, (_, n) => values.subarray(n * length, (n + 1) * length));
}

/**
 * Return the value of a curve over one turn.
 *
 * @param {Float32Array} values
 * @param {number} angle
 */
function valueAt(values, angle) {
  const position = (angle / TURN) * values.length;
  const index = Math.floor(position);
  const weight = position - index;
  const first = values[index % values.length];
  return first + weight * (values[(index + 1) % values.length] - first);
}

/** @param {Float32Array[]} rows */
function largest(rows) {
  return Math.max(1e-9, ...rows.map((row) => row.reduce((a, b) => Math.max(a, Math.abs(b)), 0)));
}

/** @type {(value: number, low: number, high: number) => number} */
function within(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

/** @param {number} value */
function format(value) {
  return String(Number(value.toPrecision(3)));
}

/** A canvas whose coordinates are CSS pixels, whatever the screen's resolution. */
class Sheet {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.width = 0;
    this.height = 0;
    this.ratio = 1;
  }

  /** Take over the size of the element; return whether it is large enough to draw in. */
  fit() {
    const { clientWidth, clientHeight } = this.canvas;
    this.ratio = devicePixelRatio || 1;
    this.width = clientWidth;
    this.height = clientHeight;
    const width = Math.round(clientWidth * this.ratio);
    const height = Math.round(clientHeight * this.ratio);
    // Even an equal size would make a new bitmap.
    if (this.canvas.width !== width) this.canvas.width = width;
    if (this.canvas.height !== height) this.canvas.height = height;
    return clientWidth > MIN_SIZE && clientHeight > MIN_SIZE;
  }

  clear() {
    this.pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.pen.clearRect(0, 0, this.width, this.height);
    this.pen.font = "12px system-ui, sans-serif";
  }

  /**
   * Draw in millimeters from here on, the second coordinate upward.
   *
   * @param {number} scale pixels of a millimeter
   * @param {number} x pixel of the origin
   * @param {number} y
   */
  useMillimeters(scale, x, y) {
    const unit = scale * this.ratio;
    this.pen.setTransform(unit, 0, 0, -unit, x * this.ratio, y * this.ratio);
    this.pen.lineWidth = 1 / scale;
  }
}

export class LivingPump {
  /**
   * @param {HTMLElement} place
   * @param {Content | null} content
   */
  constructor(place, content = null) {
    place.insertAdjacentHTML(
      "beforeend",
      `<div class="pump-views"><canvas class="pump-section" role="img"></canvas>
      <canvas class="pump-face" aria-hidden="true"></canvas>
      <canvas class="pump-curves" aria-hidden="true"></canvas></div>
      <div class="pump-controls"><button type="button"></button>
      <label>Shaft angle <input type="range" min="0" max="359" step="1" value="0"></label>
      <label>Sensor <select></select></label><output></output></div>
      <p class="pump-fault"></p>`,
    );
    const find = (/** @type {string} */ name) => /** @type {any} */ (place.querySelector(name));
    this.place = place;
    // For tests and measurements of speed.
    /** @type {any} */ (place).pump = this;
    this.section = new Sheet(find(".pump-section"));
    this.face = new Sheet(find(".pump-face"));
    this.curves = new Sheet(find(".pump-curves"));
    /** Curves and axes, which do not change while the pump turns. */
    this.base = new Sheet(document.createElement("canvas"));
    this.button = find("button");
    this.handle = find("input");
    this.menu = find("select");
    this.output = find("output");
    this.sentence = find(".pump-fault");

    this.angle = 0;
    /** Index of the sensor whose waveform is drawn. */
    this.sensor = 0;
    this.isTurning = false;
    this.isVisible = true;
    /** Whether the canvases show an earlier content, because the pump is out of view. */
    this.isOutdated = false;
    /** Whether the canvases are large enough to draw in. */
    this.isDrawable = false;
    this.frame = 0;
    this.lastTime = 0;
    this.lastText = 0;
    /** Number of drawn frames, for measurements of speed. */
    this.frames = 0;
    /** Where the cursor is [px], for tests. */
    this.cursor = { x: 0, pressure: 0, waveform: 0, measured: 0 };
    /** @type {Record<string, string>} */
    this.ink = {};
    /** @type {string[]} */
    this.shades = [];
    /** @type {Content | null} */
    this.content = null;

    this.listen();
    if (content) this.show(content);
    const stands = matchMedia("(prefers-reduced-motion: reduce)");
    stands.addEventListener("change", () => this.turn(!stands.matches));
    this.turn(!stands.matches);
  }

  listen() {
    this.button.addEventListener("click", () => this.turn(!this.isTurning));
    this.menu.addEventListener("change", () => {
      this.sensor = Number(this.menu.value);
      this.paint();
    });
    this.handle.addEventListener("input", () => {
      this.turn(false);
      this.moveTo((Number(this.handle.value) / 360) * TURN);
    });
    const scrub = (/** @type {PointerEvent} */ event) => {
      if (!event.buttons) return;
      const pixel = event.clientX - this.curves.canvas.getBoundingClientRect().left;
      const share = (pixel - LEFT) / (this.curves.width - LEFT - RIGHT);
      this.turn(false);
      this.moveTo(Math.min(Math.max(share, 0), 359 / 360) * TURN);
    };
    for (const kind of ["pointerdown", "pointermove"]) {
      this.curves.canvas.addEventListener(kind, /** @type {any} */ (scrub));
    }

    const paint = () => this.paint();
    const sizes = new ResizeObserver(paint);
    for (const { canvas } of [this.section, this.face, this.curves]) sizes.observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
    // Paper shows what is out of view, too.
    addEventListener("beforeprint", () => {
      if (this.isOutdated) this.paint();
    });
    new IntersectionObserver((entries) => {
      this.isVisible = entries[entries.length - 1].isIntersecting;
      if (this.isVisible && this.isOutdated) this.paint();
      this.request();
    }).observe(this.place);
  }

  /**
   * Show another twin at the same shaft angle.
   *
   * @param {Content} content
   */
  show(content) {
    this.content = content;
    this.chamber = unpack(content.chamber);
    this.contact = unpack(content.contact);
    this.displacement = unpack(content.displacement);
    this.waveform = unpack(content.waveform);
    this.discharge = unpack(content.discharge)[0];
    const measured = content.measured ? unpack(content.measured.waveform) : [];
    /** @type {(Float32Array | undefined)[]} measured waveform of each sensor, if there is one */
    this.measured = content.sensors.map(
      ({ name }) => measured[content.measured?.channels.indexOf(name) ?? -1],
    );
    this.count = this.chamber.length;
    this.maxPressure = largest(this.chamber);
    this.maxContact = largest(this.contact);
    this.order = Int8Array.from(this.chamber, (_, n) => n);
    /** Piston whose pressure is drawn over the turn. */
    this.tracked = content.fault?.piston ?? 0;

    const names = content.sensors.map(({ name }) => name);
    this.sensor = Math.min(this.sensor, names.length - 1);
    // A new menu would cost a layout of the page for each picture of a slider.
    const listed = Array.from(this.menu.options, ({ text }) => text);
    if (listed.join() !== names.join()) {
      this.menu.replaceChildren(...names.map((name, n) => new Option(name, String(n))));
    }
    this.menu.selectedIndex = this.sensor;
    this.section.canvas.setAttribute("aria-label", content.description);
    this.sentence.textContent = content.fault?.sentence ?? "";

    if (this.isVisible) this.paint();
    else {
      this.isOutdated = true;
      this.describe();
    }
  }

  /** @param {boolean} isTurning */
  turn(isTurning) {
    this.isTurning = isTurning;
    this.button.textContent = isTurning ? "Stop" : "Turn";
    this.button.setAttribute("aria-label", isTurning ? "Stop the pump" : "Turn the pump");
    this.lastTime = 0;
    this.request();
  }

  /** Turn on with the next frame of the screen, unless nobody sees it. */
  request() {
    if (!this.isTurning || !this.isVisible || this.frame) return;
    this.frame = requestAnimationFrame(this.advance);
  }

  advance = (/** @type {number} */ time) => {
    this.frame = 0;
    if (!this.isTurning || !this.place.isConnected) return;
    const passed = this.lastTime ? Math.min(time - this.lastTime, 100) : 0;
    this.lastTime = time;
    this.angle = (this.angle + (passed / 1000 / SECONDS_PER_TURN) * TURN) % TURN;
    this.draw();
    if (time - this.lastText > TEXT_MS) {
      this.lastText = time;
      this.describe();
    }
    this.request();
  };

  /** @param {number} angle */
  moveTo(angle) {
    this.angle = angle;
    this.draw();
    this.describe();
  }

  /** State angle and values at the cursor, in the handle too. */
  describe() {
    if (!this.content) return;
    const degrees = Math.round((this.angle / TURN) * 360) % 360;
    const pressure = format(valueAt(this.chamber[this.tracked], this.angle));
    const line = format(valueAt(this.discharge, this.angle));
    const reading = format(valueAt(this.waveform[this.sensor], this.angle));
    const measured = this.measured[this.sensor];
    const unit = this.content.pressureUnit;
    const name = this.content.sensors[this.sensor].name;
    const readings = measured
      ? `${name}: twin ${reading}, measured ${format(valueAt(measured, this.angle))} m/s²`
      : `${name} ${reading} m/s²`;
    const text =
      `${degrees}°: chamber ${this.tracked + 1} ${pressure} ${unit}, ` +
      `outlet ${line} ${unit}, ${readings}`;
    this.output.textContent = text;
    this.handle.setAttribute("aria-valuetext", text);
    this.handle.value = degrees;
  }

  /** Draw everything anew, after a change of content, size or colors. */
  paint() {
    if (!this.content || !this.place.isConnected) return;
    this.isOutdated = false;
    const fits = [this.section, this.face, this.curves].map((sheet) => sheet.fit());
    this.isDrawable = fits.every(Boolean);
    if (!this.isDrawable) return;

    const style = getComputedStyle(this.place);
    for (const name of INKS) this.ink[name] = style.getPropertyValue(`--pump-${name}`).trim();
    const isDark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.shades = makeShades(isDark ? DARK_SHADES : LIGHT_SHADES);
    this.paintCurves();
    this.draw();
    this.describe();
  }

  /** Draw what turns. */
  draw() {
    if (!this.content || !this.isDrawable) return;
    this.sortByDepth();
    this.drawSection();
    this.drawFace();
    this.drawCursor();
    this.frames += 1;
  }

  /** Sort pistons from the farthest to the nearest; the discharge side is in front. */
  sortByDepth() {
    const { order } = this;
    for (let n = 1; n < order.length; n++) {
      const piston = order[n];
      const depth = Math.sin(this.angleOf(piston));
      let before = n - 1;
      while (before >= 0 && Math.sin(this.angleOf(order[before])) < depth) {
        order[before + 1] = order[before];
        before -= 1;
      }
      order[before + 1] = piston;
    }
  }

  /** @param {number} piston */
  angleOf(piston) {
    return this.angle + (TURN * piston) / this.count;
  }

  /** @param {number} piston */
  shadeOf(piston) {
    return this.shade(valueAt(this.chamber[piston], this.angle));
  }

  /** @param {number} pressure */
  shade(pressure) {
    return this.shades[Math.round(within(pressure / this.maxPressure, 0, 1) * (SHADES - 1))];
  }

  /** @param {string} part */
  inkOf(part) {
    return this.content.fault?.parts.includes(part) ? this.ink.tint : this.ink.metal;
  }

  drawSection() {
    const { section, ink } = this;
    const { pen } = section;
    const { radius, slipper, swash, outer, piston: bore, dead, guide } = this.content.shape;
    const tangent = Math.tan(swash);
    const web = 0.25 * bore;
    // A pump file may place the valve plate nearer than the pistons are long.
    const shortest = radius * tangent + 1.1 * guide + dead + web;
    const plate = Math.max(this.content.shape.plate, shortest);
    const front = plate - web - dead - guide;
    const half = 1.25 * Math.max(outer, radius + slipper / 2);
    const start = -1.3 * radius * tangent - 1.1 * radius;
    const end = plate + 0.75 * radius;

    section.clear();
    const scale = Math.min(
      (section.width - 14) / (end - start),
      (section.height - 36) / (2 * half),
    );
    const x = (section.width - scale * (end + start)) / 2;
    section.useMillimeters(scale, x, section.height / 2);

    pen.strokeStyle = ink.edge;
    pen.fillStyle = ink.housing;
    box(pen, start, -half, end, half);
    this.drawPlate(pen, half);
    pen.fillStyle = ink.steel;
    box(pen, start, -0.28 * radius, end, 0.28 * radius);
    this.drawBlock(pen, front, plate, radius + 0.75 * bore, end);
    for (const piston of this.order) this.drawPiston(pen, piston, front, plate - web);
    pen.globalAlpha = 1;
    for (let n = 0; n < this.content.sensors.length; n++) {
      const [, across, along] = this.content.sensors[n].position;
      this.drawSensor(pen, n, within(along, start, end), within(across, -half, half), scale);
    }

    pen.setTransform(section.ratio, 0, 0, section.ratio, 0, 0);
    pen.fillStyle = ink.soft;
    pen.textAlign = "center";
    const below = section.height / 2 + scale * half + 14;
    const plateName = x - 0.25 * scale * radius;
    const blockName = x + 0.5 * scale * (front + plate);
    pen.fillText("swash plate", plateName, below);
    pen.fillText("cylinder block", Math.max(blockName, plateName + MIN_NAME_DISTANCE), below);
    pen.fillText(
      "valve plate",
      Math.min(x + scale * plate, section.width - 34),
      section.height / 2 - scale * half - 6,
    );
  }

  /**
   * Draw the swash plate with its recess.
   *
   * @param {Pen} pen
   * @param {number} half half of the housing's height
   */
  drawPlate(pen, half) {
    const { radius, slipper, swash } = this.content.shape;
    const gap = 0.3 * slipper;
    const length = Math.min(1.5 * radius, half / Math.cos(swash) - 2);
    pen.save();
    // Along the plate and toward the pistons from here on.
    pen.transform(Math.cos(swash), -Math.sin(swash), Math.sin(swash), Math.cos(swash), 0, 0);
    pen.fillStyle = this.inkOf("swash plate");
    box(pen, -gap - 0.55 * radius, -length, -gap, length);
    const recess = this.content.fault?.recess;
    if (recess) {
      const [angle, span, depth] = recess;
      const middle = (radius * Math.cos(angle)) / Math.cos(swash);
      const reach = Math.max(Math.abs(radius * Math.sin(angle) * Math.sin(span / 2)), slipper / 4);
      pen.fillStyle = this.ink.mark;
      box(pen, -gap - depth, middle - reach, -gap, middle + reach);
    }
    pen.restore();
  }

  /**
   * Draw the cylinder block, the valve plate and the end cover.
   *
   * @param {Pen} pen
   * @param {number} front end of the block on the side of the swash plate
   * @param {number} plate its face on the valve plate
   * @param {number} half half of its height
   * @param {number} end end of the cover
   */
  drawBlock(pen, front, plate, half, end) {
    const { radius } = this.content.shape;
    const { fault } = this.content;
    const gap = fault?.leak === "film" ? fault.gap : 0;
    const tilt = fault?.tilt ? 0.06 * Math.cos(this.angle) * half : 0;
    const back = plate + gap + 0.14 * radius;

    pen.fillStyle = this.inkOf("cylinder block");
    pen.beginPath();
    pen.moveTo(front, -half);
    pen.lineTo(front, half);
    pen.lineTo(plate - Math.max(tilt, 0), half);
    pen.lineTo(plate - Math.max(-tilt, 0), -half);
    pen.closePath();
    pen.fill();
    pen.stroke();

    pen.fillStyle = this.inkOf("valve plate");
    box(pen, plate + gap, -half, back, half);
    if (gap) {
      pen.fillStyle = this.shades[SHADES >> 1];
      pen.fillRect(plate, -half, gap, 2 * half);
    }
    pen.fillStyle = this.ink.steel;
    box(pen, back, -half, end, half);
    // The kidney of the discharge side, which is in front.
    pen.fillStyle = this.shadeOfLine();
    pen.fillRect(plate + gap, -0.85 * radius, back - plate - gap, 1.7 * radius);
  }

  shadeOfLine() {
    return this.shade(valueAt(this.discharge, this.angle));
  }

  /**
   * Draw a piston in its bore, with chamber, slipper and contact force.
   *
   * @param {Pen} pen
   * @param {number} piston
   * @param {number} front end of the block
   * @param {number} bottom end of the bore
   */
  drawPiston(pen, piston, front, bottom) {
    const { radius, slipper, swash, piston: bore, dead } = this.content.shape;
    const { fault } = this.content;
    const { ink } = this;
    const angle = this.angleOf(piston);
    const isFaulty = fault?.piston === piston;
    const moved = valueAt(this.displacement[piston], this.angle) * (fault?.scale ?? 1);
    const sunk = fault?.recess ? moved : 0;
    const along = fault?.across ? 0 : moved;
    const height = radius * Math.cos(angle);
    const ball = height * Math.tan(swash) - sunk;
    const middle = height + (fault?.across ? moved : 0);
    const stroke = radius * Math.tan(swash);
    const head = ball + (fault?.recess ? 0 : along) + bottom - dead - stroke;
    // Pistons in front hide those behind.
    pen.globalAlpha = 0.66 - 0.34 * Math.sin(angle);

    pen.strokeStyle = isFaulty ? ink.mark : ink.edge;
    pen.fillStyle = this.shadeOf(piston);
    box(pen, head, height - bore / 2, bottom, height + bore / 2);
    pen.fillRect(bottom, height - bore / 5, 0.25 * bore, 0.4 * bore);
    const gap = isFaulty && fault.leak === "bore" ? fault.gap : 0;
    if (gap) pen.fillRect(front, height - bore / 2 - gap, head - front, bore + 2 * gap);

    this.drawSlipper(pen, piston, ball, height);
    pen.fillStyle = isFaulty && fault.parts.includes("piston") ? ink.tint : ink.steel;
    const start = ball + (fault?.recess ? 0 : along);
    box(pen, start, middle - bore / 2, head, middle + bore / 2);
    pen.fillStyle = ink.edge;
    pen.beginPath();
    pen.arc(ball, height, 0.22 * slipper, 0, TURN);
    pen.fill();
    if (isFaulty) this.drawLeak(pen, piston, front, bottom, height);
  }

  /**
   * Draw a slipper on the swash plate, and the force between them.
   *
   * @param {Pen} pen
   * @param {number} piston
   * @param {number} x center of its ball
   * @param {number} y
   */
  drawSlipper(pen, piston, x, y) {
    const { radius, slipper, swash } = this.content.shape;
    const force = valueAt(this.contact[piston], this.angle) / this.maxContact;
    const gap = 0.3 * slipper;
    pen.save();
    pen.transform(Math.cos(swash), -Math.sin(swash), Math.sin(swash), Math.cos(swash), x, y);
    pen.fillStyle = this.inkOf("slipper");
    if (this.content.fault && this.content.fault.piston !== null) {
      pen.fillStyle = this.content.fault.piston === piston ? this.inkOf("slipper") : this.ink.metal;
    }
    box(pen, -gap, -slipper / 2, -0.4 * gap, slipper / 2);
    const tip = -gap - 0.8 * radius * force;
    pen.strokeStyle = this.ink.force;
    pen.fillStyle = this.ink.force;
    const width = pen.lineWidth;
    pen.lineWidth = 2.5 * width;
    line(pen, -gap, 0, tip, 0);
    pen.lineWidth = width;
    if (force > 0.02) {
      pen.beginPath();
      pen.moveTo(tip - 3, 0);
      pen.lineTo(tip + 1, 2.4);
      pen.lineTo(tip + 1, -2.4);
      pen.fill();
    }
    pen.restore();
  }

  /**
   * Draw the oil that leaves a chamber, the farther the higher its pressure.
   *
   * @param {Pen} pen
   * @param {number} piston
   * @param {number} front
   * @param {number} bottom
   * @param {number} height of the bore's middle
   */
  drawLeak(pen, piston, front, bottom, height) {
    const { radius, piston: bore } = this.content.shape;
    const { leak } = this.content.fault;
    if (!leak) return;
    const jet = (0.7 * radius * valueAt(this.chamber[piston], this.angle)) / this.maxPressure;
    const width = pen.lineWidth;
    pen.strokeStyle = this.shadeOf(piston);
    pen.lineWidth = 3 * width;
    const edge = bore / 2;
    if (leak === "bore") {
      line(pen, front, height + edge, front - jet, height + edge + 0.3 * jet);
      line(pen, front, height - edge, front - jet, height - edge - 0.3 * jet);
    } else {
      const side = height < 0 ? -1 : 1;
      line(pen, bottom + 0.25 * bore, height, bottom + 0.25 * bore, height + side * (edge + jet));
    }
    pen.lineWidth = width;
  }

  /**
   * Draw a sensor, the selected one filled.
   *
   * @param {Pen} pen
   * @param {number} index
   * @param {number} x
   * @param {number} y
   * @param {number} scale pixels of a millimeter
   */
  drawSensor(pen, index, x, y, scale) {
    pen.fillStyle = index === this.sensor ? this.ink.curve : this.ink.housing;
    pen.strokeStyle = this.ink.curve;
    pen.lineWidth = 2 / scale;
    disk(pen, x, y, 5 / scale);
    pen.lineWidth = 1 / scale;
  }

  drawFace() {
    const { face, ink } = this;
    const { pen } = face;
    const { shape, fault, sensors } = this.content;
    const { radius, kidney, outer, piston: bore, ramp, groove } = shape;
    const rim = 1.3 * outer;

    face.clear();
    // Sensors on the rim need some pixels beyond it.
    const scale = Math.min(face.width - 14, face.height - 48) / (2 * rim);
    face.useMillimeters(scale, face.width / 2, face.height / 2);
    pen.strokeStyle = ink.edge;
    pen.fillStyle = ink.housing;
    disk(pen, 0, 0, rim);
    pen.fillStyle = this.inkOf("valve plate");
    disk(pen, 0, 0, outer);

    // A bore's opening reaches half of the ramp beyond its middle on both sides.
    const reach = ramp / 2;
    const thickness = 1.3 * kidney;
    pen.lineWidth = thickness;
    pen.strokeStyle = this.shades[0];
    arc(pen, radius, shape.suctionOpen + reach, shape.suctionClose - reach);
    pen.strokeStyle = this.shadeOfLine();
    arc(pen, radius, shape.dischargeOpen + reach, shape.dischargeClose - reach);
    pen.lineWidth = 0.3 * thickness;
    arc(pen, radius, shape.dischargeOpen + reach - groove, shape.dischargeOpen + reach);
    pen.strokeStyle = this.shades[0];
    arc(pen, radius, shape.suctionOpen + reach - groove, shape.suctionOpen + reach);
    if (fault?.scratch) {
      pen.strokeStyle = ink.mark;
      arc(pen, radius, Math.PI - 0.3, shape.dischargeOpen + reach);
    }
    if (fault?.recess) {
      const [angle, span] = fault.recess;
      pen.strokeStyle = ink.mark;
      arc(pen, 1.12 * outer, angle - span / 2, angle + span / 2);
    }

    for (let piston = 0; piston < this.count; piston++) {
      const angle = this.angleOf(piston);
      const isFaulty = fault?.piston === piston;
      pen.lineWidth = (isFaulty ? 3 : 1.2) / scale;
      pen.strokeStyle = isFaulty ? ink.mark : ink.edge;
      const x = radius * Math.sin(angle);
      const y = radius * Math.cos(angle);
      pen.beginPath();
      pen.arc(x, y, bore / 2, 0, TURN);
      pen.stroke();
      pen.lineWidth = 0.75 * kidney;
      pen.strokeStyle = this.shadeOf(piston);
      arc(pen, radius, angle - reach, angle + reach);
    }
    pen.lineWidth = 1 / scale;
    pen.strokeStyle = ink.edge;
    pen.fillStyle = ink.steel;
    disk(pen, 0, 0, 0.3 * radius);
    for (let n = 0; n < sensors.length; n++) {
      const [x, y] = sensors[n].position;
      const shrink = Math.min(1, rim / Math.hypot(x, y));
      this.drawSensor(pen, n, x * shrink, y * shrink, scale);
    }
    this.nameFace(pen, scale);
  }

  /**
   * Name the two ports, and the pistons by their numbers.
   *
   * @param {Pen} pen
   * @param {number} scale
   */
  nameFace(pen, scale) {
    const { face, ink } = this;
    const { radius, piston: bore } = this.content.shape;
    pen.setTransform(face.ratio, 0, 0, face.ratio, 0, 0);
    pen.textAlign = "center";
    pen.fillStyle = ink.ink;
    const distance = scale * (radius - bore / 2) - 9;
    for (let piston = 0; piston < this.count; piston++) {
      const angle = this.angleOf(piston);
      const x = face.width / 2 + distance * Math.sin(angle);
      pen.fillText(NUMBERS[piston], x, face.height / 2 - distance * Math.cos(angle) + 4);
    }
    pen.fillStyle = ink.soft;
    pen.fillText("top dead center", face.width / 2, 12);
    // Half of a name remains within the edge of a narrow figure.
    const side = Math.min(0.8 * scale * radius + 24, face.width / 2 - 18);
    pen.fillText("outlet", face.width / 2 - side, face.height - 4);
    pen.fillText("inlet", face.width / 2 + side, face.height - 4);
  }

  /** @param {number} angle */
  pixelOf(angle) {
    return LEFT + (angle / TURN) * (this.curves.width - LEFT - RIGHT);
  }

  /**
   * Return the pixel of a value in the upper (pressure) or the lower panel (waveform).
   *
   * @param {number} share from 0 at the lower edge to 1
   * @param {boolean} isUpper
   */
  heightOf(share, isUpper) {
    const panel = this.curves.height / 2 - TOP - BOTTOM;
    const bottom = (isUpper ? this.curves.height / 2 : this.curves.height) - BOTTOM;
    return bottom - share * panel;
  }

  /** @param {number} pressure */
  heightOfPressure(pressure) {
    return this.heightOf(pressure / (1.05 * this.maxPressure), true);
  }

  /** @param {number} reading [m/s²] */
  heightOfReading(reading) {
    return this.heightOf(0.5 + reading / (2.1 * this.maxReading), false);
  }

  /** Draw curves and axes once. */
  paintCurves() {
    const { base, curves, ink } = this;
    const readings = this.waveform[this.sensor];
    const measured = this.measured[this.sensor];
    this.maxReading = largest(measured ? [readings, measured] : [readings]);
    base.canvas.width = curves.canvas.width;
    base.canvas.height = curves.canvas.height;
    base.width = curves.width;
    base.height = curves.height;
    base.ratio = curves.ratio;
    base.clear();

    const { pen } = base;
    pen.fillStyle = ink.soft;
    pen.strokeStyle = ink.edge;
    pen.textAlign = "center";
    for (const isUpper of [true, false]) {
      const bottom = this.heightOf(0, isUpper);
      line(pen, LEFT, bottom, this.pixelOf(TURN), bottom);
      for (let quarter = 0; quarter <= 4; quarter++) {
        const x = this.pixelOf((quarter * TURN) / 4);
        line(pen, x, bottom, x, bottom + 4);
        pen.fillText(`${90 * quarter}°`, Math.min(x, base.width - 14), bottom + 16);
      }
    }
    pen.textAlign = "right";
    for (const pressure of [0, this.maxPressure]) {
      pen.fillText(format(pressure), LEFT - 10, this.heightOfPressure(pressure) + 4);
    }
    for (const reading of [-this.maxReading, 0, this.maxReading]) {
      pen.fillText(format(reading), LEFT - 10, this.heightOfReading(reading) + 4);
    }
    pen.textAlign = "left";
    const pressureUnit = this.content.pressureUnit;
    pen.fillText(`${pressureUnit}: chamber ${this.tracked + 1}, outlet (gray)`, LEFT, 12);
    const title = `m/s²: ${this.content.sensors[this.sensor].name}`;
    const titleHeight = base.height / 2 + 14;
    pen.fillText(title, LEFT + 30, titleHeight);
    if (measured) {
      let x = LEFT + 42 + pen.measureText(title).width;
      for (const [name, color, width] of this.legend()) {
        pen.strokeStyle = color;
        pen.lineWidth = width;
        line(pen, x, titleHeight - 4, x + 16, titleHeight - 4);
        pen.fillText(name, x + 20, titleHeight);
        x += 34 + pen.measureText(name).width;
      }
      pen.lineWidth = 1;
    }

    // The axis of the pressure is the legend of its colors.
    for (let n = 0; n < SHADES; n++) {
      const y = this.heightOfPressure(((n + 1) / SHADES) * this.maxPressure);
      const height = this.heightOfPressure((n / SHADES) * this.maxPressure) - y;
      pen.fillStyle = this.shades[n];
      pen.fillRect(LEFT - 6, y, 5, height + 0.5);
    }
    const toPressure = (/** @type {number} */ value) => this.heightOfPressure(value);
    const toReading = (/** @type {number} */ value) => this.heightOfReading(value);
    this.paintCurve(this.discharge, ink.soft, toPressure);
    this.paintCurve(this.chamber[this.tracked], ink.curve, toPressure);
    if (measured) this.paintCurve(measured, ink.edge, toReading, MEASURED_WIDTH);
    this.paintCurve(readings, ink.curve, toReading);
  }

  /** @returns {[string, string, number][]} name, color and width of both waveforms */
  legend() {
    return [
      ["measured", this.ink.edge, MEASURED_WIDTH],
      ["twin", this.ink.curve, 1.5],
    ];
  }

  /**
   * @param {Float32Array} values
   * @param {string} color
   * @param {(value: number) => number} height
   * @param {number} width
   */
  paintCurve(values, color, height, width = 1.5) {
    const { pen } = this.base;
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.beginPath();
    for (let n = 0; n <= values.length; n++) {
      pen.lineTo(this.pixelOf((n / values.length) * TURN), height(values[n % values.length]));
    }
    pen.stroke();
    pen.lineWidth = 1;
  }

  drawCursor() {
    const { curves, cursor, ink } = this;
    const { pen } = curves;
    curves.clear();
    pen.drawImage(this.base.canvas, 0, 0, curves.width, curves.height);
    cursor.x = this.pixelOf(this.angle);
    cursor.pressure = this.heightOfPressure(valueAt(this.chamber[this.tracked], this.angle));
    const readings = this.waveform[this.sensor];
    cursor.waveform = this.heightOfReading(valueAt(readings, this.angle));

    pen.strokeStyle = ink.ink;
    line(pen, cursor.x, this.heightOf(1, true), cursor.x, this.heightOf(0, true));
    line(pen, cursor.x, this.heightOf(1, false), cursor.x, this.heightOf(0, false));
    const measured = this.measured[this.sensor];
    if (measured) {
      cursor.measured = this.heightOfReading(valueAt(measured, this.angle));
      pen.fillStyle = ink.edge;
      dot(pen, cursor.x, cursor.measured, DOT);
    }
    pen.fillStyle = ink.mark;
    dot(pen, cursor.x, cursor.pressure, DOT);
    dot(pen, cursor.x, cursor.waveform, DOT);
  }
}

/** Names of the pistons: a number that is formatted in each frame would be a new text. */
const NUMBERS = Array.from({ length: 19 }, (_, n) => String(n + 1));

/** @param {number[][]} stops */
function makeShades(stops) {
  return Array.from({ length: SHADES }, (_, n) => {
    const position = (n / (SHADES - 1)) * (stops.length - 1);
    const first = Math.min(Math.floor(position), stops.length - 2);
    const mixed = stops[first].map((low, channel) =>
      Math.round(low + (position - first) * (stops[first + 1][channel] - low)),
    );
    return `rgb(${mixed.join(", ")})`;
  });
}

/** @typedef {CanvasRenderingContext2D} Pen */
/** @typedef {(pen: Pen, x: number, y: number, radius: number) => void} Round */
/** @typedef {(pen: Pen, x: number, y: number, right: number, top: number) => void} Straight */

/** @type {Straight} */
function box(pen, x, y, right, top) {
  pen.fillRect(x, y, right - x, top - y);
  pen.strokeRect(x, y, right - x, top - y);
}

/** @type {Straight} */
function line(pen, x, y, right, top) {
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(right, top);
  pen.stroke();
}

/** @type {Round} */
function dot(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, TURN);
  pen.fill();
}

/** @type {Round} */
function disk(pen, x, y, radius) {
  dot(pen, x, y, radius);
  pen.stroke();
}

/**
 * Draw an arc about the shaft between two shaft angles, which count clockwise from the top.
 *
 * @type {Round}
 */
function arc(pen, radius, from, to) {
  pen.beginPath();
  pen.arc(0, 0, radius, TURN / 4 - from, TURN / 4 - to, true);
  pen.stroke();
}

for (const text of document.querySelectorAll(".living-pump > script[type='application/json']")) {
  new LivingPump(text.parentElement, JSON.parse(text.textContent));
}
