#!/usr/bin/env bash
# pyosmium 4.3.2: in a way that is read with_locations(), nodes with a negative id have no place, although the file has
# it in front of the way and the reader has just handed these nodes out with it. JOSM and other editors number so what
# is not uploaded yet. Nothing is said on reading; a line from the way raises "invalid location", as if nodes were
# missing, and code that passes over missing nodes draws another street. All kinds of index do so.
# Seen: nodes -1: 48.1, 2: 48.2, -3: 48.3, 4: 48.4; in the way None, 48.2, None, 48.4. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet osmium==4.3.2
cat >"$folder/map.osm" <<'END'
<osm version="0.6">
<node id="-1" version="1" lat="48.1" lon="11"/><node id="-3" version="1" lat="48.3" lon="11.5"/>
<node id="2" version="1" lat="48.2" lon="11"/><node id="4" version="1" lat="48.4" lon="11"/>
<way id="5" version="1"><nd ref="-1"/><nd ref="2"/><nd ref="-3"/><nd ref="4"/><tag k="highway" v="path"/></way>
</osm>
END
"$folder/venv/bin/python" - "$folder/map.osm" <<'END'
import sys
import osmium
right, seen = {-1: 48.1, -3: 48.3, 2: 48.2, 4: 48.4}, []
for index in ("flex_mem", "sparse_mem_array", "sparse_mem_map"):
    nodes = {}
    for thing in osmium.FileProcessor(sys.argv[1]).with_locations(index):
        if thing.is_node():
            nodes[thing.id] = thing.lat
        else:
            way = [node.lat if node.location.valid() else None for node in thing.nodes]
    print("pyosmium 4.3.2,", index, "nodes", nodes, "in the way", way)
    seen.append((nodes, way))
sys.exit(any(pair != (right, [None, 48.2, None, 48.4]) for pair in seen))
END
