/* Picking of points, measuring between them, and what is drawn over the picture. */

const REACH = 12; // pixels around the cursor in which a point is picked

/** The point under the cursor: of those within reach, the nearest to it among the front ones. */
function pick(renderer, x, y, reach = REACH) {
  const { camera } = renderer, m = camera.matrix();
  const found = [];
  const size = renderer.pointScale(1);
  for (const { cloud, from, to } of renderer.shownParts()) {
    if (x < from * camera.width || x > to * camera.width) continue;
    gather(cloud, m, camera, x, y, reach, found);
  }
  if (!found.length) return null;
  // What the eye sees at the cursor: the front one of the points drawn over it, if there is any.
  const radius = (hit) => Math.min(Math.max(size.scale / hit.w, size.least), size.most) / 2 / renderer.ratio;
  const over = found.filter((hit) => hit.away <= Math.max(2, radius(hit)));
  const front = over.length ? over : found;
  const first = front.reduce((best, hit) => (hit.depth < best.depth ? hit : best));
  const near = first.depth + 2.5 * renderer.spacing + 0.004 * camera.distance;
  return front
    .filter((hit) => hit.depth <= near)
    .reduce((best, hit) => (hit.away < best.away ? hit : best));
}

function gather(cloud, m, camera, x, y, reach, found) {
  const { steps: p, step, visible } = cloud;
  const halfWidth = camera.width / 2, halfHeight = camera.height / 2;
  const { toward } = camera.axes();
  const offset = camera.distance + dot(toward, camera.target);
  for (let i = 0, j = 0; i < cloud.loaded; i++, j += 3) {
    if (!visible[i]) continue;
    const a = p[j] * step, b = p[j + 1] * step, c = p[j + 2] * step;
    const w = m[3] * a + m[7] * b + m[11] * c + m[15];
    if (w <= 0) continue;
    const dx = ((m[0] * a + m[4] * b + m[8] * c + m[12]) / w + 1) * halfWidth - x;
    if (dx > reach || dx < -reach) continue;
    const dy = (1 - (m[1] * a + m[5] * b + m[9] * c + m[13]) / w) * halfHeight - y;
    const away = Math.hypot(dx, dy);
    if (away > reach) continue;
    const depth = offset - (a * toward[0] + b * toward[1] + c * toward[2]);
    if (depth <= camera.planes().near) continue;
    found.push({ cloud, i, away, depth, w });
  }
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** A point's place from the middle of the scene, in units of the file. */
function placeOf({ cloud, i }) {
  return [0, 1, 2].map((axis) => cloud.steps[3 * i + axis] * cloud.step);
}

/** Marks of the picked point and of measured ones, in SVG over the picture. */
class Overlay {
  constructor(svg, camera, scene) {
    Object.assign(this, { svg, camera, scene, picked: null, measured: [] });
  }

  draw() {
    const m = this.camera.matrix(), marks = [];
    const at = (hit) => this.camera.project(...placeOf(hit), m);
    if (this.picked) {
      const { x, y, ahead } = at(this.picked);
      if (ahead) marks.push(svgNode("circle", { cx: x, cy: y, r: 8, class: "picked" }));
    }
    const places = this.measured.map(at);
    places.forEach((place, i) => {
      if (i > 0 && place.ahead && places[i - 1].ahead) {
        marks.push(...segmentMarks(places[i - 1], place, this.lengthText(i)));
      }
    });
    for (const { x, y, ahead } of places) {
      if (ahead) marks.push(svgNode("circle", { cx: x, cy: y, r: 4.5, class: "measured" }));
    }
    this.svg.replaceChildren(...marks);
  }

  lengthText(i) {
    const { length } = this.leg(i);
    return numberText(length, lengthError(this.scene)) + this.scene.unit;
  }

  /** The way from one measured point to the next, between coordinates as in the file. */
  leg(i) {
    const [a, b] = [this.measured[i - 1], this.measured[i]];
    const from = this.scene.coordinates(a.cloud, a.i), to = this.scene.coordinates(b.cloud, b.i);
    const [dx, dy, dz] = to.map((value, axis) => value - from[axis]);
    return { dx, dy, dz, length: Math.hypot(dx, dy, dz), level: Math.hypot(dx, dy) };
  }

  total() {
    let sum = 0;
    for (let i = 1; i < this.measured.length; i++) sum += this.leg(i).length;
    return sum;
  }
}

/** How far a length may be off; for exact coordinates a step, so that digits end somewhere. */
function lengthError(scene) {
  return scene.manifest.error > 0 ? 2 * scene.manifest.error : scene.step / 2;
}

function segmentMarks(a, b, text) {
  const label = svgNode("text", { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 - 8, class: "length" });
  label.textContent = text;
  const line = { x1: a.x, y1: a.y, x2: b.x, y2: b.y };
  return [svgNode("line", { ...line, class: "under" }), svgNode("line", { ...line, class: "leg" }), label];
}

function svgNode(name, attributes) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
}

/** Pairs of points: short lines along the normals of shown points, at most `most` of them. */
function normalLines(scene, parts, length, most = 30_000) {
  const attribute = scene.normalAttribute(), lines = [];
  const n = parts.reduce((sum, { cloud }) => sum + cloud.loaded, 0);
  for (const { cloud } of parts) {
    const codes = cloud.codes.get(attribute);
    if (!codes) continue;
    const stop = Math.min(cloud.loaded, Math.ceil((most * cloud.loaded) / n));
    for (let i = 0; i < stop; i++) {
      const normal = cloud.visible[i] ? decodeNormal(codes[0][i], codes[1][i]) : null;
      if (!normal) continue;
      const place = placeOf({ cloud, i });
      lines.push(...place, ...place.map((x, axis) => x + length * normal[axis]));
    }
  }
  return new Float32Array(lines);
}

/** The twelve edges of a box as pairs of points. */
function boxLines({ low, high }) {
  const lines = [];
  const corner = (bits) => [0, 1, 2].map((axis) => ((bits >> axis) & 1 ? high : low)[axis]);
  for (let bits = 0; bits < 8; bits++) {
    for (let axis = 0; axis < 3; axis++) {
      if (!((bits >> axis) & 1)) lines.push(...corner(bits), ...corner(bits | (1 << axis)));
    }
  }
  return new Float32Array(lines);
}

/** A length of 1, 2 or 5 times a power of ten that takes about 120 pixels, and its width. */
function scaleBar(camera) {
  const unit = camera.unitsPerPixel(), wanted = 120 * unit;
  const power = 10 ** Math.floor(Math.log10(wanted));
  const length = [5, 2, 1].map((factor) => factor * power).find((value) => value <= wanted) ?? power;
  return { length, pixels: length / unit };
}
