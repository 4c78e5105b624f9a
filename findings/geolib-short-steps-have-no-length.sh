#!/usr/bin/env bash
# geolib 3.3.14 for npm: one would expect getPathLength to be the length of a path in metres. It rounds each step to a
# metre before it adds: slow robots and dense logs have no length, and 1.4 m a step are 1. A known way out is to add by
# getDistance with accuracy 0.01, which the README has for centimetres, by "the Haversine formula". That function takes
# the arc cosine of nearly 1, which knows only about 0.1 m: steps of 0.1 m lose a quarter of the way, shorter ones more.
# getPreciseDistance with 0.01 is right.
# It hurts those who divide by path lengths, as in SPL, or who take speeds and odometry from places: without a word.
# Seen, of 1000 steps to the north at 48 degrees: of 100 m 0, with 0.01 77; of 400 m 0 and 398; of 1400 m 1000 and 1400.
# Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund geolib@3.3.14 >npm.log 2>&1
node - <<'END'
const geolib = require("geolib");
const seen = [];
for (const step of [0.1, 0.4, 1.4]) {
  const degrees = step / 6378137 * 180 / Math.PI; // on the sphere of getDistance
  const path = Array.from({length: 1001}, (_, i) => ({latitude: 48 + i * degrees, longitude: 11}));
  const whole = geolib.getPathLength(path);
  const finer = geolib.getPathLength(path, (a, b) => geolib.getDistance(a, b, 0.01));
  const precise = Math.round(geolib.getPathLength(path, (a, b) => geolib.getPreciseDistance(a, b, 0.01)));
  const straight = geolib.getDistance(path[0], path[1000]);
  console.log("1000 steps of", step, "m:", whole, "with 0.01", finer, "precise", precise, "end to end", straight);
  seen.push([whole, finer < 800 * step, precise, straight].join());
}
process.exitCode = seen.join(" ") === "0,true,100,100 0,false,400,400 1000,false,1400,1400" ? 0 : 1;
END
