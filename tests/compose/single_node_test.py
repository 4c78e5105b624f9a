# SPDX-License-Identifier: Apache-2.0
"""compose/single-node.yaml, run: an env_service and the policy_service are killed in it."""


import support


class SingleNode(support.Topology):
    def test_trains_to_the_end_though_services_are_killed(self):
        with support.Up(support.COMPOSE / "single-node.yaml", "--exit-code-from", "policy",
                        settings=self.SETTINGS | {"DOMAIN": 26}) as up:
            self.expect_all_healthy(up, "policy")
            if (support.PREFIX / "share/citylearn/page").exists():
                asked = r'exec 3<>/dev/tcp/127.0.0.1/8080; printf "GET / HTTP/1.0\r\nHost: localhost\r\n\r\n" >&3; cat <&3'
                self.assertIn("<!doctype html>", up.inside("dashboard", "bash", "-c", asked).lower())
            up.kill("env-train")
            up.kill("policy")
            self.expect_good_run(up)
            self.assertIn("resuming after update", up.log("policy"))


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces()])
