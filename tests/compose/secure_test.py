# SPDX-License-Identifier: Apache-2.0
"""compose/secure.yaml, run with a keystore made as its first lines say; who has no keys finds nobody."""

import re
import subprocess

import support

FILE = support.COMPOSE / "secure.yaml"
KEYSTORE = support.COMPOSE / "keystore"


def keystore(folder):
    """The commands of the file's own comment."""
    subprocess.run([KEYSTORE, "create", folder], check=True, stdout=subprocess.DEVNULL)
    named = re.search(r"<<END\n(.*?)#   END", FILE.read_text(), re.DOTALL)[1]
    for line in named.splitlines():
        kind, name = line.strip("# ").split()
        subprocess.run([KEYSTORE, "add", folder, kind, name], check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["chown", "-R", "10001:10001", f"{folder}/{name}"], check=True)


class Secure(support.Topology):
    def test_trains_to_the_end_though_a_service_is_killed(self):
        for number, middleware in enumerate(("cyclonedds", "fastdds")):
            with self.subTest(middleware), support.tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
                keystore(f"{folder}/keys")
                settings = self.SETTINGS | {"DOMAIN": 24 + number, "MIDDLEWARE": middleware, "KEYS": f"{folder}/keys"}
                with support.Up(FILE, "--exit-code-from", "policy", settings=settings) as up:
                    self.expect_all_healthy(up, "policy")
                    up.kill("policy")
                    self.expect_good_run(up)

    def test_a_service_without_its_keys_does_not_start(self):
        with support.tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
            with support.Up(FILE, settings=self.SETTINGS | {"DOMAIN": 24, "KEYS": f"{folder}/none"}) as up:
                support.wait_for("a complaint", 30, lambda: "/keys/env-train" in up.log("env-train"))


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces(),
                  "" if KEYSTORE.exists() else "compose/keystore is missing"])
