# SPDX-License-Identifier: Apache-2.0
"""Makes the figures and the page of citylearn paper from the results.json and report.json in a folder."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "lab"))

import report

if __name__ == "__main__":
    sys.exit(report.main(sys.argv[1:]))
