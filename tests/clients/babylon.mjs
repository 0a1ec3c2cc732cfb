// Project the panorama with Babylon.js: node babylon.mjs panorama.raw rows output.json
//
// The steps are those of HDRCubeTexture after decoding: panorama to cube, cube to
// spherical polynomial.

import { readFileSync, writeFileSync } from "node:fs";
import { CubeMapToSphericalPolynomialTools } from "@babylonjs/core/Misc/HighDynamicRange/cubemapToSphericalPolynomial.js";
import { PanoramaToCubeMapTools } from "@babylonjs/core/Misc/HighDynamicRange/panoramaToCubemap.js";
import {
  SphericalHarmonics,
  SphericalPolynomial,
} from "@babylonjs/core/Maths/sphericalPolynomial.js";
import { readPanorama } from "./equirect.mjs";

const SIZE = 256;
const HARMONICS = ["l00", "l1_1", "l10", "l11", "l2_2", "l2_1", "l20", "l21", "l22"];
const MONOMIALS = ["x", "y", "z", "xx", "yy", "zz", "yz", "zx", "xy"];

const [path, rows, output] = process.argv.slice(2);
const { data, width, height } = readPanorama(path, Number(rows));
const numbers = (object, names) => names.map((name) => object[name].asArray());

// The harmonics exist only on the way to the polynomial: note them as they pass.
let harmonics = null;
const fromHarmonics = SphericalPolynomial.FromHarmonics;
SphericalPolynomial.FromHarmonics = (passing) => {
  harmonics = numbers(passing, HARMONICS);
  return fromHarmonics.call(SphericalPolynomial, passing);
};

const cube = PanoramaToCubeMapTools.ConvertPanoramaToCubemap(
  data,
  width,
  height,
  SIZE,
  true,
);
const polynomial =
  CubeMapToSphericalPolynomialTools.ConvertCubeMapToSphericalPolynomial(cube);
const back = SphericalHarmonics.FromPolynomial(polynomial);

const installed = JSON.parse(readFileSync("node_modules/@babylonjs/core/package.json"));
const common = {
  tool: "Babylon.js",
  version: installed.version,
  command:
    `ConvertCubeMapToSphericalPolynomial(ConvertPanoramaToCubemap(data, ${width}, ` +
    `${height}, ${SIZE}, true))`,
  frame: "Babylon.js",
};
const tolerance = {
  value: 3e-3,
  why:
    "ConvertPanoramaToCubemap rounds to the nearest pixel, half a pixel off centre, " +
    "and starts at the corner of a face's pixel",
};
const records = {
  babylon_harmonics: {
    ...common,
    convention: "Babylon SphericalHarmonics",
    variant: "SphericalHarmonics",
    order: "l00, l1_1, l10, l11, l2_2, l2_1, l20, l21, l22; RGB each",
    output: harmonics,
    tolerance,
    from_polynomial: numbers(back, HARMONICS),
  },
  babylon_polynomial: {
    ...common,
    convention: "Babylon SphericalPolynomial",
    variant: "SphericalPolynomial",
    order: "x, y, z, xx, yy, zz, yz, zx, xy; RGB each",
    output: numbers(polynomial, MONOMIALS),
    tolerance,
  },
  babylon_prescaled: {
    ...common,
    convention: "cmgen --sh-shader",
    variant: "SphericalPolynomial.preScaledHarmonics",
    order: "l00, l1_1, l10, l11, l2_2, l2_1, l20, l21, l22; RGB each",
    output: numbers(polynomial.preScaledHarmonics, HARMONICS),
    tolerance,
  },
};
writeFileSync(output, JSON.stringify(records));
