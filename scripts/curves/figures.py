"""The figures. All are as wide as a page of print (7 inches), with type of 8 points or more.

Every label has a colour, a dash pattern and a marker of its own, so that lines can be told apart by colour-blind
readers and in print without colours.
"""

import os
import textwrap
from pathlib import Path

# A matplotlibrc of the working directory or of the user, and MPLBACKEND, would change every figure, or end the script
# where they can't be read. Nobody asked for that here: the first one that is found is the empty one of this folder.
os.environ.pop("MPLBACKEND", None)
started_in = os.open(".", os.O_RDONLY)
os.chdir(Path(__file__).resolve().parent)
import matplotlib

os.fchdir(started_in)
os.close(started_in)
matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

from .data import AGGREGATES, Estimate, short

WIDTH = 7.0
DPI = 200
# Inches of a line of text of 8 points, and how many of its characters fit in one inch.
LINE_HEIGHT, CHARACTERS_PER_INCH = 0.145, 17
# Ticks stand at these numbers and their tenfolds.
ROUND = [1, 2, 5, 10]
# Curves of fewer seeds than this have no band: an interval of so few is wider than any panel. The seeds themselves are drawn.
BAND_SEEDS = 5
# More notes than this stand in the table only.
MOST_NOTES = 10

plt.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "font.size": 8,
        "axes.titlesize": 9,
        "axes.titlepad": 4,
        "axes.labelsize": 8,
        "legend.fontsize": 8,
        "xtick.labelsize": 8,
        "ytick.labelsize": 8,
        "axes.linewidth": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.alpha": 0.25,
        "grid.linewidth": 0.5,
        # Names of folders are no mathematics, whatever dollars are in them.
        "text.parse_math": False,
        # Text that stays text: it can be searched, and the files are small.
        "svg.fonttype": "none",
        # Names of clipping paths: the same figure gives the same bytes.
        "svg.hashsalt": "mamf",
    }
)

# Okabe and Ito's colours, and dashes and markers; a label keeps its own in every figure. The ablations share the
# colours of methods they are not drawn beside.
SOLID, DASHED, DOTTED, DASH_DOT = "-", (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (5, 1.4, 1.2, 1.4))
LONG, DOUBLE_DOT = (0, (9, 2)), (0, (5, 1.3, 1.2, 1.3, 1.2, 1.3))
STYLES = {
    "mamf": ("#0072B2", SOLID, "o"),
    "td3": ("#D55E00", DASHED, "s"),
    "mve-td3": ("#CC79A7", DASH_DOT, "^"),
    "ma-td3": ("#56B4E9", DOTTED, "D"),
    "mamf-sac": ("#E69F00", LONG, "v"),
    "sac": ("#009E73", DOUBLE_DOT, "P"),
    "ddpg": ("#999999", DASHED, "X"),
    "td3-critic2": ("#000000", DASH_DOT, "<"),
    "no-optimism": ("#009E73", DASHED, "^"),
    "no-noise-decay": ("#CC79A7", DASH_DOT, "D"),
    "no-target-filter": ("#56B4E9", DOUBLE_DOT, "v"),
    "no-uncertainty-filter": ("#E69F00", DOTTED, "P"),
}
PALETTE = ["#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#0072B2", "#D55E00", "#999999"]
DASHES = [DASHED, DASH_DOT, DOTTED, LONG, DOUBLE_DOT, SOLID]
MARKERS = ["o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*"]


def ordered(labels):
    """Known labels first, in the order of STYLES, then others by name."""
    known = [label for label in STYLES if label in labels]
    return known + sorted(set(labels) - set(known))


def styles_of(labels):
    """`{label: (colour, dashes, marker)}`; unknown labels get what the known ones leave over."""
    styles = {label: STYLES[label] for label in labels if label in STYLES}
    free = [colour for colour in PALETTE if colour not in [style[0] for style in styles.values()]] or PALETTE
    for number, label in enumerate([label for label in labels if label not in STYLES]):
        taken = [style[2] for style in styles.values()]
        left = [marker for marker in MARKERS if marker not in taken] or MARKERS
        styles[label] = (free[number % len(free)], DASHES[number % len(DASHES)], left[number % len(left)])
    return styles


def plain(text):
    """A name as it can be drawn: on one line, and of characters that SVG knows."""
    return "".join(character if character.isprintable() else "�" for character in text)


def tick(value, _position):
    return short(round(value, 10)).replace("-", "−")


def format_axis(axis, ticks):
    for side, count in ((axis.xaxis, ticks[0]), (axis.yaxis, ticks[1])):
        side.set_major_locator(MaxNLocator(count, steps=ROUND))
        side.set_major_formatter(FuncFormatter(tick))


def has_band(line):
    return line.seeds >= BAND_SEEDS


def draw_curve(axis, line, style, order, heavy):
    """A learning curve: its line with a band, or with a thin line for each of few seeds."""
    if has_band(line):
        draw_line(axis, line.steps, line.estimate, style, order, heavy)
        return
    if line.seeds > 1:
        for run in line.runs:
            axis.plot(line.steps, run, color=style[0], linewidth=0.6, alpha=0.45, zorder=1.5)
    draw_line(axis, line.steps, Estimate(line.estimate.value), style, order, heavy)


def draw_line(axis, x, estimate, style, order, heavy=False, marks=7):
    """A line with its band; `order` is its number among the lines, by which markers are kept apart."""
    colour, dashes, marker = style
    if estimate.low is not None:
        axis.fill_between(x, estimate.low, estimate.high, color=colour, alpha=0.17, linewidth=0, zorder=1.5)
    every = max(1, len(x) // marks)
    axis.plot(
        x,
        estimate.value,
        color=colour,
        linestyle=dashes,
        linewidth=2.2 if heavy else 1.2,
        marker=marker,
        markersize=4.2 if heavy else 3.4,
        markeredgewidth=0,
        markevery=(order % every, every),
        zorder=3 if heavy else 2,
    )


def handle(label, style, seeds, heavy=False):
    """An entry of the legend: label and numbers of seeds, `seeds` holding that of each panel."""
    colour, dashes, marker = style
    few, many = min(seeds), max(seeds)
    if few == many:
        text = "1 seed" if many == 1 else f"{many} seeds"
    else:
        text = f"{few} to {many} seeds"
    width, size = (2.2, 4.2) if heavy else (1.2, 3.6)
    return Line2D(
        [],
        [],
        color=colour,
        linestyle=dashes,
        linewidth=width,
        marker=marker,
        markersize=size,
        markeredgewidth=0,
        label=f"{plain(label)} ({text})",
    )


def grid_of(count):
    """Columns of a figure of so many panels, and inches of a panel's height."""
    columns = {1: 1, 2: 2, 3: 3, 4: 2}.get(count, 3 if count <= 6 else 4)
    return columns, {1: 3.2, 2: 2.4}.get(columns, 1.75)


def begin(count, columns, height):
    """A figure of `count` panels of that height in inches; returns it and the axes."""
    rows = -(-count // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(WIDTH, rows * height), squeeze=False, layout="constrained", dpi=DPI
    )
    figure.get_layout_engine().set(w_pad=0.04, h_pad=0.05)
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    return figure, list(axes.flat[:count])


def finish(figure, handles, notes):
    """Adds a legend and notes below the panels, the figure growing by what they need."""
    renderer = figure.canvas.get_renderer()
    panels = figure.get_figheight()
    lines = [line for note in shown(notes) for line in wrap(note)]
    below = len(lines) * LINE_HEIGHT + 0.06
    legend, legend_height = None, 0.0
    for columns in range(min(len(handles), 6), 0, -1):
        # Numbers stand in for the labels at first: one that begins with an underscore would be left out.
        legend = figure.legend(
            handles,
            [str(number) for number in range(len(handles))],
            loc="lower center",
            ncols=columns,
            frameon=False,
            handlelength=3.4,
            columnspacing=1.4,
        )
        for entry, of in zip(legend.get_texts(), handles, strict=True):
            entry.set_text(of.get_label())
        extent = legend.get_window_extent(renderer)
        legend_height = extent.height / DPI
        if extent.width <= WIDTH * DPI or columns == 1:
            break
        legend.remove()
    height = panels + legend_height + below
    figure.set_figheight(height)
    if legend:
        legend.set_bbox_to_anchor((0.5, below / height), transform=figure.transFigure)
    if lines:
        figure.text(0.01, 0.05 / height, "\n".join(lines), va="bottom", linespacing=1.25, color="#333333")
    bottom = (legend_height + below) / height
    figure.get_layout_engine().set(rect=(0, bottom, 1, 1 - bottom))
    # Arranged once, so that one format of a file does not depend on which other is written before it.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def shown(notes):
    if len(notes) <= MOST_NOTES:
        return notes
    return notes[: MOST_NOTES - 1] + [f"and {len(notes) - MOST_NOTES + 1} more notes, see table.md"]


def wrap(note):
    return textwrap.wrap(plain(note), int((WIDTH - 0.15) * CHARACTERS_PER_INCH), subsequent_indent="   ")


def panel_title(text, columns):
    """The title of a panel, on two lines where it would not fit on one."""
    room = int(WIDTH / columns * 11.5)
    return text if len(text) <= room else text.replace(" (", "\n(", 1).replace(", period", "\nperiod", 1)


def curves(panels, labels, what, notes, ranges, full=None):
    """One panel a task, one line a label; `ranges` is `{title: (low, high)}` of panels that do not show all.

    With `full`, an ablation: panels are lettered, and that label is drawn heavier than its variants.
    """
    columns, height = grid_of(len(panels))
    if full:
        height = max(height, 2.2)
    figure, axes = begin(len(panels), columns, height)
    styles = styles_of(labels)
    for number, (axis, panel) in enumerate(zip(axes, panels, strict=True)):
        for order, label in enumerate(label for label in labels if label in panel.lines):
            draw_curve(axis, panel.lines[label], styles[label], order, label == full)
        letter = f"({chr(ord('a') + number)}) " if full and len(panels) > 1 else ""
        axis.set_title(panel_title(letter + plain(panel.title), columns), fontsize=9 if columns < 4 else 8)
        format_axis(axis, ({1: 8, 2: 6}.get(columns, 4), 5))
        axis.margins(x=0.02)
        if panel.title in ranges:
            axis.set_ylim(ranges[panel.title])
        if number % columns == 0:
            axis.set_ylabel(what)
        if number + columns >= len(panels):
            axis.set_xlabel("environment steps")
    handles = []
    for label in labels:
        seeds = [panel.lines[label].seeds for panel in panels if label in panel.lines]
        handles.append(handle(label, styles[label], seeds, label == full))
    return finish(figure, handles, notes)


def aggregate(estimates, labels, runs, notes, limits=None):
    """A panel an aggregate metric, a row a label: a mark with its interval. `runs` is `{label: runs a task}`, `limits` the range of scores
    that is drawn."""
    styles = styles_of(labels)
    figure, axes = begin(len(AGGREGATES), len(AGGREGATES), 0.75 + 0.23 * len(labels))
    for number, (axis, name) in enumerate(zip(axes, AGGREGATES, strict=True)):
        for row, label in enumerate(labels):
            draw_interval(axis, row, estimates[label], number, styles[label])
        better = "lower" if name == "optimality gap" else "higher"
        axis.set_title(f"{name}\n({better} is better)")
        names = [f"{plain(label)} ({seeds(runs[label])})" for label in labels]
        format_rows(axis, names if number == 0 else [""] * len(labels))
        axis.xaxis.set_major_locator(MaxNLocator(3, steps=ROUND))
        axis.xaxis.set_major_formatter(FuncFormatter(tick))
        axis.set_xlabel("normalised score")
        # Bars would end at the edge.
        axis.use_sticky_edges = False
        axis.margins(x=0.12)
        if limits:
            low, high = limits
            # The gap is how far scores stay below 1.
            low, high = (0, 1 - low) if name == "optimality gap" else (low, high)
            axis.set_xlim(low, high)
            for row, value in enumerate(estimates[label].value[number] for label in labels):
                if not low <= value <= high:
                    point_beyond(axis, row, value, value < low)
    return finish(figure, [], notes)


def seeds(count):
    return "1 seed: no interval" if count == 1 else f"{count} seeds"


def draw_interval(axis, row, estimate, number, style):
    """A mark at the `number`-th value of an estimate, over a bar from low to high."""
    colour, _, marker = style
    if estimate.low is not None:
        low, high = estimate.low[number], estimate.high[number]
        axis.barh(row, high - low, left=low, height=0.55, color=colour, alpha=0.35, linewidth=0)
    axis.plot(estimate.value[number], row, marker=marker, color=colour, markersize=5, markeredgewidth=0)
    axis.plot([estimate.value[number]] * 2, [row - 0.275, row + 0.275], color="black", linewidth=0.9)


def point_beyond(axis, row, value, is_below):
    """Says at the edge where a mark would be that is beyond it."""
    edge, side = (0.03, "left") if is_below else (0.97, "right")
    text = f"← {value:.2g}" if is_below else f"{value:.2g} →"
    axis.text(edge, row, text, transform=axis.get_yaxis_transform(), ha=side, va="center", fontsize=8)


def format_rows(axis, names):
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.set_yticks(range(len(names)), names)
    axis.tick_params(axis="y", length=0)
    axis.grid(visible=False, axis="y")


def improvement(estimates, labels, notes):
    """A row a pair: the probability that a run of the one is better than a run of the other."""
    styles = styles_of(labels)
    figure, [axis] = begin(1, 1, 0.6 + 0.23 * len(estimates))
    for row, ((x, _), estimate) in enumerate(estimates.items()):
        draw_interval(axis, row, estimate, 0, styles[x])
    axis.axvline(0.5, color="black", linewidth=0.8, linestyle=DASHED, zorder=1)
    format_rows(axis, [f"{plain(x)} over {plain(y)}" for x, y in estimates])
    axis.set_xlim(-0.02, 1.02)
    axis.set_xlabel(
        "probability of improvement: that a run of the first method scores higher than one of the second"
    )
    return finish(figure, [], notes)


def profile(thresholds, estimates, labels, runs, notes):
    """A line a label: the fraction of runs whose normalised score is above a threshold."""
    names = "normalised score τ", "fraction of runs above τ"
    return lines_on_one_axis(thresholds, estimates, labels, runs, notes, *names)


def efficiency(steps, estimates, labels, runs, notes, limits=None):
    """A line a label: the IQM of normalised scores along the steps, between `limits`."""
    names = "environment steps", "IQM of normalised scores"
    return lines_on_one_axis(steps, estimates, labels, runs, notes, *names, limits)


def lines_on_one_axis(x, estimates, labels, runs, notes, across, up, limits=None):
    styles = styles_of(labels)
    figure, [axis] = begin(1, 1, 3.0)
    for order, label in enumerate(labels):
        draw_line(axis, np.asarray(x), estimates[label], styles[label], 2 * order, marks=9)
    format_axis(axis, (8, 6))
    axis.margins(x=0.02)
    axis.set_xlabel(across)
    axis.set_ylabel(up)
    if limits:
        axis.set_ylim(limits)
    return finish(figure, [handle(label, styles[label], [runs[label]]) for label in labels], notes)


def save(figure, path, kind):
    """Writes a figure without the date, so that it is the same whenever it is made."""
    metadata = {"svg": {"Date": None}, "png": {"Software": None}}[kind]
    figure.savefig(path, format=kind, dpi=DPI, metadata=metadata)
