"""`radcam-depth inspect`: lists the contents of a bag that the node needs."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from radcam_depth_ros.cli.terminal.options import Bag, JsonOption, keep_apart, progress_bar, write_json
from radcam_depth_ros.reporting.terminal import PlainConsole


def inspect(
    bag: Bag,
    json_target: JsonOption = None,
    write_params: Annotated[
        Path | None, typer.Option(help="Write the node's parameters that fit the bag to this YAML file.")
    ] = None,
    params: Annotated[Path | None, typer.Option(hidden=True, help="The former name of --write-params.")] = None,
) -> None:
    """Lists what a bag holds for the node: topics, rates, contents, frames, clocks, and what is missing.

    Example: radcam-depth simulate out/seen --seed 7 --frames 20 &&
    radcam-depth inspect out/seen --write-params out/seen.yaml
    """
    from radcam_depth_ros import inspection
    from radcam_depth_ros.cli.terminal.inspect_tables import print_report
    from radcam_depth_ros.frame import RadcamDepthError

    if params is not None:
        typer.echo(
            "inspect --params is now --write-params, and will be gone in the next release: --params reads a file "
            "everywhere else",
            err=True,
        )
    keep_apart((json_target, write_params, params), (bag,))
    target = write_params or params
    with progress_bar() as bar:
        task = bar.add_task("reading", total=None)
        report = inspection.survey(bag, lambda done, total: bar.update(task, completed=done, total=total))
    if json_target is not None:
        write_json(dataclasses.asdict(report), json_target)
    else:
        print_report(report)
    if target is None:
        return
    if report.suggestion is None:
        # Beside the tables it has been said why.
        why = "see above" if json_target is None else report.missing
        raise RadcamDepthError(f"{target} is not written, since no parameters fit {bag}: {why}")
    inspection.write_parameters(target, report.suggestion, bag.name)
    PlainConsole(stderr=True).print(
        f"parameters: {target}; start the node with --ros-args --params-file {target}", soft_wrap=True
    )
