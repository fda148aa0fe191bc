/* The page: brings scene, renderer, panel and hands together. */

class App {
  constructor(manifest) {
    this.scene = new Scene(manifest);
    this.camera = new Camera();
    this.camera.radius = Math.hypot(...this.scene.size) / 2 || 1;
    this.renderer = new Renderer(byId("canvas"), this.scene, this.camera);
    this.overlay = new Overlay(byId("overlay"), this.camera, this.scene);
    this.normalLength = 4;
    this.normalsOn = false;
    this.measuring = false;
    this.pair = [0, 1];
    this.outlierMode = "all";
    this.loaded = false;
    byId("title").textContent = manifest.title;
    this.comparing = this.scene.clouds.length > 1;
    this.panel = new Panel(this);
    this.buildTools();
    this.buildHelp();
    this.setTheme(matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark");
    this.compare(this.comparing);
    this.renderer.afterFrame = () => this.drawOverlays();
    new ResizeObserver(() => this.renderer.resize()).observe(byId("stage"));
    this.renderer.resize();
    this.listen();
  }

  async load() {
    const started = performance.now();
    let fitted = false;
    await this.scene.load((cloud, start, stop) => {
      this.renderer.grow(cloud, start, stop);
      if (!fitted) {
        this.fit();
        fitted = true;
        this.firstShown = performance.now() - started;
      }
      const done = this.scene.clouds.reduce((sum, c) => sum + c.loaded, 0) / this.scene.n;
      byId("loading").firstElementChild.style.width = `${100 * done}%`;
      this.showCounts();
    });
    this.fit();
    byId("loading").hidden = true;
    const { threshold } = this.scene;
    if (threshold.mode === "off" && !threshold.chosen) threshold.code = null;
    this.panel.build(); // with all counts, and what the user set meanwhile
    this.judgeAll();
    this.paintAll();
    this.loadTime = performance.now() - started;
    this.loaded = true;
  }

  // What is shown

  /** Decide anew which points are shown; colors change too if a threshold marks points. */
  judgeAll() {
    const marks = this.scene.threshold.mode === "mark";
    for (const cloud of this.scene.clouds) {
      this.scene.judge(cloud);
      this.renderer.refreshVisible(cloud);
    }
    if (marks || this.marked) this.paintAll();
    this.marked = marks;
    if (this.normalsOn) this.showNormals(true);
    this.clearIfHidden();
    this.countAndDraw();
  }

  paintAll() {
    for (const cloud of this.scene.clouds) {
      this.scene.paint(cloud);
      this.renderer.refreshColors(cloud);
    }
    this.countAndDraw();
  }

  /** Once before the next frame, however often a slider moves until then. */
  soon(...acts) {
    this.waiting ??= new Set();
    if (!this.waiting.size) {
      requestAnimationFrame(() => {
        const all = [...this.waiting];
        this.waiting.clear();
        for (const act of all) this[act]();
      });
    }
    for (const act of acts) this.waiting.add(act);
    this.renderer.changed();
  }

  countAndDraw() {
    this.showCounts();
    this.showLegend();
    this.renderer.changed();
  }

  showCounts() {
    const { scene } = this, shown = scene.nVisible();
    const all = scene.clouds.reduce((sum, c) => sum + (c.shown ? c.n : 0), 0);
    const part = shown < all ? `${grouped(shown)} of ${grouped(all)} points shown` : `${grouped(all)} ${all === 1 ? "point" : "points"}`;
    const thinned = scene.n < scene.total ? `, thinned from ${grouped(scene.total)}` : "";
    byId("counts").textContent = part + thinned;
  }

  showLegend() {
    byId("legend").replaceChildren(...legendParts(this.scene));
  }

  colorBy(attribute) {
    this.scene.color = attribute;
    this.panel.showColor();
    this.compare(this.comparing); // names say which cloud lacks the attribute
    this.paintAll();
  }

  showOutliers(mode) {
    const attribute = this.scene.outlierAttribute();
    if (!attribute) return;
    attribute.off.forEach((_, code) => {
      const is = attribute.outliers.includes(code);
      attribute.off[code] = (mode === "hide" && is) || (mode === "only" && !is) ? 1 : 0;
    });
    this.outlierMode = mode;
    this.panel.outlierBox.press(mode);
    this.panel.showColor();
    this.judgeAll();
  }

  showNormals(on) {
    this.normalsOn = on && Boolean(this.scene.normalAttribute());
    const length = this.normalLength * this.renderer.spacing;
    const lines = this.normalsOn ? normalLines(this.scene, this.renderer.shownParts(), length) : null;
    this.renderer.setLines("normals", lines, this.dark ? [0.95, 0.9, 0.55] : [0.1, 0.25, 0.55]);
    const input = byId("normals");
    if (input) input.checked = this.normalsOn;
  }

  cut(on) {
    this.scene.box.on = on;
    this.showBox();
    this.judgeAll();
  }

  showBox() {
    const { box } = this.scene;
    byId("box").checked = box.on;
    const lines = box.on ? boxLines(this.scene.boxBounds()) : null;
    this.renderer.setLines("box", lines, this.dark ? [0.45, 0.52, 0.6] : [0.5, 0.56, 0.64]);
  }

  resetBox() {
    this.scene.box = { on: false, low: [0, 0, 0], high: [1, 1, 1] };
    this.panel.showBoxEnds();
    this.cut(false);
  }

  // Two clouds beside each other

  compare(on) {
    const able = on && this.scene.clouds.length > 1;
    this.comparing = able;
    const [left, right] = this.pair.map((i) => this.scene.clouds[i]);
    this.renderer.split = able ? { left, right, at: this.renderer.split?.at ?? 0.5 } : null;
    byId("divider").hidden = !able;
    if (able) {
      byId("left-name").textContent = this.scene.nameOf(left);
      byId("right-name").textContent = this.scene.nameOf(right);
      this.moveDivider(this.renderer.split.at);
    }
    this.renderer.changed();
  }

  compareWith(side, number) {
    this.pair[side] = number;
    byId("compare").checked = true;
    this.compare(true);
  }

  moveDivider(share) {
    this.renderer.split.at = Math.min(Math.max(share, 0.02), 0.98);
    byId("divider").style.left = `${100 * this.renderer.split.at}%`;
    byId("divider").setAttribute("aria-valuenow", Math.round(100 * this.renderer.split.at));
    this.renderer.changed();
  }

  // The camera

  fit() {
    const { camera } = this, sample = [];
    for (const { cloud } of this.renderer.shownParts()) {
      const stop = Math.min(cloud.loaded, 40_000);
      for (let i = 0; i < stop; i++) if (cloud.visible[i]) sample.push(...placeOf({ cloud, i }));
    }
    if (sample.length) camera.fit(sample);
    this.renderer.changed();
  }

  look(name) {
    this.camera.look(name);
    this.fit();
  }

  // Picking and measuring

  click(x, y) {
    const hit = pick(this.renderer, x, y);
    if (this.measuring) {
      if (hit) this.overlay.measured.push(hit);
    } else this.overlay.picked = hit;
    this.showCard();
    this.drawOverlays();
  }

  center(x, y) {
    const hit = pick(this.renderer, x, y);
    if (!hit) return;
    this.camera.target = placeOf(hit);
    this.camera.zoom(0.5);
    this.renderer.changed();
  }

  measure(on) {
    this.measuring = on;
    this.overlay.measured = [];
    if (on) this.overlay.picked = null;
    byId("stage").classList.toggle("measuring", on);
    byId("tool-measure", ICONS.measure).setAttribute("aria-pressed", on);
    this.showCard();
    this.drawOverlays();
  }

  clearIfHidden() {
    const shown = (hit) => hit.cloud.visible[hit.i] && (this.renderer.split || hit.cloud.shown);
    if (this.overlay.picked && !shown(this.overlay.picked)) {
      this.overlay.picked = null;
      this.showCard();
    }
  }

  showCard() {
    const card = byId("card"), { picked } = this.overlay;
    const parts = this.measuring ? measureCard(this.overlay, this.scene) : picked ? pointCard(picked, this.scene) : null;
    card.hidden = !parts;
    if (!parts) return;
    const close = node("button", { type: "button", className: "close", "aria-label": "Close" }, "×");
    close.addEventListener("click", () => this.escape());
    card.replaceChildren(close, ...parts);
  }

  escape() {
    byId("help").hidden = true;
    if (this.measuring) this.measure(false);
    this.overlay.picked = null;
    this.showCard();
    this.drawOverlays();
  }

  drawOverlays() {
    this.overlay.draw();
    const { length, pixels } = scaleBar(this.camera);
    const [bar, text] = byId("scale").children;
    bar.style.width = `${pixels}px`;
    text.textContent = `${numberText(length)}${this.scene.unit}${this.camera.flat ? "" : " at the center"}`;
  }

  // Looks

  setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    this.dark = theme === "dark";
    const page = getComputedStyle(document.documentElement).getPropertyValue("--page").trim();
    this.renderer.background = rgbOf(page.slice(1)).map((value) => value / 255);
    this.renderer.strength = this.dark ? 60 : 34; // dark edges are harsh on a light page
    if (this.normalsOn) this.showNormals(true);
    if (this.scene.box.on) this.showBox();
    this.renderer.changed();
  }

  picture() {
    this.renderer.drawWhole();
    const copy = drawPicture(this.renderer);
    copy.toBlob((blob) => {
      const link = node("a", { href: URL.createObjectURL(blob), download: `${this.scene.manifest.title.replace(/[^\w.-]+/g, "_")}.png` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    }, "image/png");
  }

  buildTools() {
    const nav = byId("tools");
    const tool = (text, title, act, id = "", icon = "") => {
      const button = node("button", { type: "button", title, id, "aria-label": title });
      if (icon) button.append(iconOf(icon));
      button.append(node("span", { className: icon ? "wide" : "" }, text));
      button.addEventListener("click", act);
      nav.append(button);
      return button;
    };
    tool("Settings", "Settings", () => document.body.classList.toggle("panel-open"), "panel-button", ICONS.settings);
    for (const [text, name, key] of [["3D", "3d", 1], ["Top", "top", 2], ["Front", "front", 3], ["Side", "right", 4]]) {
      tool(text, `View: ${text} (${key})`, () => this.look(name));
    }
    tool("Fit", "Show all (F)", () => this.fit(), "tool-fit", ICONS.fit);
    nav.append(node("hr"));
    tool("Measure", "Measure distances (M)", () => this.measure(!this.measuring), "tool-measure", ICONS.measure).setAttribute("aria-pressed", false);
    tool("Picture", "Save a picture (P)", () => this.picture(), "tool-picture", ICONS.picture);
    tool("Theme", "Dark or light (T)", () => this.setTheme(this.dark ? "light" : "dark"), "tool-theme", ICONS.theme);
    tool("?", "Keys (?)", () => this.toggleHelp(), "tool-help");
  }

  buildHelp() {
    const list = node("dl");
    for (const [key, meaning] of HELP) list.append(node("dt", {}, key), node("dd", {}, meaning));
    const close = node("button", { type: "button", className: "close", "aria-label": "Close" }, "×");
    close.addEventListener("click", () => this.toggleHelp());
    byId("help").replaceChildren(close, node("h2", {}, "Hands and keys"), list);
  }

  toggleHelp() {
    byId("help").hidden = !byId("help").hidden;
  }

  listen() {
    listenToPointers(byId("canvas"), this);
    listenToDivider(byId("divider"), this);
    window.addEventListener("keydown", (event) => pressKey(event, this));
    byId("canvas").addEventListener("pointerdown", () => document.body.classList.remove("panel-open"));
  }
}

const HELP = [
  ["drag", "turn"],
  ["right drag, shift drag", "move"],
  ["wheel, pinch", "come nearer to the cursor"],
  ["two fingers", "move and come nearer"],
  ["click", "all that is known of a point"],
  ["double click", "center on a point"],
  ["arrows", "turn; with shift move"],
  ["+ -", "nearer, farther"],
  ["1 2 3 4 5 6", "3D, top, front, right, back, left"],
  ["F", "show all"],
  ["M", "measure; Esc ends it"],
  ["O", "hide and show outliers"],
  ["N", "normals as lines"],
  ["B", "section box"],
  ["C", "next attribute to color by"],
  ["P, T", "picture; dark or light"],
];

const ICONS = {
  settings: "M4 7h9m4 0h3M4 17h3m4 0h9M15 5v4M9 15v4",
  fit: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5",
  measure: "M3 16 16 3l5 5L8 21zM7 12l2 2M10 9l3 3M13 6l2 2",
  picture: "M4 8h3l2-3h6l2 3h3v11H4zM12 10a3.2 3.2 0 1 0 0 6.4a3.2 3.2 0 1 0 0-6.4",
  theme: "M12 4a8 8 0 1 0 0 16a8 8 0 1 0 0-16M12 4v16M12 8h5M12 12h7.5M12 16h5",
};

function iconOf(path) {
  const svg = svgNode("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" });
  svg.append(svgNode("path", { d: path }));
  return svg;
}

function byId(id) {
  return document.getElementById(id);
}

function legendParts(scene) {
  const attribute = scene.color, title = node("b", {}, attribute.unit ? `${attribute.name},${attribute.unit}` : attribute.name);
  if (attribute.kind === "number") {
    const bar = node("div", { className: "bar" });
    bar.style.background = paletteGradient(scene.palette);
    const ends = rangeTexts(attribute, scene.colorRange(attribute)).map((text) => node("span", {}, text));
    return [title, bar, node("div", { className: "ends" }, ...ends)];
  }
  if (attribute.kind !== "class") return [title];
  const codes = attribute.values.map((_, code) => code).filter((code) => !attribute.off[code]);
  if (codes.length > 9) return [node("b", {}, `${attribute.name}: ${grouped(codes.length)} values`)];
  const list = node("ul");
  for (const code of codes) {
    const dot = node("i", { className: "dot" });
    dot.style.setProperty("--dot", `#${attribute.colors[code]}`);
    list.append(node("li", {}, dot, className(attribute, code)));
  }
  return [title, list];
}

function pointCard(hit, scene) {
  const { cloud, i } = hit, list = node("dl");
  const digits = lengthError(scene);
  const add = (name, value) => list.append(node("dt", {}, name), node("dd", { dataset: { name } }, value));
  scene.coordinates(cloud, i).forEach((value, axis) => add("xyz"[axis], numberText(value, digits)));
  for (const [name, value] of scene.describe(cloud, i)) add(name, value);
  const among = cloud.dropped ? [node("p", { className: "note" }, "Row among the points with coordinates.")] : [];
  const title = node("h2", {}, `Row ${grouped(cloud.rows[i])}`, node("small", {}, cloud.name));
  return [title, ...among, list, ...constantRows(cloud)];
}

/** Attributes that are equal for all points, folded. */
function constantRows({ constants }) {
  const entries = Object.entries(constants), list = node("dl");
  if (!entries.length) return [];
  for (const [name, value] of entries) {
    list.append(node("dt", {}, name), node("dd", { dataset: { name } }, String(value)));
  }
  return [node("details", {}, node("summary", {}, `The same for all points (${entries.length})`), list)];
}

function measureCard(overlay, scene) {
  const n = overlay.measured.length, title = node("h2", {}, "Measure");
  if (n < 2) return [title, node("p", {}, n ? "Click the next point." : "Click two points or more.")];
  const { dx, dy, dz, length, level } = overlay.leg(n - 1), list = node("dl");
  const error = lengthError(scene);
  const add = (name, value) => list.append(node("dt", {}, name), node("dd", { dataset: { name } }, numberText(value, error) + scene.unit));
  add("length", length);
  add("horizontal", level);
  add("dx", dx);
  add("dy", dy);
  add("dz", dz);
  if (n > 2) add(`all ${n - 1} parts`, overlay.total());
  return [title, list];
}

/** Mouse, pen and fingers on the picture. */
function listenToPointers(canvas, app) {
  const { camera, renderer } = app, fingers = new Map();
  let travelled = 0, lastTap = { time: 0 };
  const place = (event) => ({ x: event.offsetX, y: event.offsetY });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    if (fingers.size === 1) travelled = 0;
    else travelled = Infinity;
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = place(event), dx = now.x - before.x, dy = now.y - before.y;
    travelled += Math.abs(dx) + Math.abs(dy);
    if (travelled < 4 && event.pointerType === "mouse") return;
    if (fingers.size === 2) pinch(fingers, event.pointerId, now, camera);
    else if (event.buttons & 6 || event.shiftKey) camera.pan(dx, dy);
    else camera.turn(dx, dy);
    fingers.set(event.pointerId, now);
    renderer.changed();
  });
  const lift = (event) => {
    const was = fingers.delete(event.pointerId);
    if (!was || event.type === "pointercancel" || travelled > 8 || event.button > 0) return;
    const now = place(event), time = performance.now();
    const twice = time - lastTap.time < 350 && Math.hypot(now.x - lastTap.x, now.y - lastTap.y) < 20;
    lastTap = { ...now, time: twice ? 0 : time };
    if (twice && !app.measuring) app.center(now.x, now.y);
    else app.click(now.x, now.y);
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    camera.zoom(Math.exp(Math.max(-0.5, Math.min(0.5, event.deltaY * lines * 0.0014))), event.offsetX, event.offsetY);
    renderer.changed();
  }, { passive: false });
}

/** One of two fingers moved: both move and part. */
function pinch(fingers, id, now, camera) {
  const before = fingers.get(id);
  const other = [...fingers].find(([key]) => key !== id)[1];
  const apart = (place) => Math.max(10, Math.hypot(place.x - other.x, place.y - other.y));
  camera.pan((now.x - before.x) / 2, (now.y - before.y) / 2);
  camera.zoom(apart(before) / apart(now), (now.x + other.x) / 2, (now.y + other.y) / 2);
}

function listenToDivider(divider, app) {
  divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
  divider.addEventListener("pointermove", (event) => {
    if (!divider.hasPointerCapture(event.pointerId)) return;
    const { left, width } = byId("stage").getBoundingClientRect();
    app.moveDivider((event.clientX - left) / width);
  });
  divider.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
    if (!way) return;
    event.preventDefault();
    event.stopPropagation();
    app.moveDivider(app.renderer.split.at + way);
  });
}

function pressKey(event, app) {
  if (event.ctrlKey || event.metaKey || event.altKey || isForControl(event)) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  const act = keyAction(event, app);
  if (!act) return;
  event.preventDefault();
  act();
}

/** Whether a key means something to the control that has the focus. */
function isForControl({ key, target }) {
  if (target.tagName === "SELECT") return true;
  if (target.tagName !== "INPUT" || target.type === "checkbox") return false;
  return target.type !== "range" || /^(Arrow|Home|End|Page|[-+])/.test(key);
}

function keyAction({ key, shiftKey }, app) {
  const { camera, renderer, scene } = app;
  const arrows = { ArrowLeft: [30, 0], ArrowRight: [-30, 0], ArrowUp: [0, 30], ArrowDown: [0, -30] };
  if (arrows[key]) {
    return () => {
      if (shiftKey) camera.pan(...arrows[key]);
      else camera.turn(...arrows[key]);
      renderer.changed();
    };
  }
  const views = ["3d", "top", "front", "right", "back", "left"];
  if (/^[1-6]$/.test(key)) return () => app.look(views[Number(key) - 1]);
  const near = (factor) => () => {
    camera.zoom(factor);
    renderer.changed();
  };
  return {
    "+": near(0.85), "=": near(0.85), "-": near(1 / 0.85),
    f: () => app.fit(), m: () => app.measure(!app.measuring), p: () => app.picture(),
    t: () => app.setTheme(app.dark ? "light" : "dark"), "?": () => app.toggleHelp(), h: () => app.toggleHelp(),
    o: () => app.showOutliers(app.outlierMode === "hide" ? "all" : "hide"),
    n: () => app.showNormals(!app.normalsOn), b: () => app.cut(!scene.box.on),
    c: () => app.colorBy(scene.attributes[(scene.attributes.indexOf(scene.color) + 1) % scene.attributes.length]),
    Escape: () => app.escape(),
  }[key.length === 1 ? key.toLowerCase() : key];
}

function showFault(error) {
  byId("stage").append(node("div", { className: "fault" }, `The page cannot show the cloud: ${error.message}`));
  throw error;
}

try {
  window.cloudPage = new App(JSON.parse(byId("manifest").textContent));
  window.cloudPage.load().catch(showFault);
} catch (error) {
  showFault(error);
}
