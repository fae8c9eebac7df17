"""report.html: the tables' page, with one plot for each knob where matplotlib is installed."""

from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from io import StringIO
from typing import IO, Any

from gstream.report.accuracy import Report, Series, cost_of
from gstream.report.knobs import UNITS, shown
from gstream.report.words import price

MISSING = "Plots need matplotlib: pip install 'gstream[report]'"
COSTS = {"seconds": "CPU seconds, median", "bytes": "bytes of the file"}
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse } td, th { padding: .2em .8em; text-align: right }
tr + tr { border-top: 1px solid #ddd } svg { max-width: 100%; height: auto }
"""


def html(report: Report) -> str:
    """The whole page, its pictures inside."""
    plots = find_spec("matplotlib") is not None
    body = ["<h1>What accuracy costs</h1>"]
    if not plots:
        body.append(f"<p>{escape(MISSING)}</p>")
    for knob in report.plan.knobs:
        series = [s for s in report.series if s.knob.name == knob.name]
        body.append(f"<h2>{escape(knob.option)}</h2>")
        body += [f"<p><b>{s.scene}</b>: {escape(price(s))}</p>" for s in series]
        if plots:
            body.append(_svg(series))
        body += [_table(s) for s in series]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>What accuracy costs</title>'
        f"<style>{STYLE}</style>{''.join(body)}</html>\n"
    )


def plot(series: Sequence[Series], file: IO[Any], form: str) -> None:
    """Draw one knob: error over seconds and over bytes, a colour for each scene.

    The Pareto front is joined by a line, its points filled; the default is circled.
    form : what matplotlib can write: svg, png
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator

    knob = series[0].knob
    with rc_context({"svg.hashsalt": knob.name, "font.size": 9}):
        figure = Figure(figsize=(10, 3.8), layout="constrained")
        for axes, (cost, label) in zip(figure.subplots(1, 2), COSTS.items(), strict=True):
            for number, one in enumerate(series):
                _draw(axes, one, cost, f"C{number}")
            axes.set_xlabel(label)
            axes.set_xscale("log")
            if knob.error and all(p.error(knob) > 0 for s in series for p in s.points):
                axes.set_yscale("log")
            axes.grid(visible=True, which="both", color="0.92")
            axes.set_axisbelow(True)
            axes.margins(0.2)
            plain = FuncFormatter(lambda value, _: f"{value:g}")
            for axis, shape in (
                (axes.xaxis, EngFormatter(sep="") if cost == "bytes" else plain),
                (axes.yaxis, plain),
            ):
                axis.set_major_formatter(shape)
                if axis.get_scale() == "log":
                    axis.set_minor_locator(LogLocator(subs=(2, 5)))
                    axis.set_minor_formatter(shape)
            axes.plot([], [], "o", color="black", markerfacecolor="none", label="default, circled")
        left, right = figure.axes
        left.set_ylabel(UNITS.get(knob.error, f"{knob.same} that differ"))
        right.legend(fontsize=8)
        figure.savefig(file, format=form)


def _svg(series: Sequence[Series]) -> str:
    text = StringIO()
    plot(series, text, "svg")
    _, tag, rest = text.getvalue().partition("<svg")  # HTML takes no XML declaration
    return tag + rest


def _draw(axes: Any, series: Series, cost: str, colour: str) -> None:
    knob = series.knob
    for point in series.points:
        at = cost_of(point, cost), point.error(knob)
        filled = point in series.front(cost)
        axes.plot(*at, "o", color=colour, markerfacecolor=colour if filled else "white")
        if point.default:
            axes.plot(*at, "o", color="black", markersize=13, markerfacecolor="none")
        offset = {"xytext": (0, 9), "ha": "center", "textcoords": "offset points", "fontsize": 8}
        axes.annotate(shown(knob.field, point.value), at, **offset)
    front = [(cost_of(p, cost), p.error(knob)) for p in series.front(cost)]
    x, y = zip(*front, strict=True)
    axes.plot(x, y, color=colour, linewidth=1.2, label=f"{series.scene}: Pareto front")
    axes.plot([], [], "o", color=colour, markerfacecolor="white", label=f"{series.scene}: beaten")


def _table(series: Series) -> str:
    knob = series.knob
    head = "value", "CPU s", "fragments", "voxels", "bytes", UNITS.get(knob.error, "differing")
    rows = [
        (
            shown(knob.field, p.value) + (" (default)" if p.default else ""),
            f"{p.seconds:.3f}",
            f"{p.counts.fragments:,}",
            f"{p.counts.voxels:,}",
            f"{p.counts.bytes:,}",
            f"{p.error(knob):.4g}",
        )
        for p in series.points
    ]
    cells = ["".join(f"<td>{cell}</td>" for cell in row) for row in rows]
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    return f"<table><tr>{titles}</tr>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"
