#!/bin/sh
# gpxpy 1.6.2: get_location_at(time) gives neither the place at that time nor the nearest point, but the first point at
# that time or later. Between two points 10 s apart, a tenth of a second after the first, it is the place 10 s later.
# Before the track's first point there is nothing, though that point comes later too.
# Installs gpxpy and asks along two points. Status 1: this has changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet gpxpy==1.6.2
"$folder/venv/bin/python" - <<'END'
import datetime
import sys
import gpxpy

track = gpxpy.parse("""<gpx version="1.1" creator="made up" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="48" lon="11.0"><time>2026-06-01T10:00:00Z</time></trkpt>
<trkpt lat="48" lon="11.1"><time>2026-06-01T10:00:10Z</time></trkpt></trkseg></trk></gpx>""").tracks[0]
begin = datetime.datetime(2026, 6, 1, 10, tzinfo=datetime.timezone.utc)
seen = []
for seconds in (-1, 0, 0.1, 9, 11):
    places = [point.longitude for point in track.get_location_at(begin + datetime.timedelta(seconds=seconds))]
    print(f"{seconds} s after the first of two points 10 s apart, at 11.0 and 11.1: {places}")
    seen.append(places)
sys.exit(seen != [[], [11.0], [11.1], [11.1], []])
END
