"""Example manifests: what they run is a command that there is, and their form is that of their schema."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from radcam_depth_ros.cli import app

FLEET = Path(__file__).parents[2] / "config" / "fleet"


def test_the_kubernetes_job_is_an_indexed_job() -> None:
    job = yaml.safe_load((FLEET / "kubernetes_job.yaml").read_text(encoding="utf-8"))
    spec, pod = job["spec"], job["spec"]["template"]["spec"]
    assert (job["apiVersion"], job["kind"], spec["completionMode"]) == ("batch/v1", "Job", "Indexed")
    assert f"/{spec['completions']}" in pod["containers"][0]["args"][0]
    # What the API demands: a policy of failures, and a limit for each index, go with Never alone.
    assert pod["restartPolicy"] == "Never"
    rule = spec["podFailurePolicy"]["rules"][0]["onExitCodes"]
    assert rule["containerName"] == pod["containers"][0]["name"]
    mounted = {mount["name"] for container in pod["containers"] for mount in container["volumeMounts"]}
    assert mounted == {volume["name"] for volume in pod["volumes"]}


def test_the_kubernetes_job_fits_the_schema_of_kubernetes() -> None:
    validator: Any = pytest.importorskip("kubernetes_validate", reason="pip install kubernetes-validate")
    job = yaml.safe_load((FLEET / "kubernetes_job.yaml").read_text(encoding="utf-8"))
    validator.validate(job, validator.latest_version(), strict=True)


def test_the_argo_workflow_refers_to_what_it_has() -> None:
    workflow = yaml.safe_load((FLEET / "argo_workflow.yaml").read_text(encoding="utf-8"))
    assert (workflow["apiVersion"], workflow["kind"]) == ("argoproj.io/v1alpha1", "Workflow")
    spec = workflow["spec"]
    templates = {template["name"]: template for template in spec["templates"]}
    assert spec["entrypoint"] in templates
    volumes = {volume["name"] for volume in spec["volumes"]}
    for template in templates.values():
        kinds = {"steps", "dag", "container", "script"} & template.keys()
        assert len(kinds) == 1
        for group in template.get("steps", []):
            for step in group:
                given = {entry["name"] for entry in step.get("arguments", {}).get("parameters", [])}
                wanted = templates[step["template"]].get("inputs", {}).get("parameters", [])
                assert given == {entry["name"] for entry in wanted}
        container = template.get("container", {})
        assert {mount["name"] for mount in container.get("volumeMounts", [])} <= volumes
    count = templates["fleet"]["steps"][0][0]["withSequence"]["count"]
    assert any(f"/{count}" in argument for argument in templates["evaluate"]["container"]["args"])


def commands() -> list[list[str]]:
    job = yaml.safe_load((FLEET / "kubernetes_job.yaml").read_text(encoding="utf-8"))
    batch = json.loads((FLEET / "aws_batch_job.json").read_text(encoding="utf-8"))
    texts = [
        job["spec"]["template"]["spec"]["containers"][0]["args"][0],
        batch["containerOverrides"]["command"][-1],
        (FLEET / "slurm_array.sh").read_text(encoding="utf-8").splitlines()[-1],
    ]
    found = [shlex.split(re.sub(r"\$\w+", "1", text))[1:] for text in texts]
    workflow = yaml.safe_load((FLEET / "argo_workflow.yaml").read_text(encoding="utf-8"))
    argo = [template["container"] for template in workflow["spec"]["templates"] if "container" in template]
    return [*found, *([*container["command"], *container["args"]] for container in argo)]


@pytest.mark.parametrize("words", commands())
def test_what_manifests_run_is_a_command(words: list[str]) -> None:
    program, verb, *given = words
    assert program == "radcam-depth"
    command: Any = getattr(typer.main.get_command(app), "commands", {})[verb]
    context = command.make_context(verb, [], resilient_parsing=True)
    context.resilient_parsing = False
    _, rest, _ = command.make_parser(context).parse_args(given)
    assert not rest
