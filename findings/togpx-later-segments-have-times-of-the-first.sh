#!/usr/bin/env bash
# togpx 0.5.4 for npm writes GeoJSON as GPX. Times come from the property `times` or `coordTimes`, by its README "an
# array of UTC ISO 8601 timestamp strings for each coordinate of the feature". One would expect a line of several
# parts, as a drive with a pause is, to use that array up from part to part. Each part begins at its first entry again:
# the second part lies at the times of the first. @mapbox/togeojson 0.16.2, the other way, gives an array a part; then
# the first point gets all times of the first part and the second one all of the second part.
# It hurts those who join pictures to such a track by time: two places have one time, and the end of the drive none.
# Seen, of parts at 0 1 and 10 11 12 s: times 0 1 and 0 1 10, and by way of togeojson 0+1 10+11+12 and 0+1 10+11+12
# and none. Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund togpx@0.5.4 @mapbox/togeojson@0.16.2 @xmldom/xmldom@0.9.12 >npm.log 2>&1
node - <<'END'
const togpx = require("togpx");
const togeojson = require("@mapbox/togeojson");
const {DOMParser} = require("@xmldom/xmldom");
const time = (second) => `2026-06-01T10:00:${String(second).padStart(2, "0")}Z`;
const parts = [[0, 1], [10, 11, 12]];
const segment = (part) => `<trkseg>${part.map((second) =>
    `<trkpt lat="48" lon="11.${second}"><time>${time(second)}</time></trkpt>`).join("")}</trkseg>`;
const text = `<gpx version="1.1" creator="made up" xmlns="http://www.topografix.com/GPX/1/1"><trk>${
    parts.map(segment).join("")}</trk></gpx>`;
const [drive] = togeojson.gpx(new DOMParser().parseFromString(text, "text/xml")).features;
const flat = {...drive, properties: {times: parts.flat().map(time)}};
const seconds = (point) => [...point.matchAll(/(\d\d)Z</g)].map(([, second]) => Number(second)).join("+") || "none";
const seen = [flat, drive].map((feature) => togpx(feature).split("<trkseg>").slice(1).map((part) =>
    part.split("<trkpt").slice(1).map(seconds).join(" ")).join(" | "));
console.log("togpx 0.5.4, seconds of the points by `times`:", seen[0], "and by way of togeojson:", seen[1]);
process.exitCode = seen.join("; ") === "0 1 | 0 1 10; 0+1 10+11+12 | 0+1 10+11+12 none" ? 0 : 1;
END
