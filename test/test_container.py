"""The container's files ask for no more rights than the node needs; Docker itself is not run."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
WITH_VALUES = {"--network", "--ipc", "--cap-drop", "--security-opt", "--gpus", "-v", "--tmpfs"}


def instructions() -> list[tuple[str, str]]:
    """Of the Dockerfile: the word and what follows it."""
    lines = re.sub(r"^#.*\n", "", DOCKERFILE, flags=re.M).replace("\\\n", " ").splitlines()
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in lines if line.strip()]


@pytest.fixture(scope="module")
def service() -> dict[str, Any]:
    content = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
    (service,) = content["services"].values()
    return dict(service)


def user_id() -> int:
    (value,) = [text for word, text in instructions() if word == "ARG" and text.startswith("USER_ID=")]
    return int(value.partition("=")[2])


def run_commands() -> list[tuple[str, list[str]]]:
    """The words after `docker run`, of all commands of the docs, with the page."""
    found = []
    for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        found += [(page.name, shlex.split(line)[2:]) for line in re.findall(r"^docker run .*$", text, re.M)]
    return found


def test_what_runs_is_a_user_of_its_own_who_owns_only_the_logs() -> None:
    words = [word for word, _ in instructions()]
    assert words.count("USER") == 1
    user = dict(instructions())["USER"]
    assert user == "${USER_ID}:${USER_ID}"
    assert user_id() > 1000
    # Nothing is made or changed as that user: what runs belongs to root.
    after = words[words.index("USER") + 1 :]
    assert set(after) == {"ENTRYPOINT", "CMD"}
    assert not re.search(r"chown|chmod|--chown|sudo|setcap", DOCKERFILE)
    assert re.findall(r'-o "\$\{USER_ID\}" -g "\$\{USER_ID\}" (\S+)', DOCKERFILE) == ["/var/log/radcam_depth"]


def test_the_logs_and_the_home_are_where_it_may_write(service: dict[str, Any]) -> None:
    variables = dict(
        entry.split("=", 1) for word, text in instructions() if word == "ENV" for entry in shlex.split(text)
    )
    writable = {entry.partition(":")[0] for entry in service["tmpfs"]}
    assert writable == {variables["ROS_LOG_DIR"], variables["HOME"]} == {"/var/log/radcam_depth", "/tmp"}
    (logs,) = [entry for entry in service["tmpfs"] if "/var/log" in entry]
    assert f"uid={user_id()},gid={user_id()}" in logs


def test_compose_takes_all_rights_away(service: dict[str, Any]) -> None:
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert not {"privileged", "cap_add", "devices", "user", "pid", "volumes"} & set(service)
    assert (ROOT / "docker" / service["build"]["context"] / service["build"]["dockerfile"]).samefile(
        ROOT / "docker" / "Dockerfile"
    )


def test_each_documented_run_has_the_same_rights(service: dict[str, Any]) -> None:
    commands = run_commands()
    assert len(commands) == 2
    for page, words in commands:
        options = words[: next(index for index, word in enumerate(words) if word.startswith("radcam_depth"))]
        given = [(word, options[index + 1]) for index, word in enumerate(options) if word in WITH_VALUES]
        assert "--read-only" in options, page
        assert "--privileged" not in options, page
        assert [value for name, value in given if name == "--cap-drop"] == service["cap_drop"], page
        assert [value for name, value in given if name == "--security-opt"] == service["security_opt"], page
        assert [value for name, value in given if name == "--tmpfs"] == service["tmpfs"], page
        assert all(value.endswith(":ro") for name, value in given if name == "-v"), page
