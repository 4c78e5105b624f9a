#!/usr/bin/env bash
# hnswlib 0.8.0, an index for similarity search: add_items(data, ids) takes labels, and without `ids` it makes them up.
# One would expect made-up labels to be free ones. They count on from the number of vectors in the index. Where given
# labels do not count from 0 without gaps, as numbers of pictures that were thinned out or begin later do not, a made-up
# label may be in use, and then the new vector replaces the old one, without a word.
# It hurts those who add places to an index that was made with labels: older places are gone, and their labels lead to
# other places. Give labels always, or never.
# Seen, of places 0 10 20 labelled 2 3 4 and then 100 110 120 without labels: 4 of 6 are left, the places of labels 2 to
# 5 are 0 100 110 120, and nearest to place 10 is place 0. Needs python3 and a C++ compiler.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet hnswlib==0.8.0 numpy==2.4.6
"$folder/venv/bin/python" - <<'END'
import sys
import hnswlib
import numpy as np

index = hnswlib.Index(space="l2", dim=1)
index.init_index(max_elements=10)
index.add_items(np.array([[0], [10], [20]], np.float32), ids=[2, 3, 4])
index.add_items(np.array([[100], [110], [120]], np.float32))
places = {int(label): int(index.get_items([label])[0][0]) for label in sorted(index.get_ids_list())}
(label,), (distance,) = (answer[0] for answer in index.knn_query([[10]], k=1))
print(f"hnswlib 0.8.0, labels and places: {places}; nearest to 10: label {label}, squared distance {distance}")
sys.exit((places, label, distance) != ({2: 0, 3: 100, 4: 110, 5: 120}, 2, 100))
END
