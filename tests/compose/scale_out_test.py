# SPDX-License-Identifier: Apache-2.0
"""compose/scale-out.yaml, run: an actor, an encoder_service, a replica of the env_services and the learner are killed in it."""

import support


class ScaleOut(support.Topology):
    def test_trains_to_the_end_though_services_are_killed(self):
        with support.Up(support.COMPOSE / "scale-out.yaml", "--exit-code-from", "learner",
                        settings=self.SETTINGS | {"DOMAIN": 27, "ENVS": 2}) as up:
            self.expect_all_healthy(up, "learner")
            for service in ("actor-1", "encoder-1", "env-2", "learner"):
                up.kill(service)
            self.expect_good_run(up)


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces()])
