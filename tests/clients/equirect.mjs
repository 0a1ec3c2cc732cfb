// Reading of the raw panorama: little-endian float32, RGB, twice as wide as high.

import { readFileSync } from "node:fs";

export function readPanorama(path, rows) {
  const bytes = readFileSync(path);
  if (bytes.length !== rows * rows * 2 * 3 * 4) {
    throw new Error(`${path} does not hold ${rows} x ${2 * rows} RGB floats`);
  }
  const data = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
  return { data, width: 2 * rows, height: rows };
}

// Bilinear, with u from the left and v from the bottom as in a flipped GL texture:
// repeats in u, clamps in v.
export function sample({ data, width, height }, u, v) {
  const x = u * width - 0.5;
  const y = Math.min(Math.max((1 - v) * height - 0.5, 0), height - 1);
  const x0 = Math.floor(x);
  const y0 = Math.min(Math.floor(y), height - 2);
  const fx = x - x0;
  const fy = y - y0;
  const at = (i, j, c) => data[(i * width + ((j % width) + width) % width) * 3 + c];
  return [0, 1, 2].map(
    (c) =>
      (1 - fy) * ((1 - fx) * at(y0, x0, c) + fx * at(y0, x0 + 1, c)) +
      fy * ((1 - fx) * at(y0 + 1, x0, c) + fx * at(y0 + 1, x0 + 1, c)),
  );
}
