"""The tables of `radcam-depth inspect`."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console

from radcam_depth_ros.inspection import CameraFacts, CloudFacts, Report, TopicFacts
from radcam_depth_ros.reporting.terminal import PlainConsole, print_table

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def print_report(report: Report) -> None:
    """Prints everything to the terminal."""
    console = PlainConsole()
    _print_topics(console, report)
    print_table(console, "contents", ("topic", "what it has"), tuple(_contents(report)), justify="left")
    if report.frames:
        console.print("frames:", *(f"  {line}" for line in report.frames), sep="\n")
    if report.extrinsics:
        _print_radars(console, report)
    for finding in report.findings:
        console.print(f"{finding.severity}: {finding.text}", style=_STYLES[finding.severity])
    if report.missing:
        is_told = any(report.missing in finding.text for finding in report.findings)
        console.print(f"cannot be replayed: {'see above' if is_told else report.missing}")
    elif not report.findings:
        console.print("nothing is missing")


def _print_topics(console: Console, report: Report) -> None:
    rows = tuple(
        (
            topic.topic,
            topic.type.rsplit("/", 1)[-1] + _quality(topic),
            topic.role,
            str(topic.messages),
            *(_number(value) for value in (topic.hz, topic.jitter_ms, topic.largest_gap_s, topic.delay_ms)),
            " ".join(frame or '""' for frame in topic.frame_ids),
        )
        for topic in report.topics
    )
    print_table(
        console,
        f"{report.bag}, {report.seconds:.1f} s",
        ("topic", "type", "taken for", "n", "hz", "jitter ms", "gap s", "after ms", "frame"),
        rows,
        "jitter: of 95 % of the intervals; gap: the longest; after: from a message's stamp to its recording, median",
        justify="left",
    )


def _quality(topic: TopicFacts) -> str:
    words = [word for word, told in (("latched", topic.latched), ("best effort", not topic.reliable)) if told]
    return f" ({', '.join(words)})" if words else ""


def _contents(report: Report) -> Iterator[tuple[str, str]]:
    """Topics and what they hold."""
    for image in report.images:
        size = f", {image.width} x {image.height} pixels" if image.width else ""
        yield image.topic, f"{image.encoding}{size}"
    for camera in report.cameras:
        yield camera.topic, _camera(camera)
    for cloud in report.clouds:
        yield cloud.topic, _cloud(cloud)


def _camera(camera: CameraFacts) -> str:
    if camera.focal_length_px is None:
        return "no usable calibration"
    lens = "free of distortion"
    if camera.is_distorted:
        lens = f"{camera.model or 'rotation'} {' '.join(f'{value:.4g}' for value in camera.distortion)}, is rectified"
    return f"{camera.width} x {camera.height} pixels, focal length {camera.focal_length_px} px, {lens}"


def _cloud(cloud: CloudFacts) -> str:
    fields = " ".join(cloud.fields) or "no fields"
    if cloud.points is None:
        return fields
    taken = (
        ("position", " ".join(cloud.position)),
        ("RCS", cloud.rcs),
        ("Doppler", " ".join(cloud.radial_speed)),
    )
    least, median, most = cloud.points
    if not cloud.position:
        return f"{fields}; {median} points ({least} to {most})"
    told = ", ".join(f"{name}: {value or 'none'}" for name, value in taken)
    return f"{fields}; taken for {told}; {median} points ({least} to {most})"


def _print_radars(console: Console, report: Report) -> None:
    offsets, rows = {facts.topic: facts for facts in report.offsets}, []
    for facts in report.extrinsics:
        place = "unknown" if facts.position_m is None else ", ".join(f"{value:.2f}" for value in facts.position_m)
        offset = offsets.get(facts.topic)
        times = (offset.median_ms, offset.p95_ms, offset.clock_ms) if offset else (None, None, None)
        rows.append((facts.topic, place, *(_number(value) for value in (facts.heading_deg, *times))))
    print_table(
        console,
        "radars",
        ("topic", "place m", "looks right deg", "nearest sweep ms", "p95 ms", "clock ms"),
        rows,
        "place: in the camera's frame, right, down, forward; nearest sweep: its stamp minus the image's, median; "
        "clock: how far its stamps are ahead of the images', by the recorder's clock",
        justify="left",
    )


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
