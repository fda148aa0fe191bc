/* The clouds and attributes of the page: loading, what is visible, and its colors. */

const HIDDEN = 0, SHOWN = 1, MARKED = 2;
const LAST_CODE = 65535;
const CUTOFF = 3, CLEAR_ERROR = 10; // of the detector's score

class Scene {
  constructor(manifest) {
    this.manifest = manifest;
    this.step = manifest.step;
    this.middle = manifest.middle; // steps; far stray points do not move it
    this.size = manifest.extent.map((steps) => steps * manifest.step);
    this.low = manifest.low;
    this.unit = manifest.unit ? ` ${manifest.unit}` : "";
    this.attributes = [...manifest.attributes.map((a) => ({ ...a })), this.heightAttribute()];
    this.attributes.forEach(prepareAttribute);
    this.clouds = manifest.clouds.map((told) => this.emptyCloud(told));
    this.n = this.clouds.reduce((sum, cloud) => sum + cloud.n, 0);
    this.total = this.clouds.reduce((sum, cloud) => sum + cloud.total, 0);
    this.filters = new Map(); // attribute -> [lowest code, highest code] of what is shown
    this.threshold = { attribute: null, code: LAST_CODE, mode: "off", chosen: false }; // chosen: the code is the user's
    this.box = { on: false, low: [0, 0, 0], high: [1, 1, 1] };
    this.color = this.attributes.find((a) => a.name === manifest.start) ?? this.attributes.at(-1);
    this.chosenPalette = null;
  }

  get palette() {
    return this.chosenPalette ?? (this.color.signed ? "blue-red" : "viridis");
  }

  set palette(name) {
    this.chosenPalette = name;
  }

  /** The name of a cloud, with a word if it lacks the attribute that colors. */
  nameOf(cloud) {
    return cloud.codes.has(this.color) ? cloud.name : `${cloud.name} (gray: it has no ${this.color.name})`;
  }

  heightAttribute() {
    const [first, last] = this.manifest.heights; // of nearly all points, in steps
    const step = ((last - first) * this.step) / (LAST_CODE - 1) || 1;
    const low = this.low[2] + first * this.step;
    return { name: this.manifest.own_height, kind: "number", low, step, error: step / 2, own: true, unit: this.unit };
  }

  emptyCloud(told) {
    const cloud = {
      ...told,
      step: this.step,
      shown: true,
      loaded: 0,
      nVisible: 0,
      steps: new Int32Array(3 * told.n), // from the middle
      rows: new Uint32Array(told.n),
      visible: new Uint8Array(told.n),
      colors: new Uint32Array(told.n),
      codes: new Map(),
    };
    for (const index of told.attributes) {
      const attribute = this.attributes[index];
      cloud.codes.set(attribute, emptyCodes(attribute, told.n));
    }
    cloud.codes.set(this.attributes.at(-1), [new Uint16Array(told.n)]);
    return cloud;
  }

  /** Unpack all chunks, the first of each cloud first; `grown(cloud, start, stop)` after each. */
  async load(grown) {
    const blocks = [...document.querySelectorAll("script.block")];
    const longest = Math.max(...this.clouds.map((cloud) => cloud.chunks.length));
    for (let i = 0; i < longest; i++) {
      for (const cloud of this.clouds) {
        if (i < cloud.chunks.length) {
          const start = cloud.loaded;
          await this.loadChunk(cloud, cloud.chunks[i], blocks);
          this.update(cloud, start, cloud.loaded);
          grown(cloud, start, cloud.loaded);
        }
      }
    }
  }

  async loadChunk(cloud, chunk, blocks) {
    const columns = await Promise.all(
      chunk.columns.map(async ([width, delta, block, size]) => {
        const bytes = await inflate(blocks[block].textContent, size);
        blocks[block].textContent = ""; // frees it
        return unpack(bytes, chunk.n, width, delta);
      }),
    );
    const start = cloud.loaded;
    for (let axis = 0; axis < 3; axis++) {
      scatter(columns[axis], cloud.steps, start, { stride: 3, offset: axis, less: this.middle[axis] });
    }
    scatter(columns[3], cloud.rows, start);
    let next = 4;
    for (const index of cloud.attributes) {
      for (const codes of cloud.codes.get(this.attributes[index])) {
        scatter(columns[next++], codes, start);
      }
    }
    const height = this.attributes.at(-1);
    const scale = this.step / height.step, [first] = this.manifest.heights;
    const heights = columns[2];
    for (let i = 0; i < chunk.n; i++) {
      heights[i] = Math.min(Math.max(Math.round((heights[i] - first) * scale) + 1, 1), LAST_CODE);
    }
    scatter(heights, cloud.codes.get(height)[0], start);
    for (const attribute of this.attributes) {
      count(attribute, cloud, start, start + chunk.n);
    }
    cloud.loaded += chunk.n;
  }

  /** Decide anew which points are shown, and how they are colored. */
  update(cloud, start = 0, stop = cloud.loaded) {
    this.judge(cloud, start, stop);
    this.paint(cloud, start, stop);
  }

  judge(cloud, start = 0, stop = cloud.loaded) {
    const visible = cloud.visible;
    visible.fill(SHOWN, start, stop);
    for (const attribute of this.attributes) {
      const codes = cloud.codes.get(attribute)?.[0];
      if (!codes) continue;
      if (attribute.kind === "class" && attribute.off.some(Boolean)) {
        const off = attribute.off;
        for (let i = start; i < stop; i++) if (off[codes[i]]) visible[i] = HIDDEN;
      }
      const limits = this.filters.get(attribute);
      if (limits) {
        const [low, high] = limits;
        for (let i = start; i < stop; i++) if (codes[i] < low || codes[i] > high) visible[i] = HIDDEN;
      }
    }
    this.judgeThreshold(cloud, start, stop);
    if (this.box.on) this.judgeBox(cloud, start, stop);
    let n = 0;
    for (let i = 0; i < cloud.loaded || i < stop; i++) if (visible[i]) n++;
    cloud.nVisible = n;
  }

  judgeThreshold(cloud, start, stop) {
    const { attribute, code, mode } = this.threshold;
    const codes = cloud.codes.get(attribute)?.[0];
    if (!codes || mode === "off") return;
    const above = mode === "mark" ? MARKED : mode === "only" ? SHOWN : HIDDEN;
    const below = mode === "only" ? HIDDEN : SHOWN;
    const visible = cloud.visible;
    for (let i = start; i < stop; i++) {
      if (visible[i]) visible[i] = codes[i] > code ? above : below;
    }
  }

  judgeBox(cloud, start, stop) {
    const { low, high } = this.boxBounds();
    const [a, b, c] = low.map((x) => x / this.step), [d, e, f] = high.map((x) => x / this.step);
    const p = cloud.steps, visible = cloud.visible;
    for (let i = start, j = 3 * start; i < stop; i++, j += 3) {
      const x = p[j], y = p[j + 1], z = p[j + 2];
      if (x < a || x > d || y < b || y > e || z < c || z > f) visible[i] = HIDDEN;
    }
  }

  /** The corners of the section box from the middle of the scene; a bit larger than its points. */
  boxBounds() {
    const margin = this.step;
    const at = (share, axis) => share * this.size[axis] - this.middle[axis] * this.step;
    return {
      low: this.box.low.map((share, axis) => at(share, axis) - margin),
      high: this.box.high.map((share, axis) => at(share, axis) + margin),
    };
  }

  paint(cloud, start = 0, stop = cloud.loaded) {
    const components = cloud.codes.get(this.color), colors = cloud.colors;
    if (!components) colors.fill(packHex(NONE), start, stop);
    else if (this.color.kind === "rgb") paintRgb(components, colors, start, stop);
    else if (this.color.kind === "normal") paintNormals(components, colors, start, stop);
    else {
      const table = this.colorTable(), codes = components[0];
      for (let i = start; i < stop; i++) colors[i] = table[codes[i]];
    }
    if (this.threshold.mode === "mark") {
      const mark = packHex(OUTLIER), visible = cloud.visible;
      for (let i = start; i < stop; i++) if (visible[i] === MARKED) colors[i] = mark;
    }
  }

  /** The packed color of each code of the attribute that colors. */
  colorTable() {
    const attribute = this.color;
    if (attribute.kind === "class") return Uint32Array.from(attribute.colors, packHex);
    const table = new Uint32Array(LAST_CODE + 1).fill(packHex(NONE));
    const steps = paletteSteps(this.palette).map((rgb) => packColor(...rgb));
    const [low, high] = this.colorRange(attribute);
    for (let code = 1; code <= LAST_CODE; code++) {
      const share = (code - low) / Math.max(high - low, 1);
      table[code] = steps[Math.round(255 * Math.min(Math.max(share, 0), 1))];
    }
    return table;
  }

  /** Codes at the ends of the palette: chosen, or without the extreme hundredths. */
  colorRange(attribute) {
    if (attribute.range) return attribute.range;
    const low = quantileCode(attribute, 0.01);
    if (attribute.signed) { // 0 is in the middle
      const middle = (1 + LAST_CODE) / 2;
      const half = Math.max(middle - low, quantileCode(attribute, 0.99) - middle, 1);
      return [Math.floor(middle - half), Math.ceil(middle + half)];
    }
    if (attribute.name === "outlier_score") return [low, Math.max(encodeNumber(attribute, CLEAR_ERROR), low + 1)];
    return [low, Math.max(quantileCode(attribute, 0.99), low + 1)];
  }

  /** Coordinates of a point as in the file. */
  coordinates(cloud, i) {
    return [0, 1, 2].map((axis) =>
      this.low[axis] + (cloud.steps[3 * i + axis] + this.middle[axis]) * this.step);
  }

  /** Names and values of all that differs from point to point. */
  describe(cloud, i) {
    const rows = [];
    for (const attribute of this.attributes) {
      const codes = cloud.codes.get(attribute);
      if (codes && !attribute.own) rows.push([attribute.name, valueText(attribute, codes, i)]);
    }
    return rows;
  }

  outlierAttribute() {
    return this.attributes.find((attribute) => attribute.outliers?.length);
  }

  normalAttribute() {
    return this.attributes.find((attribute) => attribute.kind === "normal");
  }

  nVisible() {
    return this.clouds.reduce((sum, c) => sum + (c.shown ? c.nVisible : 0), 0);
  }
}

function prepareAttribute(attribute) {
  attribute.known = 0; // points with a value
  if (attribute.kind === "class") {
    attribute.colors = classColors(attribute);
    attribute.off = new Uint8Array(attribute.values.length);
    attribute.counts = new Uint32Array(attribute.values.length);
  } else if (attribute.kind === "number") {
    attribute.counts = new Uint32Array(LAST_CODE + 1);
  }
}

function emptyCodes(attribute, n) {
  if (attribute.kind === "rgb") return [0, 1, 2].map(() => new Uint8Array(n));
  if (attribute.kind === "normal") return [0, 1].map(() => new Uint16Array(n));
  const small = attribute.kind === "class" && attribute.values.length <= 256;
  return [small ? new Uint8Array(n) : new Uint16Array(n)];
}

function count(attribute, cloud, start, stop) {
  const codes = cloud.codes.get(attribute)?.[0], counts = attribute.counts;
  if (!codes || !counts) return;
  for (let i = start; i < stop; i++) counts[codes[i]]++;
  attribute.known += stop - start;
  attribute.cumulative = null;
}

/** How many points have a code up to the given one; of numbers, those with a value. */
function countUpTo(attribute, code) {
  if (!attribute.cumulative) {
    const sums = new Float64Array(attribute.counts.length);
    for (let i = 1; i < sums.length; i++) sums[i] = sums[i - 1] + attribute.counts[i];
    attribute.cumulative = sums;
  }
  return attribute.cumulative[code];
}

/** The code below which a share of the points with a value lies. */
function quantileCode(attribute, share) {
  const wanted = share * countUpTo(attribute, LAST_CODE);
  let low = 1, high = LAST_CODE;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (attribute.cumulative[middle] >= wanted) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** The number of a code from 1 on. */
function decodeNumber(attribute, code) {
  const value = attribute.low + attribute.step * (code - 1);
  return attribute.width === undefined
    ? value
    : attribute.center + attribute.width * Math.sinh(value);
}

/** The largest code whose number is at most a value. */
function encodeNumber(attribute, value) {
  let number = value;
  if (attribute.width !== undefined) {
    number = Math.asinh(value / attribute.width - attribute.center / attribute.width);
  }
  const code = Math.floor((number - attribute.low) / attribute.step + 1e-9) + 1;
  return Math.min(Math.max(code, 0), LAST_CODE);
}

/** The unit vector of two codes; null for none. */
function decodeNormal(u, v) {
  if (u === 0) return null;
  let x = (u - 1) / 2047 - 1, y = (v - 1) / 2047 - 1;
  const z = 1 - Math.abs(x) - Math.abs(y);
  if (z < 0) {
    [x, y] = [(1 - Math.abs(y)) * (x >= 0 ? 1 : -1), (1 - Math.abs(x)) * (y >= 0 ? 1 : -1)];
  }
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}

function paintRgb([red, green, blue], colors, start, stop) {
  for (let i = start; i < stop; i++) colors[i] = packColor(red[i], green[i], blue[i]);
}

function paintNormals([u, v], colors, start, stop) {
  const none = packHex(NONE);
  for (let i = start; i < stop; i++) {
    const normal = decodeNormal(u[i], v[i]);
    colors[i] = normal ? normalColor(...normal) : none;
  }
}

/** A number with the digits that it has; `error` is how far it may be off. */
function numberText(value, error = 0) {
  if (!Number.isFinite(value)) return "none";
  if (value === 0) return "0";
  if (error > 0) {
    const digits = Math.max(0, Math.min(12, -Math.floor(Math.log10(2 * error))));
    if (Math.abs(value) < 1e7 && digits <= 7) return value.toFixed(digits);
  }
  const size = Math.abs(value);
  if (size >= 1e7 || size < 1e-4) return value.toExponential(3);
  return String(Number(value.toPrecision(size >= 1000 ? 7 : 4)));
}

/** Numbers along an axis, each to a hundredth of the distance to the nearest of its neighbors. */
function axisTexts(values) {
  return values.map((value, i) => {
    const gaps = [i - 1, i + 1].filter((j) => j in values).map((j) => Math.abs(values[j] - value));
    const decimals = 2 - Math.floor(Math.log10(Math.min(...gaps)));
    const text = String(Number(value.toFixed(Math.min(Math.max(decimals, 0), 100))));
    return text.length > 12 ? numberText(value) : text;
  });
}

/** The values of two codes, and of the one between them. */
function rangeTexts(attribute, [low, high]) {
  return axisTexts([low, (low + high) / 2, high].map((code) => decodeNumber(attribute, code)));
}

function valueText(attribute, codes, i) {
  if (attribute.kind === "rgb") return codes.map((component) => component[i]).join(" ");
  if (attribute.kind === "normal") {
    const normal = decodeNormal(codes[0][i], codes[1][i]);
    return normal ? normal.map((x) => x.toFixed(4)).join(" ") : "none";
  }
  const code = codes[0][i];
  if (attribute.kind === "class") return className(attribute, code);
  if (code === 0) return "none";
  const value = decodeNumber(attribute, code);
  if (attribute.error === 0) return String(value);
  const relative = (attribute.relative ?? 0) * Math.abs(value - (attribute.center ?? 0));
  return numberText(value, Math.max(attribute.error, relative));
}

function className(attribute, code) {
  const value = attribute.values[code], name = attribute.names[value];
  return name ? `${value} ${name}` : String(value);
}
