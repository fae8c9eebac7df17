"""report.html: the tables' page, with one plot for each knob where matplotlib is installed."""

from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from io import StringIO
from textwrap import wrap
from typing import IO, Any

from gstream.report import words
from gstream.report.knobs import UNITS, shown
from gstream.report.results import Report, Series
from gstream.report.words import cells, price

MISSING = "Plots need matplotlib: pip install 'gstream[report]'"
COSTS = words.COSTS | {"seconds": "CPU seconds, median"}
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
    body += [f"<p>{escape(paragraph)}</p>" for paragraph in words.legend(report)]
    for knob in report.plan.knobs:
        series = [s for s in report.series if s.knob.name == knob.name]
        if not series:
            continue
        body.append(f"<h2>{escape(knob.title)}</h2>")
        body += [f"<p><b>{s.scene}</b>: {escape(price(s))}</p>" for s in series]
        if plots:
            body.append(_svg(series))
        body += [_table(s) for s in series]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>What accuracy costs</title>'
        f"<style>{STYLE}</style>{''.join(body)}</html>\n"
    )


def plot(series: Sequence[Series], file: IO[Any], form: str) -> None:
    """Draw one knob: its error over each of its costs, a colour for each scene.

    The Pareto front is joined by a line, its points filled; the default is circled. A faint bar
    spans the seconds of all processes.
    form : what matplotlib can write: svg, png
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator

    knob = series[0].knob
    with rc_context({"svg.hashsalt": knob.name, "font.size": 9}):
        figure = Figure(figsize=(5 * len(knob.costs), 3.8), layout="constrained")
        panels = figure.subplots(1, len(knob.costs), squeeze=False)[0]
        for axes, cost in zip(panels, knob.costs, strict=True):
            for number, one in enumerate(series):
                _draw(axes, one, cost, f"C{number}")
            axes.set_xlabel(COSTS[cost])
            if all(point.cost(cost) > 0 for one in series for point in one.points):
                axes.set_xscale("log")
            _scale_errors(axes, [p.error(knob) for s in series for p in s.points])
            axes.grid(visible=True, which="both", color="0.92")
            axes.set_axisbelow(True)
            axes.margins(0.2)
            plain = FuncFormatter(lambda value, _: f"{value:g}")
            for axis, shape in (
                (axes.xaxis, plain if cost == "seconds" else EngFormatter(sep="")),
                (axes.yaxis, plain),
            ):
                axis.set_major_formatter(shape)
                if axis.get_scale() == "log":
                    axis.set_minor_locator(LogLocator(subs=(2, 5)))
                    axis.set_minor_formatter(shape)
            axes.plot([], [], "o", color="black", markerfacecolor="none", label="default, circled")
        said = UNITS.get(knob.error, f"{knob.same} that differ")
        panels[0].set_ylabel("\n".join(wrap(said, 44)))
        panels[-1].legend(fontsize=8)
        figure.savefig(file, format=form)


def _svg(series: Sequence[Series]) -> str:
    text = StringIO()
    plot(series, text, "svg")
    _, tag, rest = text.getvalue().partition("<svg")  # HTML takes no XML declaration
    return tag + rest


def _draw(axes: Any, series: Series, cost: str, colour: str) -> None:
    knob = series.knob
    for number, point in enumerate(series.points):
        at = point.cost(cost), point.error(knob)
        filled = point in series.front(cost)
        if cost == "seconds":
            spread = min(point.all_seconds), max(point.all_seconds)
            axes.plot(spread, (at[1], at[1]), color=colour, alpha=0.3, linewidth=4)
        axes.plot(*at, "o", color=colour, markerfacecolor=colour if filled else "white")
        if point.default:
            axes.plot(*at, "o", color="black", markersize=13, markerfacecolor="none")
        offset = {"xytext": (0, -17 if number % 2 else 9), "textcoords": "offset points"}
        axes.annotate(shown(knob, point.value), at, ha="center", fontsize=8, **offset)
    front = [(p.cost(cost), p.error(knob)) for p in series.front(cost)]
    x, y = zip(*front, strict=True)
    axes.plot(x, y, color=colour, linewidth=1.2, label=f"{series.scene}: Pareto front")
    axes.plot([], [], "o", color=colour, markerfacecolor="white", label=f"{series.scene}: beaten")


def _scale_errors(axes: Any, errors: Sequence[float]) -> None:
    """Logarithmic, with a linear part below the least error where some are 0."""
    some = [error for error in errors if error > 0]
    if len(some) == len(errors):
        axes.set_yscale("log")
    elif some and max(some) > 10 * min(some):
        axes.set_yscale("symlog", linthresh=min(some))


def _table(series: Series) -> str:
    head, *rows = cells(series)
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><tr>{titles}</tr>{body}</table>"
