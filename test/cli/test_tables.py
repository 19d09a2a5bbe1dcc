"""Tables can be read at 80 columns: nothing is wider, nothing is cut off, no figure is lost."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from radcam_depth_ros.benchmarking.figures import (
    AgainstFigures,
    Description,
    PairFigures,
    SectionFigures,
    SideFigures,
    SizeFigures,
)
from radcam_depth_ros.benchmarking.figures import Report as BenchReport
from radcam_depth_ros.benchmarking.machine import CONVOLUTION, MATRIX_PRODUCT, Machine
from radcam_depth_ros.benchmarking.subject import Size
from radcam_depth_ros.calibration.report import Fit, SensorReport
from radcam_depth_ros.cli.check_calibration import _print_places
from radcam_depth_ros.cli.networks import networks
from radcam_depth_ros.cli.terminal import bench_tables, inspect_tables
from radcam_depth_ros.cli.terminal.evaluation_tables import print_facts_and_tables as print_evaluation
from radcam_depth_ros.inspection.report import (
    CameraFacts,
    CloudFacts,
    ExtrinsicFacts,
    Finding,
    ImageFacts,
    OffsetFacts,
    Report,
    TopicFacts,
)
from radcam_depth_ros.reporting.table import Fact, Table
from radcam_depth_ros.reporting.terminal import print_table

WIDTH = 80
LINES = re.compile(r"[\u2500-\u257f]")
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
IMAGE, INFO = "/sensing/camera/front_left_wide/image_rect_color/compressed", "/sensing/camera/front_left/camera_info"
RADARS = ("/sensing/radar/front_center/detections_filtered", "/sensing/radar/front_left/objects_raw")


def check(output: str, values: Iterable[str]) -> str:
    """Refuses a line that is too wide, a cell that is cut off and a value that is not there; returns the words."""
    lines = COLOURS.sub("", output).splitlines()
    assert max(map(cell_len, lines)) <= WIDTH
    assert "…" not in output
    words = " ".join(LINES.sub(" ", "\n".join(lines)).split())
    for value in values:
        assert " ".join(value.split()) in words
    return words


@pytest.fixture(params=["a pipe", "a terminal"])
def printed(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[], str]:
    """What was printed, to a pipe or to a terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    if request.param == "a terminal":
        monkeypatch.setenv("FORCE_COLOR", "1")
        monkeypatch.setenv("TERM", "xterm-256color")
    return lambda: capsys.readouterr().out


def cells(count: int) -> st.SearchStrategy[list[str]]:
    word = st.text("abc[/]0 9.-ü", min_size=1, max_size=30).map(lambda text: " ".join(text.split()) or "x")
    return st.lists(word, min_size=count, max_size=count)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 12).flatmap(lambda count: st.tuples(cells(count), st.lists(cells(count), max_size=8))))
def test_any_table_fits(table: tuple[list[str], list[list[str]]]) -> None:
    columns, rows = table
    console = Console(file=io.StringIO(), width=WIDTH)
    print_table(console, "a title", columns, rows, "a note")
    assert isinstance(console.file, io.StringIO)
    words = check(console.file.getvalue(), [cell for row in rows for cell in row])
    assert words.startswith("a title")
    assert words.endswith("a note")


@pytest.mark.parametrize(
    ("columns", "rows", "first"),
    [
        (("name", "mae"), [("dense", "1")], "┏"),
        (("placed", *(f"column {index}" for index in range(6))), [("turned " * 2, *"123456")], "placed"),
        (("image", *(f"a long heading {index}" for index in range(9))), [("448 x 800", *"123456789")], "┏"),
        (("topic", *(f"a long heading {index}" for index in range(9))), [("/a" * 35, *"123456789")], "/a/a"),
    ],
)
def test_the_first_form_that_fits_is_taken(columns: Sequence[str], rows: Sequence[Sequence[str]], first: str) -> None:
    console = Console(file=io.StringIO(), width=WIDTH)
    print_table(console, "title", columns, rows)
    assert isinstance(console.file, io.StringIO)
    output = console.file.getvalue()
    check(output, [*columns[1:], *rows[0]])
    assert output.splitlines()[1].startswith(first)


def test_inspect(printed: Callable[[], str]) -> None:
    topics = (
        TopicFacts(
            IMAGE, "sensor_msgs/msg/CompressedImage", 12345, 29.97, "camera", 13.57, 2.468, 0, 151.6, ("cam_f",), True
        ),
        TopicFacts(
            RADARS[0], "sensor_msgs/msg/PointCloud2", 678, 13.1, "radar", 1.5, 0.25, 0, 77.7, ("radar_1",), False, False
        ),
        TopicFacts("/clock", "rosgraph_msgs/msg/Clock", 9),
    )
    clouds = (CloudFacts(RADARS[0], tuple(f"field_{n}" for n in range(30)), ("x", "y", "z"), "rcs", ("v",), (1, 2, 3)),)
    report = Report(
        "/recordings/2026-05-01/town/drive_with_a_long_name_0001.mcap",
        61.25,
        topics,
        (ImageFacts(IMAGE, "jpeg compressed bgr8", 2048, 618),),
        (CameraFacts(INFO, 2048, 618, 1260.5, "rational_polynomial", (0.1236, -0.00123, 1e-5, 2e-5, 0.25), True),),
        clouds,
        ("odom", "  base_link"),
        tuple(ExtrinsicFacts(radar, "radar", "camera", (-0.25, 0.68, 1.66), 45.5) for radar in RADARS),
        tuple(OffsetFacts(radar, -1.619, 34.453, 0.5, 12.25) for radar in RADARS),
        "",
        (Finding("warning", "expected a clock, " + "got another, " * 12),),
        None,
    )
    inspect_tables.print_report(report)
    words = check(printed(), [topic.topic for topic in topics])
    for value in ("CompressedImage (latched)", "12345", "29.97", "13.57", "2.468", "151.6", "cam_f", "best effort"):
        assert value in words
    for value in (*clouds[0].fields, "0.1236", "1260.5 px", "-0.25, 0.68, 1.66", "-1.619", "34.453", "12.25", *RADARS):
        assert value in words
    for column in ("type", "taken for", "hz", "jitter ms", "gap s", "after ms", "frame", "looks right deg", "p95 ms"):
        assert column in words


def bench_report() -> BenchReport:
    sizes = (Size(448, 800, 60), Size(1248, 2048, 100_000), Size(320, 1024, 60))
    stages = tuple(
        SectionFigures(f"stage {n} of the network", 1234.0 + n, 2345.0 + n, 345.6, 0.97, 456.7) for n in (1, 2, 3)
    )
    whole = SectionFigures("whole", 12345.0, 23456.0, 3456.7, 0.5, 4567.8)
    pairs = tuple(
        PairFigures(SideFigures(size, 54321.0, 1.0, 4567.0), SideFigures(size, 65432.0, 1.0, 5678.0), (1.25, 1.5), 1.75)
        for size in sizes
    )
    described = Description("baff", "shipped", "bfloat16", "frozen", "bfloat16 (of a table)", 2, "0" * 64)
    return BenchReport(
        Machine("a processor with a long name @ 3.00GHz", "", 128, ("avx2", "avx512f", "avx512_vnni", "avx512_bf16")),
        {"bfloat16": {CONVOLUTION: 439.0, MATRIX_PRODUCT: 612.0}},
        described,
        tuple(SizeFigures(size, 30, whole, stages) for size in sizes),
        AgainstFigures("precision=float32,mode=eager", described, pairs),
    )


def test_bench(printed: Callable[[], str]) -> None:
    bench_tables.print_report(bench_report())
    values = ("stage 3 of the network", "1235", "2348", "346", "97 %", "457", "1248 x 2048", "100000", "12345", "23456")
    words = check(printed(), (*values, "3457", "50 %", "4568", "54321", "65432", "1.38", "1.27", "1.48", "5678"))
    for column in (*bench_tables.COLUMNS, "frames/s", "points", "other points", "other median ms", "ratio p90"):
        assert column in words


def test_evaluate(printed: Callable[[], str]) -> None:
    names = ("dense", "semi-dense", "geometry alone", "camera alone", "radar alone")
    columns = ("", *(f"{title} {within}" for title in ("MAE", "RMSE") for within in (50, 70, 80)))
    errors = Table("Error", columns, tuple((name, *(f"{n}23.45" for n in range(6))) for name in names), "A note. " * 30)
    measures = ("MAE m", "RMSE m", "AbsRel", "log10", "RMSElog", "d1", "d2", "d3", "frames", "MAE m, camera alone")
    bags = tuple((f"/recordings/drive_{n:04d}", *(f"{n}.{m}45" for m in range(10))) for n in range(4))
    groups = Table("By bag", ("", *measures), bags)
    print_evaluation([Fact("drives", "[town] " + "a_drive, " * 30)], (errors, groups))
    words = check(printed(), [cell for table in (errors, groups) for row in table.rows for cell in row])
    for column in (*columns, *measures, "[town]"):
        assert column in words


def test_check_calibration(printed: Callable[[], str]) -> None:
    fit = Fit("turned by 2 degrees to the right", 0.96, 0.97, 0.81, 0.64, 0.54, 0.02)
    sensor = SensorReport(RADARS[0], "OK", "a sentence", 12, 345, fit, (fit, fit))
    _print_places(Console(), sensor)
    check(printed(), ("score", "view", "road", "lidar", "doppler", "sweeps", fit.name, *["0.96", "0.97", "0.64"]))


def test_networks(printed: Callable[[], str]) -> None:
    networks()
    check(printed(), ("baff", "lircdepth", "parameters: 5.18 M", "its weights were trained on: simulated drives"))
