#!/usr/bin/env bash
# voyager 2.2.3, an index for similarity search: the help of Space.Euclidean says "Euclidean distance; also known as L2
# distance. The square root of the sum of the squared differences". One would expect that number from query() and
# get_distance(). Both give the sum, without its root. The order of neighbours is right, so nothing looks wrong.
# It hurts those who recognise places by a limit on the distance, or who index places in metres: what is looked for
# within 25 m is looked for within 5 m, and below 1 too much is accepted instead of too little.
# Seen from (0, 0) to (3, 4), (0.3, 0.4) and (30, 40), which are 5, 0.5 and 50 away: 25, 0.25 and 2500. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet voyager==2.2.3 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import math
import sys
import voyager

told = " ".join(voyager.Space.Euclidean.__doc__.split())
print("voyager 2.2.3, Space.Euclidean:", told)
places = [(3, 4), (0.3, 0.4), (30, 40)]
index = voyager.Index(voyager.Space.Euclidean, num_dimensions=2)
for place in places:
    index.add_item(place)
neighbours, distances = index.query([0, 0], k=3)
queried = {int(i): round(float(distance), 4) for i, distance in zip(neighbours, distances)}
seen = [(math.hypot(*place), queried[i], round(index.get_distance([0, 0], place), 4)) for i, place in enumerate(places)]
print("by hand, query(), get_distance():", *seen)
sys.exit("square root" not in told or seen != [(5, 25, 25), (0.5, 0.25, 0.25), (50, 2500, 2500)])
END
