# SPDX-License-Identifier: Apache-2.0
class ComposeError(Exception):
    """One line: where, what, and what to do about it."""

    def __init__(self, what, where="", todo=""):
        super().__init__((f"{where}: " if where else "") + what + (f" ({todo})" if todo else ""))
