# SPDX-License-Identifier: Apache-2.0
"""compose/multi-host.yaml, run: env_services and encoder_service on one host, policy_service and dashboard on another."""

import support

FILE = support.COMPOSE / "multi-host.yaml"


class MultiHost(support.Topology):
    SETTINGS = support.Topology.SETTINGS | {"PEERS": "envs,learner"}

    def test_two_hosts_find_each_other_by_unicast_and_again_when_one_is_killed(self):
        with support.Up(FILE, "--profile", "*", "--exit-code-from", "policy", settings=self.SETTINGS | {"DOMAIN": 28}) as up:
            self.expect_all_healthy(up, "policy")
            states = up.states()
            self.assertEqual(states["env-train"]["address"], states["encoder"]["address"])
            self.assertNotEqual(states["env-train"]["address"], states["policy"]["address"])
            up.kill("env-train")
            self.expect_good_run(up)

    def test_and_so_they_do_over_the_other_vendor(self):
        with support.Up(FILE, "--profile", "*", "--exit-code-from", "policy",
                        settings=self.SETTINGS | {"DOMAIN": 29, "MIDDLEWARE": "fastdds",
                                                  "POLICY_OPTIONS": "--steps 60000 --tasks 50"}) as up:
            self.expect_good_run(up)


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces()])
