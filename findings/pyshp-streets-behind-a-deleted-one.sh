#!/usr/bin/env bash
# In a shapefile a street's line stands in NAME.shp and its row of attributes in NAME.dbf, at the same place. dBASE
# deletes a row by marking it with a `*`, and the line stays until the file is packed. One would expect pyshp 3.1.6 to
# give the other streets as they were, as GDAL does (pyogrio 0.13.0). shapeRecords(), iterShapeRecords() and GeoJSON
# leave the row out and keep its line: from there on each line has the row of the next one, and the last line is gone.
# shapeRecord(i) is right. It hurts those who build a street network from such a map: its speed limits, directions and
# names belong to other streets, without a word.
# Seen, of lines at longitudes 11 to 14 with limits 30 50 70 100, the second deleted: 11: 30, 12: 70, 13: 100. Needs
# python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet pyshp==3.1.6 pyogrio==0.13.0 numpy==2.4.6
venv/bin/python - <<'END'
import struct
import sys
import pyogrio
import shapefile

with shapefile.Writer("streets", shapeType=shapefile.POLYLINE) as writer:
    writer.field("limit", "N", 5)
    for longitude, limit in ((11, 30), (12, 50), (13, 70), (14, 100)):
        writer.line([[(longitude, 48), (longitude, 48.5)]])
        writer.record(limit)
with open("streets.dbf", "r+b") as table:
    header, row = struct.unpack("<HH", table.read(12)[8:])
    table.seek(header + row)
    table.write(b"*")

def pairs(streets):
    return [(int(street.shape.points[0][0]), street.record[0]) for street in streets]

reader = shapefile.Reader("streets")
listed, iterated = pairs(reader.shapeRecords()), pairs(reader.iterShapeRecords())
single = pairs([reader.shapeRecord(i) for i in (0, 2, 3)])
geojson = [(int(street["geometry"]["coordinates"][0][0]), street["properties"]["limit"])
           for street in reader.__geo_interface__["features"]]
_, _, lines, (limits,) = pyogrio.raw.read("streets.shp")
gdal = [(int(struct.unpack("<d", line[9:17])[0]), int(limit)) for line, limit in zip(lines, limits)]
print("longitude and limit by pyshp", *listed, "one by one", *single, "by GDAL", *gdal)
wrong, right = [(11, 30), (12, 70), (13, 100)], [(11, 30), (13, 70), (14, 100)]
sys.exit((listed, iterated, geojson, single, gdal) != (wrong, wrong, wrong, right, right))
END
