/* A camera that turns around a target, z up. */

const FILLED = 0.84; // of the picture, by the points
const RADIANS = Math.PI / 180;
const VIEWS = {
  "3d": [-64, 26, false],
  top: [-90, 90, true],
  front: [-90, 0, true],
  right: [0, 0, true],
  back: [90, 0, true],
  left: [180, 0, true],
};

class Camera {
  constructor() {
    this.target = [0, 0, 0];
    this.distance = 1;
    this.radius = 1; // of the scene
    this.lift = 0.03; // the middle of the points above that of the picture, where buttons are
    this.fov = 42 * RADIANS;
    this.width = this.height = 1;
    this.look("3d");
  }

  look(name) {
    const [yaw, pitch, flat] = VIEWS[name];
    this.yaw = yaw * RADIANS;
    this.pitch = pitch * RADIANS;
    this.flat = flat;
  }

  /** Unit vectors to the right, up and toward the camera. */
  axes() {
    const sy = Math.sin(this.yaw), cy = Math.cos(this.yaw);
    const sp = Math.sin(this.pitch), cp = Math.cos(this.pitch);
    return { right: [-sy, cy, 0], up: [-sp * cy, -sp * sy, cp], toward: [cp * cy, cp * sy, sp] };
  }

  /** Columns of the matrix to clip coordinates. The fourth, w, is the depth, or 1 if flat. */
  matrix() {
    const { right, up, toward } = this.axes();
    const { near, far } = this.planes();
    const eye = this.target.map((t, i) => t + this.distance * toward[i]);
    const slope = Math.tan(this.fov / 2), aspect = this.width / this.height;
    const half = this.flat ? slope * this.distance : slope;
    const depth = this.flat
      ? { scale: 2 / (far - near), offset: -(far + near) / (far - near), w: 0, one: 1 }
      : { scale: (far + near) / (far - near), offset: (-2 * far * near) / (far - near), w: 1, one: 0 };
    const m = new Float64Array(16);
    const sum = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
    for (let i = 0; i < 3; i++) {
      m[4 * i] = right[i] / (half * aspect);
      m[4 * i + 1] = up[i] / half;
      m[4 * i + 2] = -toward[i] * depth.scale;
      m[4 * i + 3] = -toward[i] * depth.w;
    }
    m[12] = -sum(right) / (half * aspect);
    m[13] = -sum(up) / half;
    m[14] = sum(toward) * depth.scale + depth.offset;
    m[15] = sum(toward) * depth.w + depth.one;
    return m;
  }

  planes() {
    const far = this.distance + 2.5 * this.radius;
    const near = this.distance - 2.5 * this.radius;
    return { near: this.flat ? near : Math.max(near, 0.002 * this.distance), far };
  }

  /** Units of the file in one pixel at the target. */
  unitsPerPixel() {
    return (2 * Math.tan(this.fov / 2) * this.distance) / this.height;
  }

  /** Place in pixels and depth of a point. */
  project(x, y, z, m = this.matrix()) {
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    return {
      x: (((m[0] * x + m[4] * y + m[8] * z + m[12]) / w + 1) * this.width) / 2,
      y: ((1 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * this.height) / 2,
      depth: m[2] * x + m[6] * y + m[10] * z + m[14],
      ahead: w > 0,
    };
  }

  turn(dx, dy) {
    this.yaw -= dx * 0.0065;
    this.pitch = Math.min(Math.max(this.pitch + dy * 0.0065, -Math.PI / 2), Math.PI / 2);
    this.flat = false;
  }

  pan(dx, dy) {
    const { right, up } = this.axes(), size = this.unitsPerPixel();
    for (let i = 0; i < 3; i++) this.target[i] += size * (dy * up[i] - dx * right[i]);
  }

  /** Come nearer by a factor below 1; the place under the cursor stays there. */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const before = this.unitsPerPixel();
    const nearest = 1e-5 * this.radius, farthest = 50 * this.radius;
    this.distance = Math.min(Math.max(this.distance * factor, nearest), farthest);
    const change = before - this.unitsPerPixel();
    const { right, up } = this.axes();
    const across = (x - this.width / 2) * change, down = (y - this.height / 2) * change;
    for (let i = 0; i < 3; i++) this.target[i] += across * right[i] - down * up[i];
  }

  /** Look at all points but a few that lie far away. */
  fit(sample) {
    const { right, up, toward } = this.axes();
    const along = ([x, y, z]) => Float64Array.from({ length: sample.length / 3 }, (_, i) =>
      sample[3 * i] * x + sample[3 * i + 1] * y + sample[3 * i + 2] * z);
    const [across, high, near] = [right, up, toward].map(along);
    const slope = Math.tan(this.fov / 2), ends = [across, high, near].map(range);
    const at = ends.map(({ middle }) => middle);
    let distance = Math.max(...ends.map(({ half }) => half)) / slope;
    for (let round = 0; round < 8; round++) {
      // Where the points would be seen, in halves of the height; near ones are larger.
      const enlarged = near.map((n) => (this.flat ? 1 / distance : 1 / Math.max(distance - n + at[2], 0.1 * distance)));
      const [x, y] = [across, high].map((values, i) => range(values.map((v, j) => (v - at[i]) * enlarged[j])));
      at[0] += x.middle * distance;
      at[1] += (y.middle - this.lift * slope) * distance;
      const filled = Math.max(x.half / (this.width / this.height), y.half) / slope;
      distance *= Math.max(filled / FILLED, 1e-3) ** 0.9;
    }
    for (let i = 0; i < 3; i++) this.target[i] = at[0] * right[i] + at[1] * up[i] + at[2] * toward[i];
    this.distance = distance || 1;
  }
}

/** Middle and half length of the values, without a few that are far from all others. */
function range(values) {
  const sorted = Float64Array.from(values).sort(), last = sorted.length - 1;
  const at = (share) => sorted[Math.round(share * last)];
  const reach = 0.35 * (at(0.98) - at(0.02));
  const low = Math.max(at(0.0005), at(0.02) - reach), high = Math.min(at(0.9995), at(0.98) + reach);
  return { middle: (low + high) / 2, half: (high - low) / 2 };
}
