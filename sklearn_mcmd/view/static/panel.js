/* The settings beside the picture. Texts of the file are set as text, never as HTML. */

/** An element with properties and children. */
function node(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key === "dataset") Object.assign(made.dataset, value);
    else if (key.startsWith("aria-")) made.setAttribute(key, value);
    else made[key] = value;
  }
  made.append(...children);
  return made;
}

const grouped = (n) => n.toLocaleString("en-US");
const shareText = (n, of) => `${of ? ((100 * n) / of).toFixed(2) : "0.00"} %`;

function section(title, open, ...children) {
  return node("details", { open }, node("summary", {}, title), node("div", {}, ...children));
}

function row(label, control) {
  return node("div", { className: "row" }, node("label", {}, label), control);
}

function checkbox(label, checked, act, id = "") {
  const input = node("input", { type: "checkbox", checked, id });
  input.addEventListener("change", () => act(input.checked));
  return node("label", { className: "check" }, input, label);
}

/** A menu of [value, text]. */
function menu(options, value, act, id, label) {
  const select = node("select", { id, "aria-label": label });
  for (const [key, text] of options) select.append(node("option", { value: key }, text));
  select.value = value;
  select.addEventListener("change", () => act(select.value));
  return select;
}

/** Buttons of which one is pressed. */
function choices(options, value, act) {
  const box = node("div", { className: "buttons choices", role: "group" });
  for (const [key, text] of options) {
    const button = node("button", { type: "button", dataset: { key } }, text);
    button.addEventListener("click", () => {
      box.press(key);
      act(key);
    });
    box.append(button);
  }
  box.press = (wanted) => {
    for (const button of box.children) button.setAttribute("aria-pressed", button.dataset.key === wanted);
  };
  box.press(value);
  return box;
}

/** A slider, or with two values a pair of handles; `act` gets their values in order. */
function slider({ min, max, step = 1, values, act, labels }) {
  const inputs = values.map((value, i) =>
    node("input", { type: "range", min, max, step, value, "aria-label": labels[i] }));
  const box = node("div", { className: values.length > 1 ? "range" : "range one" }, ...inputs);
  for (const input of inputs) {
    input.addEventListener("input", () => act(box.values()));
  }
  box.values = () => inputs.map((input) => Number(input.value)).sort((a, b) => a - b);
  box.set = (numbers) => inputs.forEach((input, i) => (input.value = numbers[i]));
  return box;
}

class Panel {
  constructor(app) {
    this.app = app;
    this.scene = app.scene;
    this.root = document.getElementById("panel");
    this.build();
  }

  /** Make all controls, from what the app and the scene hold. */
  build() {
    const before = [...this.root.children], { scrollTop } = this.root;
    this.colorBody = node("div");
    const parts = [];
    if (this.scene.clouds.length > 1) parts.push(section("Clouds", true, ...this.cloudControls()));
    parts.push(section("Color", true, this.colorMenu(), this.colorBody));
    this.thresholdBody = node("div");
    if (this.scoreAttributes().length) {
      parts.push(section("Threshold", this.hasScore(), this.thresholdMenu(), this.thresholdBody));
    }
    if (this.scene.outlierAttribute()) parts.push(section("Outliers", true, this.outlierControls()));
    if (this.scene.normalAttribute()) parts.push(section("Normals", false, ...this.normalControls()));
    parts.push(section("Section box", false, ...this.boxControls()));
    parts.push(section("Points", false, ...this.pointControls()));
    parts.push(section("About this page", false, ...this.about()));
    for (const part of parts) {
      const same = before.find((old) => old.firstChild.textContent === part.firstChild.textContent);
      if (same) part.open = same.open;
    }
    this.root.replaceChildren(...parts);
    this.root.scrollTop = scrollTop;
    this.showColor();
    this.showThreshold();
  }

  cloudControls() {
    const { app, scene } = this;
    const list = node("div", { className: "classes" });
    for (const cloud of scene.clouds) {
      const input = node("input", { type: "checkbox", checked: cloud.shown });
      input.addEventListener("change", () => {
        cloud.shown = input.checked;
        app.clearIfHidden();
        app.countAndDraw();
      });
      list.append(node("label", {}, input, node("span", { title: cloud.name }, cloud.name), node("small", {}, grouped(cloud.total))));
    }
    const names = scene.clouds.map((cloud, i) => [String(i), cloud.name]);
    const pair = [0, 1].map((side) =>
      menu(names, String(app.pair[side]), (value) => app.compareWith(side, Number(value)), "", ["Left", "Right"][side]));
    return [
      list,
      checkbox("Compare two with a slider", app.comparing, (on) => app.compare(on), "compare"),
      row("Left", pair[0]),
      row("Right", pair[1]),
    ];
  }

  colorMenu() {
    const options = this.scene.attributes.map((attribute, i) => [String(i), attribute.name]);
    const chosen = String(this.scene.attributes.indexOf(this.scene.color));
    return row("Color by", menu(options, chosen, (i) => this.app.colorBy(this.scene.attributes[i]), "color-by", "Color by"));
  }

  /** Controls of the attribute that colors. */
  showColor() {
    const attribute = this.scene.color;
    document.getElementById("color-by").value = this.scene.attributes.indexOf(attribute);
    const parts = { class: () => this.classList(attribute), number: () => this.numberRange(attribute) }[attribute.kind];
    this.colorBody.replaceChildren(...(parts ? parts() : [node("p", { className: "note" }, {
      normal: "Faces along x, y and z have a color each. A normal and its opposite look alike.",
      rgb: "Colors of the file.",
    }[attribute.kind])]));
  }

  classList(attribute) {
    const order = attribute.values.map((_, code) => code);
    if (order.length > 12) order.sort((a, b) => attribute.counts[b] - attribute.counts[a]);
    const boxes = [];
    const list = node("div", { className: "classes" });
    for (const code of order.slice(0, 400)) {
      const input = node("input", { type: "checkbox", checked: !attribute.off[code], dataset: { code } });
      input.addEventListener("change", () => {
        attribute.off[code] = input.checked ? 0 : 1;
        this.app.judgeAll();
      });
      boxes.push(input);
      const dot = node("i", { className: "dot" });
      dot.style.setProperty("--dot", `#${attribute.colors[code]}`);
      const name = className(attribute, code);
      list.append(node("label", {}, input, dot, node("span", { title: name }, name), node("small", {}, grouped(attribute.counts[code]))));
    }
    const all = (off) => {
      attribute.off.fill(off);
      for (const input of boxes) input.checked = !off;
      this.app.judgeAll();
    };
    const buttons = node("div", { className: "buttons" });
    for (const [text, off] of [["Show all", 0], ["Hide all", 1]]) {
      const button = node("button", { type: "button" }, text);
      button.addEventListener("click", () => all(off));
      buttons.append(button);
    }
    const more = order.length > 400 ? [node("p", { className: "note" }, `The ${order.length - 400} smallest are not listed.`)] : [];
    return [list, ...more, buttons];
  }

  numberRange(attribute) {
    const { app, scene } = this;
    const palettes = menu(Object.keys(PALETTES).map((name) => [name, name]), scene.palette, (name) => {
      scene.palette = name;
      app.paintAll();
      draw();
    }, "palette", "Palette");
    const canvas = node("canvas", { className: "histogram", width: 560, height: 108 });
    const [first, last] = codeDomain(attribute);
    const axis = rangeTexts(attribute, [first, last]).map((text) => node("span", {}, text));
    const chosen = node("output", { id: "color-range" });
    const draw = () => {
      const range = scene.colorRange(attribute);
      drawHistogram(canvas, attribute, [first, last], range, scene.palette);
      const [low, , high] = rangeTexts(attribute, range);
      chosen.textContent = `${low} to ${high}${attribute.unit ?? ""}`;
    };
    const handles = slider({
      min: first, max: last, values: scene.colorRange(attribute), labels: ["Low end", "High end"],
      act: (range) => {
        attribute.range = range;
        if (scene.filters.has(attribute)) {
          this.filterBy(attribute, range);
          app.soon("judgeAll");
        }
        app.soon("paintAll");
        draw();
      },
    });
    const only = checkbox("Hide points outside of this range", scene.filters.has(attribute), (on) => {
      this.filterBy(attribute, on ? scene.colorRange(attribute) : null);
      app.judgeAll();
    }, "outside");
    draw();
    return [row("Palette", palettes), canvas, node("div", { className: "ends" }, ...axis), handles, row("Colors from", chosen), only];
  }

  filterBy(attribute, range) {
    if (range) this.scene.filters.set(attribute, range);
    else this.scene.filters.delete(attribute);
  }

  scoreAttributes() {
    const numbers = this.scene.attributes.filter((a) => a.kind === "number" && !a.own);
    return [...numbers].sort((a, b) => isScore(b) - isScore(a));
  }

  hasScore() {
    return this.scoreAttributes().some(isScore);
  }

  thresholdMenu() {
    const options = this.scoreAttributes().map((a) => [String(this.scene.attributes.indexOf(a)), a.name]);
    const { threshold } = this.scene;
    threshold.attribute ??= this.scoreAttributes()[0];
    const chosen = String(this.scene.attributes.indexOf(threshold.attribute));
    return row("Number", menu(options, chosen, (i) => {
      threshold.attribute = this.scene.attributes[i];
      threshold.code = null;
      threshold.chosen = false;
      this.showThreshold();
      this.app.judgeAll();
    }, "threshold-by", "Number to compare"));
  }

  showThreshold() {
    const { scene, app } = this, { threshold } = scene, { attribute } = threshold;
    if (!attribute) return;
    threshold.code ??= startCode(attribute);
    const [first, last] = codeDomain(attribute);
    const tally = node("div", { className: "tally" });
    const field = node("input", { className: "number", id: "threshold-value", inputMode: "decimal", "aria-label": "Threshold" });
    const show = () => {
      field.value = numberText(decodeNumber(attribute, threshold.code));
      this.showTally(tally);
    };
    const move = (code) => {
      threshold.code = code;
      threshold.chosen = true;
      if (threshold.mode === "off") {
        threshold.mode = "mark";
        modes.press("mark");
      }
      show();
      app.soon("judgeAll");
    };
    const handle = slider({ min: first - 1, max: last, values: [threshold.code], act: ([code]) => move(code), labels: ["Threshold"] });
    handle.firstChild.id = "threshold";
    field.addEventListener("change", () => {
      const value = Number(field.value);
      if (field.value.trim() !== "" && Number.isFinite(value)) {
        move(encodeNumber(attribute, value));
        handle.set([threshold.code]);
      } else show();
    });
    const modes = choices([["off", "Off"], ["mark", "Mark"], ["hide", "Hide"], ["only", "Only"]], threshold.mode, (mode) => {
      threshold.mode = mode;
      app.judgeAll();
    });
    modes.id = "threshold-mode";
    this.thresholdBody.replaceChildren(handle, row("Value", field), tally, node("p", { className: "note" }, "Points above the threshold:"), modes);
    this.refreshTally = show;
    show();
  }

  showTally(box) {
    const { attribute, code } = this.scene.threshold;
    const all = countUpTo(attribute, LAST_CODE), below = countUpTo(attribute, code);
    box.replaceChildren(
      node("div", { className: "above" }, node("small", {}, "above"), node("b", { id: "n-above" }, grouped(all - below)), node("small", {}, shareText(all - below, all))),
      node("div", {}, node("small", {}, "up to it"), node("b", { id: "n-below" }, grouped(below)), node("small", {}, shareText(below, all))),
    );
  }

  outlierControls() {
    const attribute = this.scene.outlierAttribute();
    const box = choices([["all", "Show"], ["hide", "Hide"], ["only", "Only these"]], this.app.outlierMode, (mode) => this.app.showOutliers(mode));
    box.id = "outliers";
    this.outlierBox = box;
    const n = () => attribute.outliers.reduce((sum, code) => sum + attribute.counts[code], 0);
    this.outlierNote = node("p", { className: "note" });
    this.refreshOutliers = () => {
      this.outlierNote.textContent = `${grouped(n())} points, ${shareText(n(), attribute.known)}, by ${attribute.name}`;
    };
    this.refreshOutliers();
    return node("div", {}, box, this.outlierNote);
  }

  normalControls() {
    const { app } = this;
    const length = slider({ min: 0.5, max: 20, step: 0.5, values: [app.normalLength], labels: ["Length"], act: ([value]) => {
      app.normalLength = value;
      app.showNormals(app.normalsOn);
    } });
    return [
      checkbox("Show as short lines", app.normalsOn, (on) => app.showNormals(on), "normals"),
      row("Length", length),
      node("p", { className: "note" }, "Lines of at most 30,000 of the points that are shown."),
    ];
  }

  boxControls() {
    const { scene, app } = this;
    const parts = [checkbox("Cut the cloud with a box", scene.box.on, (on) => app.cut(on), "box")];
    this.boxEnds = [];
    "xyz".split("").forEach((axis, i) => {
      const text = node("div", { className: "ends" }, node("span"), node("span"));
      const handles = slider({
        min: 0, max: 1000, values: [0, 1000], labels: [`Least ${axis}`, `Largest ${axis}`],
        act: ([low, high]) => {
          scene.box.low[i] = low / 1000;
          scene.box.high[i] = high / 1000;
          this.showBoxEnds();
          scene.box.on = true;
          app.soon("showBox", "judgeAll");
        },
      });
      handles.dataset.axis = axis;
      this.boxEnds.push({ text, handles });
      parts.push(row(axis, handles), text);
    });
    const reset = node("button", { type: "button" }, "Reset");
    reset.addEventListener("click", () => app.resetBox());
    parts.push(node("div", { className: "buttons" }, reset));
    this.showBoxEnds();
    return parts;
  }

  showBoxEnds() {
    const { low, high } = this.scene.box;
    this.boxEnds.forEach(({ text, handles }, i) => {
      [low[i], high[i]].forEach((share, side) => {
        const value = this.scene.low[i] + share * this.scene.size[i];
        text.children[side].textContent = numberText(value, this.scene.size[i] / 1000);
      });
      handles.set([1000 * low[i], 1000 * high[i]]);
    });
  }

  pointControls() {
    const { app } = this;
    const size = slider({ min: -2, max: 2, step: 0.1, values: [Math.log2(app.renderer.pointSize)], labels: ["Size"], act: ([value]) => {
      app.renderer.pointSize = 2 ** value;
      app.renderer.changed();
    } });
    return [
      row("Size", size),
      checkbox("Shade by depth", app.renderer.shading, (on) => {
        app.renderer.shading = on;
        app.renderer.changed();
      }, "shading"),
    ];
  }

  about() {
    const { manifest, n, total, unit } = this.scene;
    const thinned = n < total ? `${grouped(n)} of ${grouped(total)} points, chosen at random.` : `All ${grouped(n)} points.`;
    const error = manifest.error > 0
      ? `Coordinates are off by at most ${numberText(manifest.error)}; points are ${numberText(manifest.spacing)} apart (median).`
      : "Coordinates are those of the file.";
    const drawn = manifest.drawn > manifest.step / 2
      ? [`The picture rounds places far from the middle by at most ${numberText(manifest.drawn)}; cards and lengths do not.`]
      : [];
    const coarse = this.scene.attributes.filter((a) => a.error > 0 && !a.own);
    const notes = coarse.map((a) => `${a.name}: within ${numberText(a.error)}` + (a.relative ? `, or ${(100 * a.relative).toPrecision(2)} % far from the median` : ""));
    return [thinned, error, ...drawn, ...notes, `Lengths are in ${unit ? `${unit}, as the file says` : "the units of the file"}. Rows count from 0.`].map((text) => node("p", { className: "note" }, text));
  }
}

function isScore(attribute) {
  return /score|statistic|residual/i.test(attribute.name) ? 1 : 0;
}

/** Where the slider of a threshold begins: the detector's cutoff, or the 99 % quantile. */
function startCode(attribute) {
  return attribute.name === "outlier_score" ? encodeNumber(attribute, CUTOFF) : quantileCode(attribute, 0.99);
}

/** The lowest and the highest code of the points. */
function codeDomain(attribute) {
  let first = 1, last = LAST_CODE;
  while (first < LAST_CODE && !attribute.counts[first]) first++;
  while (last > first && !attribute.counts[last]) last--;
  return first < last ? [first, last] : first < LAST_CODE ? [first, first + 1] : [1, LAST_CODE];
}

function drawHistogram(canvas, attribute, [first, last], [low, high], palette) {
  const context = canvas.getContext("2d"), { width, height } = canvas, n = 80;
  const bars = new Float64Array(n);
  for (let code = first; code <= last; code++) {
    bars[Math.min(n - 1, Math.floor((n * (code - first)) / (last - first + 1)))] += attribute.counts[code];
  }
  const highest = Math.sqrt(Math.max(...bars)) || 1;
  context.clearRect(0, 0, width, height);
  bars.forEach((bar, i) => {
    const code = first + ((i + 0.5) / n) * (last - first);
    const inside = code >= low && code <= high;
    const [r, g, b] = paletteColor(palette, (code - low) / Math.max(high - low, 1));
    context.fillStyle = `rgba(${r}, ${g}, ${b}, ${inside ? 1 : 0.45})`;
    const tall = bar ? Math.max(2, (height * Math.sqrt(bar)) / highest) : 0; // roots show rare values too
    context.fillRect((i * width) / n, height - tall, width / n - 1, tall);
  });
}
