// Project the panorama with three.js: node three.mjs panorama.raw rows output.json
//
// three's CubeCamera and LightProbeGenerator do the geometry and the projection. Only
// the rasteriser is replaced: a stand-in for the renderer looks up each pixel of a cube
// face in the panorama, where three's shader chunk `equirectUv` says.

import { readFileSync, writeFileSync } from "node:fs";
import * as THREE from "three";
import { LightProbeGenerator } from "three/addons/lights/LightProbeGenerator.js";
import { readPanorama, sample } from "./equirect.mjs";

const SIZE = 256;
const NORMALS = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
  [-0.48, -0.6, 0.64],
  [0.36, 0.48, -0.8],
];

const [path, rows, output] = process.argv.slice(2);
const panorama = readPanorama(path, Number(rows));

const chunk = THREE.ShaderChunk.common.replace(/\s+/g, " ");
for (const line of [
  "float u = atan( dir.z, dir.x ) * RECIPROCAL_PI2 + 0.5;",
  "float v = asin( clamp( dir.y, - 1.0, 1.0 ) ) * RECIPROCAL_PI + 0.5;",
]) {
  if (!chunk.includes(line)) throw new Error(`equirectUv has changed: ${line}`);
}

function equirectUv(direction) {
  return [
    Math.atan2(direction.z, direction.x) / (2 * Math.PI) + 0.5,
    Math.asin(THREE.MathUtils.clamp(direction.y, -1, 1)) / Math.PI + 0.5,
  ];
}

const target = new THREE.WebGLCubeRenderTarget(SIZE, { type: THREE.FloatType });
const cubeCamera = new THREE.CubeCamera(1, 10, target);
cubeCamera.coordinateSystem = THREE.WebGLCoordinateSystem;
cubeCamera.updateCoordinateSystem();

const renderer = {
  isWebGLRenderer: true,
  coordinateSystem: THREE.WebGLCoordinateSystem,
  async readRenderTargetPixelsAsync(_, x, y, width, height, buffer, face) {
    const camera = cubeCamera.children[face];
    const direction = new THREE.Vector3();
    for (let row = 0; row < height; row++) {
      for (let column = 0; column < width; column++) {
        // Framebuffer rows are read from the bottom up.
        direction
          .set(((column + 0.5) / width) * 2 - 1, ((row + 0.5) / height) * 2 - 1, 0.5)
          .unproject(camera)
          .normalize();
        const color = sample(panorama, ...equirectUv(direction));
        buffer.set([...color, 1], (row * width + column) * 4);
      }
    }
  },
};

const probe = await LightProbeGenerator.fromCubeRenderTarget(renderer, target);
probe.uuid = "00000000-0000-4000-8000-000000000000";
const lightProbe = probe.toJSON();
const parsed = new THREE.ObjectLoader().parse(lightProbe);
if (!parsed.isLightProbe || !parsed.sh.equals(probe.sh)) {
  throw new Error("ObjectLoader does not read back what toJSON wrote");
}

const evaluate = (method) =>
  NORMALS.map((normal) =>
    probe.sh[method](new THREE.Vector3(...normal), new THREE.Vector3()).toArray(),
  );

const installed = JSON.parse(readFileSync("node_modules/three/package.json"));
const record = {
  tool: "three.js",
  version: installed.version,
  command:
    "LightProbeGenerator.fromCubeRenderTarget on the faces that CubeCamera sees " +
    `(${SIZE} pixels, float), panorama of ${rows} rows`,
  convention: "three.js LightProbe (27 floats)",
  frame: "three.js",
  variant: "LightProbe",
  order: "probe.sh.coefficients: 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22; RGB each",
  output: probe.sh.coefficients.map((coefficient) => coefficient.toArray()),
  tolerance: {
    value: 2e-5,
    why: "midpoint rule on cube faces, bilinear sampling, six-digit basis constants",
  },
  normals: NORMALS,
  radiance: evaluate("getAt"),
  irradiance: evaluate("getIrradianceAt"),
  light_probe: lightProbe,
};
writeFileSync(output, JSON.stringify({ three_light_probe: record }));
