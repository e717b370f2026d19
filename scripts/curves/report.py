"""What is drawn and written of runs, and what is said about them."""

from . import figures, table
from .runs import FIGURES, METRICS, InputError
from .scores import (
    aggregates,
    efficiency,
    improvements,
    line_of,
    measured_scale,
    panel_notes,
    profiles,
    read_scales,
    scores_of,
    short,
)


def together(notes):
    """(title, text that follows it) pairs as lines, panels with the same text on one."""
    titles = {}
    for title, text in notes:
        titles.setdefault(text, []).append(title)
    return [f"{', '.join(panels)}{text}" for text, panels in titles.items()]


def draw_curves(panels, labels, arguments):
    """The figure of learning curves, its table and its notes."""
    lines, notes = {}, []
    for panel in panels:
        lines[panel.title] = {}
        for label, runs in panel.lines.items():
            line, said = line_of(runs, arguments.statistic, arguments.smooth, arguments.reps)
            lines[panel.title][label] = line
            notes += [(panel.title, text) for text in said]
        notes += [(panel.title, text) for text in panel_notes(panel, labels)]
    ranges = dict(arguments.range)
    notes = together(notes + range_notes(lines, ranges))
    statistic = "IQM" if arguments.statistic == "iqm" else "mean"
    counts = [len(runs) for panel in panels for runs in panel.lines.values()]
    how = f"Line: {statistic} over seeds. Band: {interval_text(arguments)}{caution(counts)}."
    if max(counts) == 1:
        how = "Line: the only seed; no bands."
    if arguments.smooth > 1:
        how += f" Every point is the mean of the last {arguments.smooth} evaluations of a seed."
    if arguments.statistic == "iqm" and min(counts) < 4:
        how += " The IQM of fewer than 4 seeds is their mean."
    full = arguments.full if arguments.layout == "ablation" else None
    what = METRICS[arguments.metric]
    figure = figures.curves(panels, labels, lines, what, [how, *notes], ranges, full)
    section = table.curve_section(panels, labels, lines, arguments.metric, arguments.statistic)
    return figure, section, notes


def range_notes(lines, ranges):
    """Which lines leave the ranges that are drawn."""
    notes = []
    for title in lines:
        if title in ranges:
            estimates = {label: line.estimate for label, line in lines[title].items()}
            notes += [(title, f": {text}") for text in beyond(estimates, ranges[title])]
    return notes


def beyond(estimates, limits):
    """A note on the labels that go beyond the limits, if any does."""
    low, high = limits
    outside = [label for label, x in estimates.items() if extent(x)[0] < low or extent(x)[1] > high]
    text = f"only {low:g} to {high:g} is drawn, beyond which are parts of {', '.join(outside)}"
    return [text] if outside else []


def extent(estimate):
    """Lowest and highest number of an estimate and its band."""
    bounds = [x for x in (estimate.value, estimate.low, estimate.high) if x is not None]
    return min(x.min() for x in bounds), max(x.max() for x in bounds)


def caution(counts):
    """What bootstrap intervals of few seeds are worth."""
    return ", too narrow for 2 to 4 seeds" if any(1 < count < 5 for count in counts) else ""


def interval_text(arguments):
    return f"95 % stratified-bootstrap interval ({arguments.reps} resamples)"


def draw_scores(panels, labels, wanted, arguments):
    """Figures of normalised scores, by name; their tables and notes."""
    if arguments.reference:
        scales = read_scales(arguments.reference, panels)
        given = f"low and high are those of {arguments.reference.name}"
    else:
        scales = {panel.title: measured_scale(panel) for panel in panels}
        given = "low is the untrained policy's return, high the best method's mean final return"
    scores = scores_of(panels, labels, scales, arguments.smooth)
    tasks = f"{len(scores.titles)} task{'' if len(scores.titles) == 1 else 's'}"
    runs = {label: len(final) for label, final in scores.final.items()}
    some = f". Intervals: {interval_text(arguments)}{caution(runs.values())}"
    how = f"{tasks}{some if max(runs.values()) > 1 else ', single runs: no intervals'}."
    scale = f"Score: 0 is low, 1 is high; {given} of each task (see table.md)."
    notes = [how, scale, *scores.notes]
    # What single figures leave out, for the table.
    cut = []
    drawn, sections = {}, table.scale_section(scores, given)
    if "aggregate" in wanted:
        estimates = aggregates(scores, arguments.reps)
        limits = dict(arguments.range).get("aggregate")
        said = [f"Aggregate metrics: {text}" for text in beyond(estimates, limits)] if limits else []
        drawn["aggregate"] = figures.aggregate(estimates, labels, runs, notes + said, limits)
        cut += said
        sections += table.aggregate_section(estimates, labels)
    if "improvement" in wanted:
        estimates = improvements(scores, arguments.baseline, arguments.reps)
        bare = any(x.low is not None and x.low[0] == x.high[0] for x in estimates.values())
        said = ["A mark without a bar: every resample gives this number, for in each task one method has all"
                " runs above the other's."] if bare else []
        drawn["improvement"] = figures.improvement(estimates, labels, [how, *said, *scores.notes])
        sections += table.improvement_section(estimates)
    if "profiles" in wanted:
        thresholds, estimates = profiles(scores, arguments.reps)
        lowest = {label: final.min() for label, final in scores.final.items()}
        below = [label for label in labels if lowest[label] < thresholds[0]]
        said = [f"Profiles: drawn from {thresholds[0]:g} on, below which are runs of {', '.join(below)}."]
        drawn["profiles"] = figures.profile(thresholds, estimates, labels, runs, notes + (said if below else []))
        sections += table.profile_section(thresholds, estimates, labels)
    if "efficiency" in wanted:
        estimates = efficiency(scores, arguments.reps)
        limits = dict(arguments.range).get("efficiency")
        said = [f"Sample efficiency: {text}" for text in beyond(estimates, limits)] if limits else []
        if scores.steps[-1] < scores.longest:
            end, longest = short(int(scores.steps[-1])), short(scores.longest)
            said.append(f"Drawn to {end} of {longest} steps, the last one at which all runs have an evaluation.")
        drawn["efficiency"] = figures.efficiency(scores.steps, estimates, labels, runs, notes + said, limits)
        cut += said
        sections += table.efficiency_section(scores.steps, estimates, labels)
    return drawn, sections, scores.notes + cut


def draw(panels, arguments):
    """Figures by name, and the text of the table; `arguments` are those of the command line."""
    labels = figures.ordered({label for panel in panels for label in panel.lines})
    if arguments.layout == "ablation":
        labels = [arguments.full] + [label for label in labels if label != arguments.full]
    wanted = arguments.figures or [name for name in FIGURES if len(labels) > 1 or name != "improvement"]
    drawn, sections, notes = {}, table.final_section(panels, labels, arguments.metric, arguments.reps), []
    if "curves" in wanted:
        drawn["curves"], section, notes = draw_curves(panels, labels, arguments)
        sections += section
    if set(wanted) - {"curves"}:
        try:
            others, section, more = draw_scores(panels, labels, wanted, arguments)
        except InputError as error:
            if arguments.figures or arguments.reference:
                raise
            others, section, more = {}, [], [f"No figures of scores: {error}"]
        drawn |= others
        sections += section
        notes = notes + more
    head = ["# Numbers of the figures", "", f"Brackets: {interval_text(arguments)}; none for a single run.", ""]
    return drawn, "\n".join(head + sections + table.notes_section(notes))
