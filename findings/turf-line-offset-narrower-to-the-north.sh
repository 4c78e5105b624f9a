#!/usr/bin/env bash
# @turf/turf 7.4.0 for npm: by its help lineOffset "takes a line and returns a line at offset by the specified
# distance", in metres if asked to. One would expect that distance between the two, as buffer gives. It turns metres
# into degrees of latitude and moves east and west by as many degrees of longitude, which are shorter: a line to the
# north is moved by the distance times the cosine of the latitude, and one to the east by all of it.
# It hurts those who draw lanes, or who shift a route for agents that keep to one side: right on the equator, 36% too
# close at 50 degrees, and narrower or wider as the street turns, without a word.
# Seen, 10 m beside lines to the north and to the east: 10.0 10.0 at 0 degrees, 6.4 10.0 at 50, 5.0 10.0 at 60; by
# buffer 10.0 always. Instead move each point by destination(). Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund @turf/turf@7.4.0 >npm.log 2>&1
cat >offset.mjs <<'END'
import * as turf from '@turf/turf';

const metres = {units: 'meters'}, seen = [];
for (const latitude of [0, 50, 60]) {
  const start = [11, latitude];
  const moved = [[11, latitude + 0.01], [11.01, latitude]].map((end) => {
    const line = turf.lineOffset(turf.lineString([start, end]), 10, metres);
    return turf.distance(line.geometry.coordinates[0], start, metres).toFixed(1);
  });
  const [ring] = turf.buffer(turf.point(start), 10, metres).geometry.coordinates;
  const around = new Set(ring.map((place) => turf.distance(place, start, metres).toFixed(1)));
  console.log(latitude, 'degrees: to the north', moved[0], 'm, to the east', moved[1], 'm, buffer', ...around, 'm');
  seen.push([...moved, ...around].join(' '));
}
process.exitCode = seen.join('; ') === '10.0 10.0 10.0; 6.4 10.0 10.0; 5.0 10.0 10.0' ? 0 : 1;
END
node offset.mjs
