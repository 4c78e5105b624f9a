# SPDX-License-Identifier: Apache-2.0
"""The commands that pages of the manual show."""

import re


def commands(page):
    """Yields line number and words of each command in a page's code blocks, without what stands before and after it: the name
    of a host, variables, a comment."""
    inside, held = False, ""
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if line.lstrip().startswith("```"):
            inside = not inside
            continue
        if not inside and not line.startswith("    "):
            continue
        line = held + line.split(" # ")[0].strip()
        held = ""
        if line.endswith("\\"):
            held = line[:-1]
            continue
        line = re.sub(r"^(host[A-Z]|[a-z0-9]+)?\$ ", "", line)
        line = re.sub(r"^([A-Z_]+=\S+ )+", "", line)
        yield number, line.replace("|", " ").split()
