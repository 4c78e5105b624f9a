# SPDX-License-Identifier: Apache-2.0
"""The units under a real systemd, in a container: verified, scored, started by their target, restarted when killed."""

import re
import unittest

import support
from support import COMPOSE, PREFIX, UNITS, podman, wait_for

IMAGE = f"localhost/citylearn-systemd:{support.TAG}"
# `systemd-analyze security` of each unit, 0 (confined) to 10 (exposed); docs/how-to/run-on-a-cluster.md states it.
MOST_EXPOSED = 1.6
# The libraries come from the image of the services; the programs and units from where `cmake --install` put them.
CONTAINERFILE = f"""FROM {support.BASE}
RUN apt-get update && apt-get install -y --no-install-recommends systemd && rm -rf /var/lib/apt/lists/*
COPY --from={support.SERVICES} /usr/lib /usr/lib
COPY --from={support.SERVICES} /etc/alternatives /etc/alternatives
COPY --from=prefix / /usr/local
RUN systemd-sysusers && install -D /usr/local/share/citylearn/citylearn.env /etc/citylearn/example.env
"""


class Systemd(support.SystemdCase):
    IMAGE = IMAGE

    def test_verify_finds_nothing_and_each_is_confined(self):
        units = [f"/usr/local/lib/systemd/system/{path.name}" for path in sorted((COMPOSE / "systemd").glob("citylearn*.[st]*"))
                 if path.suffix in (".service", ".target")]
        self.assertEqual(len(units), 6)
        self.assertEqual(self.inside("systemd-analyze", "verify", *units), "")
        for unit in UNITS:
            said = self.inside("systemd-analyze", "security", "--no-pager", unit)
            score = float(re.search(r"Overall exposure level for \S+: ([\d.]+)", said)[1])
            print(f"{unit}: {score}", flush=True)
            self.assertLessEqual(score, MOST_EXPOSED, said)

    def test_the_target_starts_all_and_systemd_restarts_what_dies(self):
        self.start_target()
        self.inside("systemctl", "kill", "--signal", "KILL", "citylearn-env@summer")
        wait_for("the env_service is restarted", 30, lambda: self.property_of("citylearn-env@summer", "NRestarts") == "1" and
                 self.property_of("citylearn-env@summer", "ActiveState") == "active", self.report)
        self.expect_trained()

    def test_a_wrong_option_is_not_tried_again(self):
        self.inside("sh", "-c", "echo 'ENCODER_OPTIONS=--no-such-option' >/etc/citylearn/encoder.env")
        self.inside("systemctl", "start", "citylearn-encoder")
        wait_for("it has failed", 30, lambda: self.property_of("citylearn-encoder", "ActiveState") == "failed", self.report)
        self.assertEqual(self.property_of("citylearn-encoder", "NRestarts"), "0")
        self.assertIn("no-such-option", self.report())


if __name__ == "__main__":
    reason = support.missing(images=(support.SERVICES, support.BASE)) or support.build_image(IMAGE, CONTAINERFILE, "--build-context", f"prefix={PREFIX}")
    unittest.addModuleCleanup(podman, "image", "rm", "--force", IMAGE, check=False)
    support.main(reason)
