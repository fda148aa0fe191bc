/* Palettes, without the ends that vanish on a dark page. All are readable with the common color blindnesses, and in gray print. */

const PALETTES = {
  viridis: "46327e 365c8d 277f8e 1fa187 4ac16d a0da39 fde725",
  cividis: "1d3a70 3b496c 575d6d 707173 8a8678 a59c74 c3b369 e1cc55 fee838",
  inferno: "3b0f70 57106e 781c6d a52c60 cf4446 ed6925 fb9b06 f7d13d fcffa4",
  "blue-red": "2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b",
  gray: "4a4a4a 787878 a6a6a6 d4d4d4 f4f4f4",
};
// Okabe and Ito's colors, the most different ones first.
const CLASS_COLORS = ["0072b2", "e69f00", "009e73", "cc79a7", "56b4e9", "d55e00", "f0e442", "8c6bb1"];
const OUTLIER = "d55e00", REGULAR = "8b97a8", NONE = "6b7280";
const LAS_COLORS = {
  0: "9aa4b2", 1: "9aa4b2", 2: "c9a15a", 3: "7fd0ae", 4: "33b487", 5: "00805c", 6: "cc79a7",
  7: OUTLIER, 8: "f0e442", 9: "0072b2", 10: "8c6bb1", 11: "7d8590", 17: "e69f00", 18: OUTLIER,
};

function rgbOf(hex) {
  const number = parseInt(hex, 16);
  return [number >> 16, (number >> 8) & 255, number & 255];
}

/** A color as the four bytes of a little-endian number. */
function packColor(r, g, b) {
  return ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
}

const packHex = (hex) => packColor(...rgbOf(hex));

/** The color at a share of a palette, as red, green, blue. */
function paletteColor(name, share) {
  const stops = PALETTES[name].split(" ").map(rgbOf);
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(place), stops.length - 2), t = place - i;
  return stops[i].map((low, c) => Math.round(low + t * (stops[i + 1][c] - low)));
}

/** The palette in 256 steps, as CSS and as packed numbers. */
function paletteSteps(name) {
  return Array.from({ length: 256 }, (_, i) => paletteColor(name, i / 255));
}

function paletteGradient(name) {
  const stops = PALETTES[name].split(" ").map((hex) => `#${hex}`);
  return `linear-gradient(to right, ${stops.join(", ")})`;
}

/** Colors of an attribute's classes, as hex. */
function classColors(attribute) {
  const name = attribute.name.toLowerCase();
  return attribute.values.map((value, code) => {
    if (name === "classification" && LAS_COLORS[value]) return LAS_COLORS[value];
    if (/outlier|edge/.test(name) && attribute.values.length <= 2) return value > 0 ? OUTLIER : REGULAR;
    if (value < 0) return NONE;
    if (attribute.values.length <= CLASS_COLORS.length) return CLASS_COLORS[code % CLASS_COLORS.length];
    return regionColor(value);
  });
}

/** Neighboring numbers differ in hue by the golden angle, and in lightness. */
function regionColor(number) {
  const hue = 6 * ((number * 0.6180339887498949) % 1);
  const value = [0.9, 0.77, 0.62][number % 3], saturation = [0.64, 0.54, 0.74][number % 3];
  return [5, 3, 1].map((turn) => {
    const sector = (turn + hue) % 6;
    const shade = Math.min(Math.max(Math.min(sector, 4 - sector), 0), 1);
    return Math.round(255 * value * (1 - saturation * shade)).toString(16).padStart(2, "0");
  }).join("");
}

/** Faces along x, y and z have a hue each; a direction and its opposite are equal. */
function normalColor(x, y, z) {
  const light = 0.62 + 0.38 * Math.abs(0.25 * x - 0.45 * y + 0.86 * z);
  const a = x * x, b = y * y, c = z * z;
  return packColor(
    Math.min(255, light * (226 * a + 252 * b + 122 * c)) | 0,
    Math.min(255, light * (112 * a + 222 * b + 178 * c)) | 0,
    Math.min(255, light * (82 * a + 158 * b + 232 * c)) | 0,
  );
}
