#!/usr/bin/env bash
# gpxparser 3.0.8 for npm gives a GPX track's distance.cumul, by its README "Cumulative distance at each point of the
# Route/Track", and slopes, "Slope of each sub-segment". One would expect distances from 0 at the first point on, and
# slopes of height over length. Each distance is that of the next point, and the last one stands there twice. Slopes
# divide a step's height by the length of the step behind it, and the last one by 0. The total is right.
# It hurts those who lay pictures or heights along a route by distance: each is one step too far on, whatever that step
# is, and a gentle climb in front of a short step is a cliff.
# Seen, of steps of 100, 10 and 1000 m that climb 5, 1 and 0 m: distances 100 110 1110 1110 instead of 0 100 110 1110,
# slopes 50 0.1 NaN instead of 5 10 0 per cent. Put a 0 in front of the distances, drop the last. Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund gpxparser@3.0.8 >npm.log 2>&1
node - <<'END'
const Parser = require("gpxparser");
const degree = Math.PI / 180 * 6371000; // metres of a degree of latitude, as gpxparser computes
const points = [[0, 0], [100, 5], [110, 6], [1110, 6]].map(([metres, height]) =>
    `<trkpt lat="${metres / degree}" lon="11"><ele>${height}</ele></trkpt>`);
const parser = new Parser();
parser.parse(`<gpx version="1.1" creator="made up" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>${
    points.join("")}</trkseg></trk></gpx>`);
const [{distance, slopes}] = parser.tracks;
const seen = [[distance.total], distance.cumul, slopes].map((list) =>
    list.map((number) => Number(number.toFixed(3))).join(" ")).join("; ");
console.log("gpxparser 3.0.8, total; distances of the points; slopes:", seen);
process.exitCode = seen === "1110; 100 110 1110 1110; 50 0.1 NaN" ? 0 : 1;
END
