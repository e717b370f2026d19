"""What is drawn and written of runs, and what is said about them."""

from . import figures, table
from .data import FIGURES, METRICS, Estimate, InputError, short


def together(notes):
    """(title, text that follows it) pairs as lines, panels with the same text on one."""
    titles = {}
    for title, text in notes:
        titles.setdefault(text, []).append(title)
    return [f"{', '.join(panels)}{text}" for text, panels in titles.items()]


def draw_curves(curves, labels, arguments):
    """The figure of learning curves, its table and its notes."""
    panels, ranges = curves.panels, dict(arguments.range)
    notes = together(in_order(curves.notes, labels) + range_notes(panels, ranges))
    statistic = "IQM" if arguments.statistic == "iqm" else "mean"
    counts = [line.seeds for panel in panels for line in panel.lines.values()]
    how = [f"Line: {statistic} over seeds."]
    if max(counts) >= figures.BAND_SEEDS:
        how.append(f"Band: {T_INTERVAL}.")
    if any(1 < count < figures.BAND_SEEDS for count in counts):
        how.append(f"Thin lines: the seeds, where they are fewer than {figures.BAND_SEEDS}; no bands there.")
    how = " ".join(how) if max(counts) > 1 else "Line: the only seed; no bands."
    if arguments.smooth > 1:
        how += f" Every point is the mean of the last {arguments.smooth} evaluations of a seed."
    if arguments.statistic == "iqm" and min(counts) < 4:
        how += " The IQM of fewer than 4 seeds is their mean."
    full = arguments.full if arguments.layout == "ablation" else None
    what = METRICS[arguments.metric]
    figure = figures.curves(panels, labels, what, [how, *notes], ranges, full)
    section = table.curve_section(panels, labels, arguments.metric, arguments.statistic)
    return figure, section, notes


def in_order(notes, labels):
    """Notes on lines of one panel in the order of the labels."""

    def place(note):
        named = [number for number, label in enumerate(labels) if note[1].startswith(f", {label}: ")]
        return named[0] if named else -1

    panels = list(dict.fromkeys(title for title, _ in notes))
    return sorted(notes, key=lambda note: (panels.index(note[0]), place(note)))


def range_notes(panels, ranges):
    """Which lines leave the ranges that are drawn."""
    notes = []
    for panel in panels:
        if panel.title in ranges:
            estimates = {label: drawn_of(line) for label, line in panel.lines.items()}
            notes += [(panel.title, f": {text}") for text in beyond(estimates, ranges[panel.title])]
    return notes


def drawn_of(line):
    """What is drawn of a line, between its lowest and highest numbers."""
    if figures.has_band(line):
        return line.estimate
    return Estimate(line.estimate.value, line.runs.min(axis=0), line.runs.max(axis=0))


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


T_INTERVAL = "95 % interval of Student's t"


def bootstrap_text(counts, arguments):
    """What the intervals are that are no t intervals, and what those of few seeds are worth."""
    few = ", too narrow for 2 to 4 seeds" if any(1 < count < 5 for count in counts) else ""
    return f"95 % stratified-bootstrap intervals ({arguments.reps} resamples){few}"


def draw_scores(scores, labels, wanted, arguments):
    """Figures of normalised scores, by name; their tables and notes."""
    if arguments.reference:
        given = f"low and high are those of {arguments.reference.name}"
    else:
        given = "low is the untrained policy's return, high the best method's mean final return"
    tasks = f"{len(scores.titles)} task{'' if len(scores.titles) == 1 else 's'}"
    bars = bootstrap_text(scores.runs.values(), arguments)
    single = max(scores.runs.values()) == 1
    how = f"{tasks}, single runs: no intervals." if single else f"{tasks}. Intervals: {bars}."
    of_aggregates = how if single else f"{tasks}. Interval of the mean: {T_INTERVAL}; others: {bars}."
    scale = f"Score: 0 is low, 1 is high; {given} of each task (see table.md)."
    notes = [how, scale, *scores.notes]
    # What single figures leave out, for the table.
    cut = []
    drawn, sections = {}, table.scale_section(scores, given)
    if "aggregate" in wanted:
        estimates = scores.aggregates
        limits = dict(arguments.range).get("aggregate")
        said = [f"Aggregate metrics: {text}" for text in beyond(estimates, limits)] if limits else []
        below = [of_aggregates, scale, *scores.notes, *said]
        drawn["aggregate"] = figures.aggregate(estimates, labels, scores.runs, below, limits)
        cut += said
        sections += table.aggregate_section(estimates, labels)
    if "improvement" in wanted:
        estimates = {pair: scores.improvements[pair] for pair in pairs(labels, arguments.baseline)}
        bare = any(x.low is not None and x.low[0] == x.high[0] for x in estimates.values())
        said = ["A mark without a bar: every resample gives this number, for in each task one method has all"
                " runs above the other's."] if bare else []
        drawn["improvement"] = figures.improvement(estimates, labels, [how, *said, *scores.notes])
        sections += table.improvement_section(estimates)
    if "profiles" in wanted:
        thresholds, estimates = scores.thresholds, scores.profiles
        below = [label for label in labels if scores.lowest[label] < thresholds[0]]
        said = [f"Profiles: drawn from {thresholds[0]:g} on, below which are runs of {', '.join(below)}."]
        below = notes + (said if below else [])
        drawn["profiles"] = figures.profile(thresholds, estimates, labels, scores.runs, below)
        sections += table.profile_section(thresholds, estimates, labels)
    if "efficiency" in wanted:
        estimates = scores.efficiency
        limits = dict(arguments.range).get("efficiency")
        said = [f"Sample efficiency: {text}" for text in beyond(estimates, limits)] if limits else []
        if scores.steps[-1] < scores.longest:
            end, longest = short(int(scores.steps[-1])), short(scores.longest)
            said.append(f"Drawn to {end} of {longest} steps, the last one at which all runs have an evaluation.")
        drawn["efficiency"] = figures.efficiency(scores.steps, estimates, labels, scores.runs, notes + said, limits)
        cut += said
        sections += table.efficiency_section(scores.steps, estimates, labels)
    return drawn, sections, scores.notes + cut


def pairs(labels, baseline):
    """Each label over the baseline, or without one all pairs."""
    if baseline:
        return [(label, baseline) for label in labels if label != baseline]
    return [(x, y) for i, x in enumerate(labels) for y in labels[i + 1 :]]


def draw(curves, arguments):
    """Figures by name, and the text of the table; `arguments` are those of the command line."""
    panels = curves.panels
    labels = figures.ordered({label for panel in panels for label in panel.lines})
    if arguments.layout == "ablation":
        labels = [arguments.full] + [label for label in labels if label != arguments.full]
    wanted = arguments.figures or [name for name in FIGURES if len(labels) > 1 or name != "improvement"]
    drawn, sections, notes = {}, table.final_section(panels, labels, arguments.metric), []
    if "curves" in wanted:
        drawn["curves"], section, notes = draw_curves(curves, labels, arguments)
        sections += section
    bars = f"Brackets: {T_INTERVAL}"
    if set(wanted) - {"curves"}:
        if curves.scores is None and (arguments.figures or arguments.reference):
            raise InputError(f"{curves.no_scores}; or draw --figures curves alone")
        if curves.scores is None:
            notes = [*notes, f"No figures of scores: {curves.no_scores}"]
        else:
            others, section, more = draw_scores(curves.scores, labels, wanted, arguments)
            drawn |= others
            sections += section
            notes = notes + more
            of_scores = bootstrap_text(curves.scores.runs.values(), arguments)
            bars += f"; of aggregate metrics but the mean, probabilities, profiles and sample efficiency {of_scores}"
    head = ["# Numbers of the figures", "", f"{bars}; none for a single run.", ""]
    return drawn, "\n".join(head + sections + table.notes_section(notes))
