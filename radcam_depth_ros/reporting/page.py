"""One self-contained HTML page: facts, tables, curves and pictures. Nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from radcam_depth_ros.files import write_text
from radcam_depth_ros.messages import colorise
from radcam_depth_ros.printable import printable
from radcam_depth_ros.reporting.panel import Panel, Tile, draw_panel
from radcam_depth_ros.reporting.pictures import DEPTH_TICKS_M, ERROR_M, FAR_M, NEAR_M, colour_error, encode, scale_share
from radcam_depth_ros.reporting.plot import Plot, draw_plot
from radcam_depth_ros.reporting.table import Fact, Table

_ERROR_TICKS_M = (-10, -5, 0, 5, 10)
_STYLE = """
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5c636b; --paper: #fbfbfa; --line: #d9dcdf; --tint: #f1f2f3; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e6e8; --soft: #9aa2ab; --paper: #17191b; --line: #33383d; --tint: #202326; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1560px; padding: 2rem 2rem 4rem; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.6rem; font-weight: 600; margin: 0 0 1.2rem; }
h2 { font-size: 1.1rem; font-weight: 600; margin: 2.4rem 0 .7rem; }
dl { display: grid; grid-template-columns: repeat(auto-fill, minmax(16rem, 1fr)); gap: .8rem 2rem; margin: 0; }
dt { color: var(--soft); font-size: .85rem; }
dd { margin: 0; overflow-wrap: anywhere; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .9rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
thead th { color: var(--soft); font-weight: 500; font-size: .85rem; }
p { color: var(--soft); font-size: .85rem; max-width: 60rem; margin: .5rem 0 0; }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 26rem), 1fr)); gap: 1.2rem 1rem; }
figure { margin: 0; }
img { display: block; width: 100%; height: auto; background: #222; border-radius: 3px; }
figcaption { font-size: .85rem; margin-bottom: .25rem; }
.scale { display: block; height: .5rem; margin-top: .35rem; border-radius: 2px; background-size: 100% 100%; }
.ticks { position: relative; height: 1.2rem; font-size: .75rem; color: var(--soft); }
.ticks span { position: absolute; transform: translateX(-50%); white-space: nowrap; }
.ticks span:first-child { transform: none; }
.ticks span:last-child { transform: translateX(-100%); }
"""


def write_report(
    path: Path | str,
    title: str,
    facts: Sequence[Fact] = (),
    tables: Sequence[Table] = (),
    panels: Sequence[Panel] = (),
    plots: Sequence[Plot] = (),
) -> None:
    """Writes the page, under a temporary name that is then renamed.

    Args:
        path: The HTML file.
        title: Its heading.
        facts: Names and values at the top.
        tables: Tables, in order.
        panels: Frames to show, in order.
        plots: Curves to show, in order.

    Raises:
        ReportError: when the file cannot be written.
    """
    sections = [
        _facts(facts),
        *(_table(table) for table in tables),
        _plots(plots),
        *(_panel(panel) for panel in panels),
    ]
    body = "\n".join(section for section in sections if section)
    write_text(
        path,
        f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{_escaped(title)}</title>
<style>{_STYLE}{_scale_style()}</style>
</head>
<body>
<h1>{_escaped(title)}</h1>
{body}
</body>
</html>
""",
    )


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _facts(facts: Sequence[Fact]) -> str:
    lines = (f"<div><dt>{_escaped(fact.name)}</dt><dd>{_escaped(fact.value)}</dd></div>" for fact in facts)
    return f"<dl>{''.join(lines)}</dl>" if facts else ""


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{_escaped(column)}</th>' for column in table.columns)
    rows = "\n".join(f"<tr>{''.join(f'<td>{_escaped(cell)}</td>' for cell in row)}</tr>" for row in table.rows)
    note = f"\n<p>{_escaped(table.note)}</p>" if table.note else ""
    return f"""<section><h2>{_escaped(table.title)}</h2>
<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>
{rows}
</tbody></table></div>{note}</section>"""


def _plots(plots: Sequence[Plot]) -> str:
    figures = "\n".join(_drawing(plot) for plot in plots)
    return f'<section><h2>Curves</h2>\n<div class="tiles">\n{figures}\n</div></section>' if plots else ""


def _drawing(plot: Plot) -> str:
    note = f"<p>{_escaped(plot.note)}</p>" if plot.note else ""
    return _captioned(plot.title, _data_uri("svg+xml", draw_plot(plot)), note)


def _panel(panel: Panel) -> str:
    figures = "\n".join(_figure(tile, is_photo=index == 0) for index, tile in enumerate(draw_panel(panel)))
    return f'<section><h2>{_escaped(panel.title)}</h2>\n<div class="tiles">\n{figures}\n</div></section>'


def _figure(tile: Tile, is_photo: bool) -> str:
    # Photographs are ten times as large as PNG; flat colours are not, and must stay what the scale says.
    source = _data_uri(*(("jpeg", encode(tile.image, ".jpg")) if is_photo else ("png", encode(tile.image))))
    ticks = _depth_ticks() if tile.scale == "depth" else _error_ticks()
    return _captioned(tile.title, source, f'<span class="scale {tile.scale}"></span><div class="ticks">{ticks}</div>')


def _captioned(title: str, source: str, below: str) -> str:
    name = _escaped(title)
    return f'<figure><figcaption>{name}</figcaption><img alt="{name}" src="{source}">{below}</figure>'


def _depth_ticks() -> str:
    return _ticks(map(scale_share, DEPTH_TICKS_M), [f"{tick} m" for tick in DEPTH_TICKS_M])


def _error_ticks() -> str:
    labels = [f"{tick:+d} m" if tick else "0" for tick in _ERROR_TICKS_M]
    labels[0], labels[-1] = f"{labels[0]}, too near", f"{labels[-1]}, too far"
    return _ticks(((tick / ERROR_M + 1) / 2 for tick in _ERROR_TICKS_M), labels)


def _ticks(places: Iterable[float], labels: Sequence[str]) -> str:
    return "".join(
        f'<span style="left:{100 * place:.1f}%">{label}</span>' for place, label in zip(places, labels, strict=True)
    )


def _scale_style() -> str:
    """The two colour scales, drawn by what colours the pictures; once in the page."""
    ramp = np.linspace(0, 1, 256, dtype=np.float32)[None, :]
    depth = colorise((NEAR_M * (FAR_M / NEAR_M) ** ramp).astype(np.float32), NEAR_M, FAR_M)
    error = colour_error((ramp * 2 - 1) * np.float32(ERROR_M))
    return "".join(
        f".scale.{name} {{ background-image: url({_data_uri('png', encode(image))}); }}\n"
        for name, image in (("depth", depth), ("error", error))
    )


def _escaped(text: str) -> str:
    return html.escape(printable(text))
