#!/usr/bin/env bash
# geotiff 3.0.5 for npm (geotiff.js): in a GeoTIFF whose pixels are points, as height models often are, the tie point is
# the middle of the first pixel; where they are areas it is its outer corner. One would expect getBoundingBox() to be
# the same for a map that is written both ways, as with GDAL (rasterio 1.4.4). It takes the tie point for the corner in
# both: the box is half a pixel off, and so are the windows of readRasters({bbox}) and the README's way to a height.
# It hurts those who look up the heights of routes: with pixels of 30 m the land lies 15 m too far east and south.
# Seen, of 4 x 4 pixels of 30 m from (0, 0) to (90, 90) that rise by 10 m a pixel: as areas the box begins at -15, as
# points at 0 (GDAL: both -15); the height at 55 m is 20 and 10 (GDAL: both 20). Needs python3, node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet rasterio==1.4.4 numpy==2.4.6
npm install --silent --no-audit --no-fund geotiff@3.0.5 >npm.log 2>&1
venv/bin/python - <<'END'
import numpy as np
import rasterio

for kind in ("Area", "Point"):
    with rasterio.open(f"{kind}.tif", "w", driver="GTiff", width=4, height=4, count=1, dtype="float32",
                       crs="EPSG:32632", transform=rasterio.Affine(30, 0, -15, 0, -30, 105)) as heights:
        heights.update_tags(AREA_OR_POINT=kind)
        heights.write(np.tile(np.arange(0, 40, 10, np.float32), (4, 1)), 1)
    with rasterio.open(f"{kind}.tif") as heights:
        seen = (*heights.bounds, *next(heights.sample([(55, 55)])))
    print("GDAL", kind, *seen)
    assert seen == (-15, -15, 105, 105, 20)
END
node --input-type=module - <<'END'
import {fromFile} from "geotiff";
for (const [kind, told] of [["Area", "-15,-15,105,105,20"], ["Point", "0,-30,120,90,10"]]) {
  const image = await (await fromFile(`${kind}.tif`)).getImage();
  const [west, south, east, north] = image.getBoundingBox();
  const [heights] = await image.readRasters();
  const seen = [west, south, east, north, heights[Math.floor((55 - west) / 30) + 4 * Math.floor((north - 55) / 30)]];
  console.log("geotiff.js", kind, ...seen);
  if (seen.join() !== told) process.exitCode = 1;
}
END
