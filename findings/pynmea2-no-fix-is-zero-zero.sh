#!/bin/sh
# pynmea2 1.19.0: sentences without a fix (RMC of status V, GGA of quality 0, GLL of status V) have latitude and
# longitude 0.0, a place in the Gulf of Guinea, not None and no error: a drive that begins in a garage starts there.
# Only `is_valid` says so. The fields as text are empty.
# Installs pynmea2 and parses sentences as receivers send them before their first fix. Status 1: this has changed.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pynmea2==1.19.0
"$folder/venv/bin/python" - <<'END'
import functools
import operator
import sys
import pynmea2

print("pynmea2", pynmea2.version)
seen = []
for text in ("GNRMC,101502.00,V,,,,,,,010626,,,N", "GNGGA,101502.00,,,,,0,00,99.99,,,,,,", "GNGLL,,,,,101502.00,V,N"):
    sentence = pynmea2.parse(f"${text}*{functools.reduce(operator.xor, text.encode()):02X}")
    seen.append((sentence.lat, sentence.lon, sentence.latitude, sentence.longitude, sentence.is_valid))
    print(text, "-> lat, lon, latitude, longitude, is_valid", seen[-1])
sys.exit(seen != [("", "", 0.0, 0.0, False)] * 3)
END
