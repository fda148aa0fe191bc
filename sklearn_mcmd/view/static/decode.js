/* Blocks of text to columns of numbers. */

// Five characters hold four bytes. None of them means anything in HTML.
const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_`{";
const DIGIT_OF = new Uint8Array(128);
for (let i = 0; i < 85; i++) DIGIT_OF[DIGITS.charCodeAt(i)] = i;

/** The bytes of a block: a zlib stream of `size` bytes, in base 85. */
async function inflate(text, size) {
  const stream = new Blob([fromBase85(text).subarray(0, size)]).stream();
  const plain = stream.pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(plain).arrayBuffer());
}

function fromBase85(text) {
  const words = new Uint32Array(text.length / 5);
  for (let word = 0, i = 0; word < words.length; word++) {
    let value = 0;
    for (const end = i + 5; i < end; i++) value = 85 * value + DIGIT_OF[text.charCodeAt(i)];
    words[word] = value;
  }
  return new Uint8Array(words.buffer); // of a processor that is little-endian, as all with WebGL are
}

/** Numbers whose lowest bytes come first, then the next; `delta`: 0, -1, 1, -2 ... to the last. */
function unpack(bytes, n, width, delta) {
  const values = new Uint32Array(n);
  for (let plane = 0; plane < width; plane++) {
    const shift = 8 * plane, start = plane * n;
    for (let i = 0; i < n; i++) values[i] |= bytes[start + i] << shift;
  }
  if (delta) {
    const mask = width === 4 ? 0xffffffff : (1 << (8 * width)) - 1;
    let last = 0;
    for (let i = 0; i < n; i++) {
      const change = values[i];
      last = ((last + ((change >>> 1) ^ -(change & 1))) & mask) >>> 0;
      values[i] = last;
    }
  }
  return values;
}

/**
 * Copy sorted values, less a number, to `out` from `start` on, in leaps of the golden section: neighbors part, so
 * that any first part of a chunk is spread over all of it.
 */
function scatter(values, out, start, { stride = 1, offset = 0, less = 0 } = {}) {
  const n = values.length, leap = leapOf(n);
  for (let slot = 0, i = 0; slot < n; slot++) {
    out[(start + slot) * stride + offset] = values[i] - less;
    i += leap;
    if (i >= n) i -= n;
  }
}

/** A number near 0.618 n without a common divisor. */
function leapOf(n) {
  let leap = Math.max(1, Math.round(0.6180339887498949 * n));
  while (gcd(leap, n) !== 1) leap++;
  return leap % n || (n === 1 ? 0 : 1);
}

function gcd(a, b) {
  while (b) [a, b] = [b, a % b];
  return a;
}
