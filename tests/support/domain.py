# SPDX-License-Identifier: Apache-2.0
"""DDS domains for tests."""

import fcntl
import os

DOMAINS = range(110, 200)  # as tests/support/processes/domain.h


def own_domain():
    """Returns a DDS domain that no other test on this machine has, until this process and its children have ended."""
    for tried in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + tried) % len(DOMAINS)]
        file = os.open(f"/tmp/citylearn-test-domain-{domain}", os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            continue
        os.set_inheritable(file, True)
        return domain
    raise AssertionError("no DDS domain is free for a test")
