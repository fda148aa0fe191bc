/* The saved picture: the points, and what stands over them on the page. */

function drawPicture({ canvas, ratio }) {
  const copy = node("canvas", { width: canvas.width, height: canvas.height });
  const context = copy.getContext("2d"), { x, y } = canvas.getBoundingClientRect();
  context.drawImage(canvas, 0, 0);
  context.setTransform(ratio, 0, 0, ratio, -ratio * x, -ratio * y);
  for (const element of document.querySelectorAll("#divider b, #divider span, #head, #scale")) drawElement(context, element);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  for (const mark of byId("overlay").children) drawMark(context, mark);
  return copy;
}

/** An element that is shown: its background, its text, and what is in it. */
function drawElement(context, element) {
  if (!element.getClientRects().length) return;
  const style = getComputedStyle(element), { x, y, width, height } = element.getBoundingClientRect();
  const palette = context.createLinearGradient(x, 0, x + width, 0);
  const colors = style.backgroundImage.match(/rgb\([^)]*\)/g) ?? [];
  colors.forEach((color, i) => palette.addColorStop(i / (colors.length - 1), color));
  context.fillStyle = colors.length ? palette : style.backgroundColor;
  context.beginPath();
  context.roundRect(x, y, width, height, parseFloat(style.borderRadius));
  context.fill();
  context.save();
  if (style.overflow === "hidden") context.clip();
  for (const child of element.childNodes) {
    if (child.nodeType === Node.TEXT_NODE) drawText(context, child, style);
    else drawElement(context, child);
  }
  context.restore();
}

/** Text where the page has it, line by line. */
function drawText(context, text, style) {
  const range = document.createRange(), lines = new Map();
  for (let i = 0; i < text.length; i++) {
    range.setStart(text, i);
    range.setEnd(text, i + 1);
    const { x, y } = range.getBoundingClientRect(), line = lines.get(y) ?? { words: "", left: x };
    lines.set(y, { words: line.words + text.data[i], left: Math.min(line.left, x) });
  }
  context.font = fontOf(style);
  context.fillStyle = style.color;
  for (const [top, { words, left }] of lines) {
    context.fillText(words, left, top + context.measureText(words).fontBoundingBoxAscent);
  }
}

/** A line, a circle or a length of the overlay. */
function drawMark(context, mark) {
  const style = getComputedStyle(mark), path = new Path2D();
  const at = (name) => Number(mark.getAttribute(name));
  Object.assign(context, {
    fillStyle: style.fill, strokeStyle: style.stroke, lineWidth: parseFloat(style.strokeWidth), globalAlpha: style.opacity,
    font: fontOf(style), textAlign: "center",
  });
  if (mark.tagName === "text") {
    context.strokeText(mark.textContent, at("x"), at("y"));
    context.fillText(mark.textContent, at("x"), at("y"));
    return;
  }
  if (mark.tagName === "circle") path.arc(at("cx"), at("cy"), at("r"), 0, 7);
  else {
    path.moveTo(at("x1"), at("y1"));
    path.lineTo(at("x2"), at("y2"));
  }
  if (style.fill !== "none") context.fill(path);
  context.stroke(path);
}

function fontOf({ fontWeight, fontSize, fontFamily }) {
  return `${fontWeight} ${fontSize} ${fontFamily}`;
}
