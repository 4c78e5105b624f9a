#!/usr/bin/env bash
# In the height files of the shuttle mission (SRTM, .hgt) -32768 stands where the radar saw nothing, as in steep valleys
# and on water. node-hgt 1.2.3 for npm gives heights at places from them; one would expect no height at a void. It
# takes the number for a height, and interpolates with it up to its neighbours: beside a void roads lie kilometres
# below the sea, at depths that no check for -32768 finds.
# It hurts those who add heights or slopes to recorded routes: a climb of thousands of metres between two points.
# Seen, of a plain at 500 m with one void: a pixel beside it 500, a tenth of a pixel from there towards the void
# -2826.8, half a pixel -16134, on it -32768; nearestNeighbour 500, 500 and -32768. Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund node-hgt@1.2.3 >npm.log 2>&1
node - <<'END'
const {writeFileSync} = require("fs");
const {Hgt} = require("node-hgt");
const side = 1201, tile = Buffer.alloc(2 * side * side);  // 3 arc seconds a pixel, rows from the north
for (let pixel = 0; pixel < side * side; ++pixel) tile.writeInt16BE(500, 2 * pixel);
tile.writeInt16BE(-32768, 2 * ((side - 1 - 600) * side + 600));
writeFileSync("N48E011.hgt", tile);
const steps = [599, 599.1, 599.5, 600];
const along = (settings) => {
  const heights = new Hgt("N48E011.hgt", [48, 11], settings);
  return steps.map((step) => Number(heights.getElevation([48 + 600 / 1200, 11 + step / 1200]).toFixed(1)));
};
const seen = JSON.stringify([along({}), along({interpolation: Hgt.nearestNeighbour})]);
console.log("node-hgt 1.2.3, heights at pixels", steps.join(" "), "by bilinear and nearestNeighbour:", seen);
process.exitCode = seen === "[[500,-2826.8,-16134,-32768],[500,500,-32768,-32768]]" ? 0 : 1;
END
