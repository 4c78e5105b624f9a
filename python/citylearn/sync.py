# SPDX-License-Identifier: Apache-2.0
"""python3 -m citylearn.sync DIR: sends logs of runs to the dashboard."""

import sys

from .run_log import main

if __name__ == "__main__":
    sys.exit(main())
