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
from radcam_depth_ros.reporting.panel import Highlight, Panel, Tile, draw_panel
from radcam_depth_ros.reporting.pictures import DEPTH_TICKS_M, ERROR_M, FAR_M, NEAR_M, colour_error, encode, scale_share
from radcam_depth_ros.reporting.plot import Plot, draw_plot
from radcam_depth_ros.reporting.table import Fact, Table

_ERROR_TICKS_M = (-10, -5, 0, 5, 10)
_HIGHLIGHTED = ("camera and radar", "dense depth", "error of the dense depth")
"""Pictures of a frame at the top of the page."""
_STYLE = """
:root { color-scheme: light dark; --ink: #1c1e21; --soft: #5c636b; --paper: #fbfbfa; --line: #d9dcdf; --tint: #f1f2f3; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e6e8; --soft: #9aa2ab; --paper: #17191b; --line: #33383d; --tint: #202326; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1560px; padding: 2rem 2rem 4rem; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.6rem; font-weight: 600; margin: 0; overflow-wrap: anywhere; }
header { display: flex; flex-wrap: wrap; gap: .4rem 2rem; align-items: baseline; margin: 0 0 1rem; }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; }
nav a { color: inherit; }
:focus-visible { outline: 3px solid #3b82f6; outline-offset: 2px; }
[id] { scroll-margin-top: 1rem; margin-top: 2rem; }
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
.first { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)); gap: 1rem; }
.first h2 { margin: 0; }
.first p { margin: 0 0 .5rem; }
.row { display: grid; gap: .5rem; }
.scales { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 20rem), 1fr)); gap: 0 3rem; }
.scales figure { margin-top: .5rem; }
@media (max-width: 900px) {
  body { padding: 1rem 1rem 3rem; }
  h1 { font-size: 1.2rem; }
  .first { grid-template-columns: minmax(0, 1fr); gap: .6rem; }
  .first h2, .first p { display: inline; margin-right: .6rem; font-size: .9rem; }
  .row { grid-template-columns: repeat(3, minmax(0, 1fr)); margin-top: .2rem; }
}
@media (max-width: 560px) {
  .row { grid-template-columns: repeat(2, minmax(0, 1fr)); }
  .row figure:nth-child(3), .scales figure:nth-child(2), .ticks.error span:nth-child(even) { display: none; }
}
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
    highlights: Sequence[Highlight] = (),
) -> None:
    """Writes the page, under a temporary name that is then renamed.

    Args:
        path: The HTML file.
        title: Its heading.
        facts: Names and values at the top.
        tables: Tables, in order.
        panels: Frames to show, in order.
        plots: Curves to show, in order.
        highlights: Frames at the very top, before all figures.

    Raises:
        ReportError: when the file cannot be written.
    """
    parts = {
        "facts": _facts(facts),
        "tables": "\n".join(map(_table, tables)),
        "curves": _plots(plots),
        "frames": "\n".join(map(_panel, panels)),
    }
    shown = {name: part for name, part in parts.items() if part}
    body = "\n".join(f'<div id="{name}">{part}</div>' for name, part in shown.items())
    links = "".join(f'<a href="#{name}">{name}</a>' for name in shown) if len(shown) > 1 else ""
    head = f"<h1>{_escaped(title)}</h1>{f'<nav>{links}</nav>' if links else ''}"
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
<header>{head}</header>
<main>
{_highlights(highlights)}
{body}
</main>
</body>
</html>
""",
    )


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _facts(facts: Sequence[Fact]) -> str:
    lines = (f"<div><dt>{_escaped(fact.name)}</dt><dd>{_escaped(fact.value)}</dd></div>" for fact in facts)
    return f"<dl>{''.join(lines)}</dl>" if facts else ""


def _highlights(highlights: Sequence[Highlight]) -> str:
    """Frames side by side, or below one another where there is little room, with their scales once."""
    articles = []
    for highlight in highlights:
        tiles = {tile.title: tile for tile in draw_panel(highlight.panel)}
        names = [name for name in _HIGHLIGHTED if name in tiles]
        figures = "".join(
            _captioned(name, _source(tiles[name], is_photo=not index), "") for index, name in enumerate(names)
        )
        articles.append(
            f"<article><h2>{_escaped(highlight.title.capitalize())}</h2><p>{_escaped(highlight.panel.title)}</p>"
            f'<div class="row">{figures}</div></article>'
        )
    if not articles:
        return ""
    scales = "".join(f"<figure>{_scale(name)}</figure>" for name in ("depth", "error"))
    return (
        f'<section class="first" aria-label="Frames">{"".join(articles)}</section>\n<div class="scales">{scales}</div>'
    )


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{_escaped(column)}</th>' for column in table.columns)
    rows = "\n".join(f"<tr>{''.join(f'<td>{_escaped(cell)}</td>' for cell in row)}</tr>" for row in table.rows)
    note = f"\n<p>{_escaped(table.note)}</p>" if table.note else ""
    name = _escaped(table.title)
    return f"""<section><h2>{name}</h2>
<div class="wide" role="region" tabindex="0" aria-label="{name}"><table><thead><tr>{head}</tr></thead><tbody>
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
    return _captioned(tile.title, _source(tile, is_photo), _scale(tile.scale))


def _source(tile: Tile, is_photo: bool) -> str:
    # Photographs are ten times as large as PNG; flat colours are not, and must stay what the scale says.
    return _data_uri(*(("jpeg", encode(tile.image, ".jpg")) if is_photo else ("png", encode(tile.image))))


def _scale(name: str) -> str:
    ticks = _depth_ticks() if name == "depth" else _error_ticks()
    return f'<span class="scale {name}"></span><div class="ticks {name}">{ticks}</div>'


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
