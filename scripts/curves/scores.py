"""Statistics of runs: curves with bands, final returns, normalised scores and what rliable makes of them.

Intervals are 95 % percentile intervals of rliable's stratified bootstrap (Agarwal et al. 2021), which draws runs
with replacement, those of each task apart.
"""

import tomllib
from dataclasses import dataclass

import numpy as np
from rliable import library, metrics

from .runs import InputError, read_text

# The final return is the mean of the evaluations in this last part of the steps, as in `mamf compare`.
FINAL_PART = 0.1
BOOTSTRAP_SEED = 0
# Thresholds of the performance profiles that the table states.
ROUND_THRESHOLDS = [0.0, 0.25, 0.5, 0.75, 1.0]


def mean(values):
    return values.mean(axis=0)


def iqm(values):
    """Interquartile mean over the first axis: of n values, sorted, n / 4 (rounded down) are left out at each end.

    The same number as rliable's `aggregate_iqm`, which spends most of the time of a resample on checks of SciPy's.
    """
    cut = len(values) // 4
    return np.sort(values, axis=0)[cut : len(values) - cut].mean(axis=0)


STATISTICS = {"mean": mean, "iqm": iqm}


@dataclass(frozen=True)
class Estimate:
    """A number or an array of them; `low` and `high` bound its interval, None where there is but one run."""

    value: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None


def bootstrap(scores, statistic, reps):
    """`statistic` of scores, an array [runs, tasks, ...] or a list of such, with its interval.

    One run has no interval: drawing from it gives the same run each time.
    """
    arrays = scores if isinstance(scores, list) else [scores]
    if max(len(array) for array in arrays) == 1:
        return Estimate(np.asarray(statistic(*arrays)))
    # rliable draws from NumPy's global generator, whatever random_state says. Seeded here, an estimate does not
    # depend on those before it.
    np.random.seed(BOOTSTRAP_SEED)
    values, bounds = library.get_interval_estimates({"": scores}, statistic, reps=reps)
    return Estimate(np.asarray(values[""]), bounds[""][0], bounds[""][1])


@dataclass(frozen=True)
class Line:
    """The curve of one label in one panel: an estimate over seeds at each of `steps`."""

    steps: np.ndarray
    estimate: Estimate
    seeds: int


def smoothed(curve, window):
    """Every value replaced by the mean of the last `window` ones, of fewer at the beginning."""
    return curve.rolling(window, min_periods=1).mean() if window > 1 else curve


def common_steps(curves):
    """Steps at which all curves have a value, ascending."""
    return sorted(int(step) for step in set.intersection(*(set(curve.index) for curve in curves)))


def line_of(runs, statistic, window, reps):
    """The line of the runs of one label, and notes on what is not as it should be."""
    curves = [smoothed(run.curve, window) for run in runs]
    steps = common_steps(curves)
    if not steps:
        raise InputError(f"{runs[0].path}: no evaluation at a step at which {runs[1].path} has one too")
    values = np.array([curve.loc[steps].to_numpy() for curve in curves])  # [runs, steps]
    estimate = bootstrap(values, STATISTICS[statistic], reps)
    return Line(np.array(steps), estimate, len(runs)), line_notes(runs, steps)


def line_notes(runs, steps):
    """What a reader must know about the runs of one label that are drawn at `steps`: texts to follow the title."""
    notes = []
    label, drawn = runs[0].label, steps[-1]
    longest = intended_end(runs)
    for run in runs:
        if run.last < longest:
            cut = f"; drawn to {short(drawn)}" if len(runs) > 1 else ""
            notes.append(f", {label}: seed {run.seed} ends at {short(run.last)} of {short(longest)} steps{cut}")
    possible = max(sum(step <= drawn for step in run.curve.index) for run in runs)
    if len(steps) < possible:
        notes.append(
            f", {label}: seeds are evaluated at different steps; the {len(steps)} common ones of {possible} are drawn"
        )
    return notes


def intended_end(runs):
    """The step at which the longest of the runs ends, or is to end."""
    return max(max(run.planned, run.last) for run in runs)


def short(number):
    """1500000 -> 1.5M, 20000 -> 20k"""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(number) >= size:
            return f"{number / size:g}{letter}"
    return f"{number:g}"


def seed_list(seeds):
    """[0, 1, 2, 5, 6] -> "0-2, 5, 6" """
    parts = []
    for seed in sorted(seeds):
        if parts and seed == parts[-1][1] + 1:
            parts[-1][1] = seed
        else:
            parts.append([seed, seed])
    return ", ".join(
        f"{first}-{last}" if last > first + 1 else ", ".join(map(str, range(first, last + 1)))
        for first, last in parts
    )


def panel_notes(panel, labels):
    """Seeds and labels that others have and some lack: texts to follow the title."""
    lacking = [label for label in labels if label not in panel.lines]
    notes = [f": no runs of {', '.join(lacking)}"] if lacking else []
    everyone = {run.seed for runs in panel.lines.values() for run in runs}
    for label in (label for label in labels if label in panel.lines):
        seeds = {run.seed for run in panel.lines[label]}
        if seeds < everyone:
            plural = "s" if len(seeds) > 1 else ""
            notes.append(f", {label}: seed{plural} {seed_list(seeds)} of {seed_list(everyone)}")
    return notes


def final_return(run):
    """Mean of the evaluations in the last tenth of the run's steps."""
    steps = run.curve.index
    return run.curve[steps >= (1 - FINAL_PART) * steps[-1]].mean()


def final_returns(runs):
    """[runs]"""
    return np.array([final_return(run) for run in runs])


@dataclass(frozen=True)
class Scale:
    """What counts as 0 and as 1 on one task."""

    low: float
    high: float

    def __call__(self, values):
        return (values - self.low) / (self.high - self.low)


def measured_scale(panel):
    """0 is the untrained policy, over all runs; 1 the best label's mean final return."""
    runs = [run for line in panel.lines.values() for run in line]
    for run in runs:
        if run.curve.index[0] != 0:
            raise InputError(
                f"{run.path / 'eval.csv'}, line 2: no evaluation at step 0, from which scores are counted;"
                " give --reference, or --figures curves"
            )
    low = float(np.mean([run.curve.iloc[0] for run in runs]))
    return Scale(low, max(float(final_returns(line).mean()) for line in panel.lines.values()))


def read_scales(path, panels):
    """Scales by panel title from a TOML file of `"<task or title>" = [low, high]`."""
    try:
        table = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f'{path}: {error}; a line should read "Hopper-v4" = [20.0, 3000.0]') from None
    scales = {}
    for panel in panels:
        pair = table.get(panel.title, table.get(panel.task))
        numbers = isinstance(pair, list) and [x for x in pair if isinstance(x, (int, float)) and np.isfinite(x)]
        if not numbers or len(pair) != 2 or len(numbers) != 2 or pair[0] >= pair[1]:
            raise InputError(
                f'{path}: a line "{panel.title}" = [low, high] with low < high is needed, found {pair}'
            )
        scales[panel.title] = Scale(float(pair[0]), float(pair[1]))
    return scales


@dataclass(frozen=True)
class Scores:
    """Normalised scores of every label on the tasks that all labels have.

    `final` holds for each label an array [runs, tasks], `curves` one of [runs, tasks, steps] at `steps`, the common
    ones, of which the last may be before `longest`, the last step of any; `scales` what 0 and 1 are, by title; `notes`
    what was left out.
    """

    titles: list
    scales: dict
    final: dict
    curves: dict
    steps: np.ndarray
    longest: int
    notes: list


def scores_of(panels, labels, scales, window):
    """Normalised scores. Of every label as many runs a task are used as the task with the fewest has, for rliable
    takes arrays [runs, tasks]."""
    notes = []
    used = []
    for panel in panels:
        scale = scales[panel.title]
        lacking = [label for label in labels if label not in panel.lines]
        if lacking:
            notes.append(f"{panel.title}: left out, no runs of {', '.join(lacking)}")
        elif not scale.low < scale.high:
            notes.append(
                f"{panel.title}: left out, no method ends above the untrained policy ({scale.high:.4g} against"
                f" {scale.low:.4g}), so there is no scale; --reference gives one"
            )
        else:
            used.append(panel)
    if not used:
        raise InputError("no task to aggregate over: " + "; ".join(notes))
    # Steps that each task's runs are meant to have.
    ends = [intended_end([run for line in panel.lines.values() for run in line]) for panel in used]
    chosen = {}
    for label in labels:
        count = min(len(panel.lines[label]) for panel in used)
        # Whole runs rather than those that end early.
        sorted_runs = [
            sorted(panel.lines[label], key=lambda run, end=end: (run.last < end, run.seed))
            for panel, end in zip(used, ends, strict=True)
        ]
        chosen[label] = [runs[:count] for runs in sorted_runs]
        if any(len(runs) > count for runs in sorted_runs):
            plural = "s" if count > 1 else ""
            notes.append(f"{label}: {count} seed{plural} of each task count, for one task has no more")
        for panel, end, runs in zip(used, ends, sorted_runs, strict=True):
            for run in (run for run in runs[:count] if run.last < end):
                went = f"counts as far as it went, {short(run.last)} of {short(end)} steps"
                notes.append(f"{panel.title}, {label}: seed {run.seed} {went}")
    runs = [run for lines in chosen.values() for line in lines for run in line]
    curves = {id(run): smoothed(run.curve, window) for run in runs}
    steps = common_steps(list(curves.values()))
    if not steps:
        raise InputError("no step at which all runs have an evaluation; choose other runs, or --figures curves")
    longest = max(run.last for run in runs)
    final, along = {}, {}
    for label, lines in chosen.items():
        tasks = [(scales[panel.title], line) for panel, line in zip(used, lines, strict=True)]
        final[label] = np.array([scale(final_returns(line)) for scale, line in tasks]).T
        table = [[scale(curves[id(run)].loc[steps].to_numpy()) for run in line] for scale, line in tasks]
        along[label] = np.array(table).swapaxes(0, 1)
    titles = [panel.title for panel in used]
    return Scores(titles, {x: scales[x] for x in titles}, final, along, np.array(steps), longest, notes)


AGGREGATES = {
    "median": metrics.aggregate_median,
    "IQM": lambda scores: iqm(scores.ravel()),
    "mean": metrics.aggregate_mean,
    "optimality gap": metrics.aggregate_optimality_gap,
}


def aggregates(scores, reps):
    """`{label: Estimate}` of the four aggregate metrics, in the order of AGGREGATES."""

    def all_of(x):
        return np.array([metric(x) for metric in AGGREGATES.values()])

    return {label: bootstrap(final, all_of, reps) for label, final in scores.final.items()}


def probability_of_improvement(x, y):
    """Mean over tasks of P(X > Y) + P(X = Y) / 2 for runs drawn from x [runs, tasks] and y.

    The same number as rliable's metric of that name, which makes a whole rank test of each resample.
    """
    x, y = x[:, None], y[None]
    return np.array([((x > y) + 0.5 * (x == y)).mean()])


def improvements(scores, baseline, reps):
    """`{(X, Y): Estimate}`: of each label over the baseline, or without one of all pairs."""
    labels = list(scores.final)
    if baseline:
        pairs = [(label, baseline) for label in labels if label != baseline]
    else:
        pairs = [(x, y) for i, x in enumerate(labels) for y in labels[i + 1 :]]
    return {
        (x, y): bootstrap([scores.final[x], scores.final[y]], probability_of_improvement, reps) for x, y in pairs
    }


def profiles(scores, reps):
    """Thresholds, and `{label: Estimate}` of the fraction of runs whose score is above each."""
    everything = np.concatenate([final.ravel() for final in scores.final.values()])
    # Where a method fails altogether, scores far below 0 would take all of the width.
    low, high = max(min(0.0, everything.min()), -1.0), max(1.0, everything.max())
    thresholds = np.union1d(np.linspace(low, high, 101), ROUND_THRESHOLDS)

    def above(x):
        return (x[..., None] > thresholds).mean(axis=(0, 1))

    return thresholds, {label: bootstrap(final, above, reps) for label, final in scores.final.items()}


def efficiency(scores, reps):
    """`{label: Estimate}` of the IQM of all runs and tasks at each of the common steps."""

    def over_runs_and_tasks(x):
        return iqm(x.reshape(-1, x.shape[2]))

    return {label: bootstrap(curves, over_runs_and_tasks, reps) for label, curves in scores.curves.items()}
