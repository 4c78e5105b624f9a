#!/usr/bin/env bash
# utm 0.1.6 of crates.io gives a place's northing, easting and meridian convergence, the angle between true north and
# the grid's. One would expect it to change its sign at the equator. It is computed from the northing together with the
# 10,000 km that southern ones have on top, as if the place were that far from the equator to the north: at Sydney it
# has the other sign and is more than twice as large, and near the equator, where it is next to nothing, it is largest.
# Northing and easting are right, and so is the angle in the north, positive to the west.
# It hurts those who turn headings into a map's grid: in the south agents look in another direction than they go.
# Seen in degrees, two degrees west of the zone's middle at 33 N, 33 S and 1 S: 1.09 2.60 -47.10; right by
# atan(tan(2) sin(latitude)) are 1.09 -1.09 -0.03. Needs cargo.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
mkdir src
cat >Cargo.toml <<'END'
[package]
name = "convergence"
version = "1.0.0"
edition = "2021"
[dependencies]
utm = "=0.1.6"
END
cat >src/main.rs <<'END'
fn main() {
    for latitude in [33.0_f64, -33.0, -1.0] {
        let (_, _, convergence) = utm::to_utm_wgs84(latitude, 151.0, 56); // zone 56's middle is 153 E
        let right = (2.0_f64.to_radians().tan() * latitude.to_radians().sin()).atan();
        println!("{:.2} {:.2}", convergence.to_degrees(), right.to_degrees());
    }
}
END
seen=$(cargo run --quiet)
echo "utm 0.1.6, convergence and what is right in degrees at 33 N, 33 S and 1 S:"
echo "$seen"; [ "$seen" = "$(printf '1.09 1.09\n2.60 -1.09\n-47.10 -0.03')" ]
