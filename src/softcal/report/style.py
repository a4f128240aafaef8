"""Style of charts: a palette for colour-blind readers, sizes, and figures without global state."""

from __future__ import annotations

import io
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.declare import checked_arguments
from softcal.errors import ParameterError, unknown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.text import Text

# Okabe and Ito's colours, distinguishable with any common colour vision; text and lines in dark grey.
INK, MUTED, FAINT = "#1f2937", "#6b7280", "#c4c9d1"
LOOP = "#a3abb8"  # later cycles: lighter than text, darker than the grid
BLUE, ORANGE, GREEN, RED, SKY, PURPLE = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7"
SERIES = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)
MEASURED, SIMULATED = INK, RED
SEQUENTIAL = "viridis"
# An axis is logarithmic if the ratio of its largest to its smallest step is at least this.
UNEVEN = 4.0
DPI = 200  # dots per inch of pictures in files
DISPLACEMENT = "YlGnBu"  # pale at rest, so that the shape itself stays readable

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e5e7eb",
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.6,
    "figure.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "softcal",
    "path.simplify": True,
    "text.parse_math": False,  # names of the user's may contain dollars
}

# Columns of a journal -> their width [in]; Nature's and Elsevier's are 89 and 183 mm.
PAPERS: Mapping[str, float] = {"one column": 89 / 25.4, "two columns": 183 / 25.4}
_IN_PAPER: Any = {"font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "legend.fontsize": 7.5}
_paper: ContextVar[str] = ContextVar("paper", default="")


@checked_arguments
@contextmanager
def paper_style(columns: str) -> Generator[None]:
    """The style of figures in a paper, as a context: what is drawn within it, by `plot` or else, has a column's width.

    Parameters
    ----------
    columns
        "one column" of 89 mm, or "two columns" of 183 mm. Texts have 7.5 points or more.

    Raises
    ------
    ParameterError
        For another style.
    """
    import matplotlib as mpl

    if columns not in PAPERS:
        raise ParameterError(unknown("there is no such style", "paper_style", columns, PAPERS))
    before, width = _paper.set(columns), PAPERS[columns]
    try:
        with mpl.rc_context({**_STYLE, **_IN_PAPER, "figure.figsize": (width, 0.7 * min(width, PAPERS["one column"]))}):
            yield
    finally:
        _paper.reset(before)


@contextmanager
def house_style() -> Generator[None]:
    """Context manager: softcal's matplotlib settings, whatever a file of settings in the present folder says."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE | (_IN_PAPER if _paper.get() else {}))
        yield


def new_figure(width: float = 5.2, height: float = 3.6) -> Figure:
    """An empty figure of a size in inches, on the Agg canvas, in no global registry."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**figure_settings(width, height))
    FigureCanvasAgg(figure)
    return figure


def figure_settings(width: float = 5.2, height: float = 3.6) -> dict[str, Any]:
    """Size and layout of a figure of that size [in], or as wide as the column of the paper that it is for."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if column := PAPERS.get(_paper.get()):
        width, height = column, height * min(1.0, column / width)
    return {"figsize": (width, height), "layout": ConstrainedLayoutEngine(w_pad=0.07, h_pad=0.07)}


def encode(figure: Figure, title: str = "") -> tuple[bytes, bytes]:
    """The figure as bytes of a PNG and an SVG file, which has the title, reproducible for the same figure."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    png, svg = as_png(figure), io.BytesIO()
    with house_style():
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, **({"Title": title} if title else {})})
    return png, svg.getvalue()


def as_png(figure: Figure, dpi: float = DPI) -> bytes:
    """The figure as bytes of a PNG file, reproducible for the same figure; its layout is final then."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    buffer = io.BytesIO()
    with house_style():
        engine = figure.get_layout_engine()
        if isinstance(engine, ConstrainedLayoutEngine):
            engine.execute(figure)
        figure.set_layout_engine("none")  # computing it is most of the drawing time
        figure.set_dpi(dpi)
        # By the canvas, since `savefig` draws everything twice.
        FigureCanvasAgg(figure).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def lay_out(axes: Axes) -> None:
    """Lay out the figure of some axes, so that the extents of its texts are known."""
    axes.figure.draw_without_rendering()  # type: ignore[union-attr]


def overlapping(texts: Sequence[Text]) -> bool:
    """Whether any two texts of a figure overlap as drawn."""
    boxes = [text.get_window_extent() for text in texts if text.get_text() and text.get_visible()]
    return any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])


def keep_tick_labels_apart(axes: Axes) -> None:
    """Rotate the labels of the x axis if they overlap."""
    for angle in (0, 35, 90):
        axes.tick_params(axis="x", labelrotation=angle)
        for label in axes.get_xticklabels():
            label.set_horizontalalignment("right" if angle == 35 else "center")
            label.set_rotation_mode("anchor" if angle == 35 else "default")
        lay_out(axes)
        if not overlapping(axes.get_xticklabels()):
            return


def is_uneven(values: Floats) -> bool:
    """Whether values are so unevenly spaced that a logarithmic axis shows them better."""
    steps = np.diff(values)
    return bool(len(values) > 2 and values[0] > 0 and steps.max() > UNEVEN * steps.min() and values[-1] > 5 * values[0])


def plain_log_axis(axes: Axes, low: float, high: float, *, upright: bool = False) -> None:
    """A logarithmic axis whose ticks read 0.1, 1, 10 rather than powers.

    Parameters
    ----------
    axes
        The axes.
    low, high
        Ends of the axis.
    upright
        The y axis in the place of x.
    """
    axes.set(**{"yscale": "log", "ylim": (low, high)} if upright else {"xscale": "log", "xlim": (low, high)})
    plain_log_ticks(axes.yaxis if upright else axes.xaxis, low, high)


def plain_log_ticks(axis: Axis, low: float, high: float) -> None:
    """Ticks of a logarithmic axis that read 0.1, 0.3, 1, and never crowd.

    Parameters
    ----------
    axis
        A logarithmic axis.
    low, high
        Its ends.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    ratio = high / low
    subs = (1.0, 2.0, 3.0, 5.0) if ratio < 30 else (1.0, 3.0) if ratio < 3000 else (1.0,)
    axis.set_major_locator(MaxNLocator(5) if ratio < 3.0 else LogLocator(subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def count_axis(axes: Axes, label: str) -> None:
    """An x axis of numbers of trials or samples: its ticks are whole, however few there are."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel(label)
