#!/usr/bin/env bash
# @tmcw/togeojson 7.1.3 turns a GPX track into a line and, beside it, an array of its points' times. One would expect
# times[i] to be the time of coordinates[i], as it is with heart rates, where null stands for none. But a point without
# <time>, which GPX allows and which editors insert, gets no entry: all times behind it belong to the point before.
# It hurts those who join a drive's pictures to its places by time: they show another stretch of road, without a word.
# Seen, of points at 0 s, no time, 2 s and 3 s: times 0, 2, 3 beside heart rates 60, null, 62, 63. Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund @tmcw/togeojson@7.1.3 @xmldom/xmldom@0.9.12 >npm.log 2>&1
cat >times.mjs <<'END'
import {gpx} from '@tmcw/togeojson';
import {DOMParser} from '@xmldom/xmldom';

const point = (second) => `<trkpt lat="48" lon="11.${second}">` + (second === 1 ? '' :
    `<time>2026-06-01T10:00:0${second}Z</time><extensions><gpxtpx:TrackPointExtension><gpxtpx:hr>6${second}</gpxtpx:hr>` +
    '</gpxtpx:TrackPointExtension></extensions>') + '</trkpt>';
const track = `<gpx version="1.1" creator="made up" xmlns="http://www.topografix.com/GPX/1/1"
  xmlns:gpxtpx="http://www.garmin.com/xmlschemas/TrackPointExtension/v1">
  <trk><trkseg>${[0, 1, 2, 3].map(point).join('')}</trkseg></trk></gpx>`;
const [line] = gpx(new DOMParser().parseFromString(track, 'text/xml')).features;
const {times, heart} = line.properties.coordinateProperties;
const seen = JSON.stringify([line.geometry.coordinates.length, times.map((time) => time.slice(17, 19)), heart]);
console.log('togeojson 7.1.3: places, seconds of the times, heart rates', seen);
process.exitCode = seen === '[4,["00","02","03"],[60,null,62,63]]' ? 0 : 1;
END
node times.mjs
