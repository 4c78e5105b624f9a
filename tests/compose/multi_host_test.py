"""compose/multi-host.yaml, run: env_services and encoder_service on one host, policy_service and dashboard on another."""

import support

FILE = support.COMPOSE / "multi-host.yaml"


class MultiHost(support.Topology):
    def test_two_hosts_find_each_other_by_unicast_whatever_the_vendor(self):
        for number, middleware in enumerate(("cyclonedds", "fastdds")):
            with self.subTest(middleware), support.Up(
                    FILE, "--profile", "*", "--exit-code-from", "policy",
                    settings=self.SETTINGS | {"DOMAIN": 28 + number, "PEERS": "envs,learner", "MIDDLEWARE": middleware,
                                              "POLICY_OPTIONS": "--steps 60000 --tasks 50"}) as up:
                self.expect_good_run(up)

    def test_a_killed_env_service_on_the_other_host_comes_back(self):
        with support.Up(FILE, "--profile", "*", "--exit-code-from", "policy",
                        settings=self.SETTINGS | {"DOMAIN": 28, "PEERS": "envs,learner"}) as up:
            self.expect_all_healthy(up, "policy")
            states = up.states()
            self.assertEqual(states["env-train"]["address"], states["encoder"]["address"])
            self.assertNotEqual(states["env-train"]["address"], states["policy"]["address"])
            up.kill("env-train")
            self.expect_good_run(up)


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces()])
