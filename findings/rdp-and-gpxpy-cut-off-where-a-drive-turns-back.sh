#!/usr/bin/env bash
# rdp 0.8 and gpxpy 1.6.2 simplify a track by the Ramer-Douglas-Peucker algorithm with a tolerance in metres. One would
# expect that no point that is left out lies farther than that from the simpler track. Both measure to the endless line
# through first and last point, not to the piece between them: a drive that goes out along a straight street and comes
# back part of the way has its turn on that line, however far away it is, and loses it.
# It hurts those who thin out recorded drives: turns at dead ends are gone and the route is shorter, without a word.
# Seen, of 1000 m out and 500 m back with a tolerance of 5 m: rdp and gpxpy leave two points and 500 m of 1500 m.
# shapely 2.2.0 keeps the turn, as its distance is to the piece. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rdp==0.8 gpxpy==1.6.2 shapely==2.2.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import math
import sys
import gpxpy.gpx
import rdp
import shapely

drive = [(x, 0.0) for x in (*range(0, 1000, 100), *range(1000, 400, -100))]
by_rdp = shapely.LineString(rdp.rdp(drive, epsilon=5))
by_shapely = shapely.LineString(drive).simplify(5)
metre = 1 / (math.radians(1) * 6378137)  # degrees of longitude, on the equator
track = gpxpy.gpx.GPXTrackSegment([gpxpy.gpx.GPXTrackPoint(0, x * metre) for x, _ in drive])
track.simplify(5)
by_gpxpy = shapely.LineString([(point.longitude / metre, 0) for point in track.points])
seen = []
for name, line in (("drive", shapely.LineString(drive)), ("rdp", by_rdp), ("gpxpy", by_gpxpy), ("shapely", by_shapely)):
    seen.append((round(line.length), round(line.distance(shapely.Point(1000, 0)))))
    print(name, "length", seen[-1][0], "m, distance from the turn", seen[-1][1], "m")
sys.exit(seen != [(1500, 0), (500, 500), (500, 500), (1500, 0)])
END
