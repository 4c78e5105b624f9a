# SPDX-License-Identifier: Apache-2.0
"""The Kubernetes manifests: each overlay is rendered, and those without secrets run as pods under `podman kube play`. Podman 4.3 knows
Pods, ConfigMaps and volume claims. It has no StatefulSets, Jobs, Services, network policies or secrets in files, so each pod is made
from its template, and finds the others by podman's names."""

import copy
import json
import tempfile
import unittest

import yaml

import support
from support import COMPOSE, podman, wait_for

FOLDER = COMPOSE / "kubernetes"
SHORT = {"env-train.toml": {'"0:128"': '"0:48"'}, "env-evaluate.toml": {'"0:128"': '"0:48"'},
         "policy.toml": {'"0:128"': '"0:48"', "seed = 1": "seed = 1\nsteps = 300000\ntasks = 50"}, "encoder.toml": {"store =": "dimension = 24\nstore ="}}


def render(overlay):
    """Objects by kind and name."""
    objects = list(yaml.safe_load_all(support.call("kubectl", "kustomize", FOLDER / overlay)))
    return {(each["kind"], each["metadata"]["name"]): each for each in objects}


def templates(objects):
    """Kind, name, spec and pod template of all that has pods."""
    return [(kind, name, each["spec"], each["spec"]["template"]) for (kind, name), each in objects.items() if "template" in each.get("spec", {})]


class Manifests(unittest.TestCase):
    def test_each_overlay_is_complete(self):
        for overlay in ("one-node", "n-actors", "secured"):
            objects = render(overlay)
            names = {name for kind, name in objects}
            for kind, name, spec, template in templates(objects):
                where = f"{overlay}: {kind} {name}"
                pod, (container, *others) = template["spec"], template["spec"]["containers"]
                self.assertFalse(others, where)
                self.assertTrue(pod["securityContext"]["runAsNonRoot"] and container["securityContext"]["readOnlyRootFilesystem"], where)
                self.assertTrue(container["resources"]["requests"]["cpu"] and container["resources"]["limits"]["memory"], where)
                self.assertTrue(container["startupProbe"] and container["livenessProbe"] and container["readinessProbe"], where)
                self.assertEqual(template["metadata"]["labels"]["app.kubernetes.io/part-of"], "citylearn", where)
                for volume in pod["volumes"]:
                    named = volume.get("configMap", {}).get("name") or volume.get("persistentVolumeClaim", {}).get("claimName")
                    self.assertTrue(named is None or named in names, f"{where}: {named}")
                self.assertLessEqual({each["name"] for each in container["volumeMounts"]}, {each["name"] for each in pod["volumes"]}, where)
            # Every pod with a name is a peer.
            network = next(each["data"] for (kind, name), each in objects.items() if name.startswith("citylearn-network"))
            expected = set()
            for kind, name, spec, template in templates(objects):
                if kind == "StatefulSet":
                    expected |= {f"{name}-{number}.{spec['serviceName']}" for number in range(spec["replicas"])}
                if kind == "Job":
                    expected.add(f"{template['spec']['hostname']}.{template['spec']['subdomain']}")
            self.assertEqual(set(network["CITYLEARN_PEERS"].split(",")), expected, overlay)
            self.assertEqual(objects["Service", "citylearn"]["spec"]["selector"], {"app.kubernetes.io/part-of": "citylearn"})


class Played(unittest.TestCase):
    def pods(self, objects):
        """What podman can play: a pod for each replica, maps and claims, with names of this test's own."""
        own = support.OWN + "-"
        played = []
        for (kind, name), each in objects.items():
            if kind == "ConfigMap":
                for file, changes in SHORT.items():
                    for before, after in changes.items() if file in each["data"] else ():
                        self.assertIn(before, each["data"][file])
                        each["data"][file] = each["data"][file].replace(before, after)
                peers = each["data"].get("CITYLEARN_PEERS")
                if peers:
                    each["data"]["CITYLEARN_PEERS"] = ",".join(f"dns:{own}{peer.removesuffix('.citylearn')}" for peer in peers.split(","))
            if kind in ("ConfigMap", "PersistentVolumeClaim"):
                each["metadata"]["name"] = own + name
                played.append(each)
        # Pods without a name last: they ask those that have one. In Kubernetes they are started again until all names resolve.
        for kind, name, spec, template in sorted(templates(objects), key=lambda each: each[0] == "Deployment"):
            for number in range(spec.get("replicas", 1)):
                pod = copy.deepcopy(template["spec"])
                for volume in pod["volumes"]:
                    for source, key in (("persistentVolumeClaim", "claimName"), ("configMap", "name")):
                        if source in volume:
                            volume[source][key] = own + volume[source][key]
                for container in pod["containers"]:
                    container["envFrom"][0]["configMapRef"]["name"] = own + container["envFrom"][0]["configMapRef"]["name"]
                    container["image"] = f"localhost/{container['image']}:{support.TAG}"
                    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):  # podman forgets the quotes of a command
                        container.pop(probe, None)
                pod.setdefault("restartPolicy", "Always")
                identity = name if kind == "Job" else f"{name}-{number}"
                pod["hostname"] = identity
                pod.pop("subdomain", None)
                played.append({"apiVersion": "v1", "kind": "Pod", "metadata": {"name": own + identity, "labels": {"test": support.OWN}}, "spec": pod})
        return played

    def clean(self):
        for words in (["pod", "ls"], ["volume", "ls"]):
            found = [name for name in podman(*words, "--format", "{{.Name}}").split() if name.startswith(support.OWN)]
            if found:
                podman(words[0], "rm", "--force", *found, check=False)
        podman("network", "rm", "--force", support.OWN, check=False)

    def log(self, pod, container):
        return podman("logs", f"{support.OWN}-{pod}-{container}", check=False)

    def report(self):
        names = podman("ps", "--all", "--filter", f"label=test={support.OWN}", "--format", "{{.Names}}", check=False).split()
        return podman("pod", "ls") + "".join(f"\n---- {name}\n{podman('logs', '--tail', '15', name, check=False)}" for name in names)

    def play(self, overlay):
        self.addCleanup(self.clean)
        podman("network", "create", support.OWN)
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            yaml.safe_dump_all(self.pods(render(overlay)), file)
            file.flush()
            podman("kube", "play", "--quiet", "--network", support.OWN, file.name)
        state = ["inspect", "--format", "{{.State.Status}} {{.State.ExitCode}}", f"{support.OWN}-policy-policy"]
        wait_for("the policy_service has ended", 300, lambda: podman(*state, check=False).startswith("exited"), self.report)
        self.assertEqual(podman(*state), "exited 0", self.report())
        runs = podman("volume", "inspect", "--format", "{{.Mountpoint}}", f"{support.OWN}-runs")
        with open(f"{runs}/city/summary.json", encoding="utf-8") as file:
            evaluated = json.load(file)["evaluate"]
        self.assertEqual(sorted(evaluated), ["fall", "summer"])
        for figures in evaluated.values():
            self.assertGreater(figures["spl"], 0.95)

    def test_one_node(self):
        self.play("one-node")
        for kind, name, spec, template in templates(render("one-node")):
            container = template["spec"]["containers"][0]
            if kind == "StatefulSet":
                probe = ["podman", "exec", f"{support.OWN}-{name}-0-{container['name']}", *container["startupProbe"]["exec"]["command"]]
                wait_for(f"{name} is healthy", 60, lambda probe=probe: support.status_of(*probe) == 0, self.report)

    def test_actors(self):
        self.play("n-actors")
        joined = self.log("policy", "policy")
        for number in range(3):
            self.assertIn(f"actor 'actor-{number}' joins", joined)


if __name__ == "__main__":
    support.main(support.missing(["kubectl", "catatonit"]))
