"""The numbers of the figures as Markdown tables."""

import math

import numpy as np

from .data import AGGREGATES, ROUND_THRESHOLDS, short

# Parts of the steps at which curves are written down.
PARTS = [0.25, 0.5, 0.75, 1.0]


def number(x):
    """Four significant digits, of large numbers all before the point: 1026, 41.61, -0.5034"""
    if x == 0:
        return "0"
    digits = min(max(3 - math.floor(math.log10(abs(x))), 0), 6)
    text = f"{x:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def cell(estimate, index=None):
    """`value [low, high]`, or the value alone where there is no interval."""
    value, low, high = (
        bound if bound is None or index is None else bound[index]
        for bound in (estimate.value, estimate.low, estimate.high)
    )
    return (
        number(float(value))
        if low is None
        else f"{number(float(value))} [{number(float(low))}, {number(float(high))}]"
    )


def table(header, rows):
    """Markdown lines of a table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    # A folder may have any name.
    cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    return lines + ["| " + " | ".join(row) + " |" for row in cells] + [""]


def section(heading, text, header, rows):
    return [f"## {heading}", "", text, ""] + table(header, rows)


def final_section(panels, labels, metric):
    """Final returns by task and label."""
    rows = []
    for panel in panels:
        for label in (label for label in labels if label in panel.lines):
            line = panel.lines[label]
            last = sorted(set(line.last))
            steps = short(last[0]) if len(last) == 1 else f"{short(last[0])} to {short(last[-1])}"
            rows.append([panel.title, label, str(line.seeds), steps, cell(line.final, 0), cell(line.final, 1)])
    text = f"`{metric}`: of each run the mean of the evaluations in the last tenth of its steps."
    return section("Final return", text, ["Task", "Method", "Seeds", "Steps", "Mean", "IQM"], rows)


def curve_section(panels, labels, metric, statistic):
    """Values of the learning curves at parts of the steps that are drawn."""
    rows = []
    for panel in panels:
        for label in (label for label in labels if label in panel.lines):
            line = panel.lines[label]
            row = [panel.title, label]
            for part in PARTS:
                # The last evaluation up to there.
                index = int((line.steps <= part * line.steps[-1]).sum()) - 1
                row.append(
                    f"{cell(line.estimate, index)} at {short(int(line.steps[index]))}" if index >= 0 else ""
                )
            rows.append(row)
    name = "IQM" if statistic == "iqm" else "Mean"
    text = f"{name} of `{metric}` over seeds, after a quarter, half, three quarters and all of the drawn steps."
    return section("Learning curves", text, ["Task", "Method", "1/4", "1/2", "3/4", "End"], rows)


def scale_section(scores, given):
    scales = [(title, scores.scales[title]) for title in scores.titles]
    rows = [[title, number(scale["low"]), number(scale["high"])] for title, scale in scales]
    text = f"Scores are (x - low) / (high - low); {given}."
    return section("Scale of the scores", text, ["Task", "Low", "High"], rows)


def aggregate_section(estimates, labels):
    names = [name[0].upper() + name[1:] for name in AGGREGATES]
    rows = [[label] + [cell(estimates[label], i) for i in range(len(names))] for label in labels]
    return section("Aggregate metrics", "Of normalised final returns.", ["Method", *names], rows)


def improvement_section(estimates):
    rows = [[x, y, cell(estimate, 0)] for (x, y), estimate in estimates.items()]
    text = "P(X > Y): probability that a run of X scores higher than one of Y, mean over tasks."
    return section("Probability of improvement", text, ["X", "Y", "P(X > Y)"], rows)


def profile_section(thresholds, estimates, labels):
    """Profiles at round thresholds."""
    indices = [int(i) for i in np.searchsorted(thresholds, ROUND_THRESHOLDS)]
    rows = [[label] + [cell(estimates[label], i) for i in indices] for label in labels]
    header = ["Method"] + [f"τ = {number(x)}" for x in ROUND_THRESHOLDS]
    return section(
        "Performance profiles", "Fraction of runs whose normalised final return is above τ.", header, rows
    )


def efficiency_section(steps, estimates, labels):
    indices = sorted({int((steps <= part * steps[-1]).sum()) - 1 for part in PARTS})
    rows = [[label] + [cell(estimates[label], i) for i in indices] for label in labels]
    header = ["Method"] + [f"{short(int(steps[i]))} steps" for i in indices]
    return section("Sample efficiency", "IQM of normalised scores over runs and tasks.", header, rows)


def notes_section(notes):
    return ["## Notes", ""] + [f"- {note}" for note in notes] + [""] if notes else []
