// Read files by three.js: node three.mjs FILE ...; one JSON line for each.

import { readFileSync } from "node:fs";
import * as THREE from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";
import { HDRLoader } from "three/addons/loaders/HDRLoader.js";

for (const path of process.argv.slice(2)) {
  try {
    const bytes = readFileSync(path);
    const loader = path.endsWith(".hdr") ? new HDRLoader() : new EXRLoader();
    loader.setDataType(THREE.FloatType);
    const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
    const { width, height, data } = loader.parse(buffer);
    const channels = data.length / (width * height);
    const flipped = !path.endsWith(".hdr"); // EXRLoader's rows run from the bottom up
    console.log(JSON.stringify({ width, height, channels, flipped, data: [...data] }));
  } catch (error) {
    console.log(JSON.stringify({ error: String(error.message ?? error) }));
  }
}
