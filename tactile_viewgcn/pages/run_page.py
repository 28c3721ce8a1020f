"""The page of a finished run: the answer, the next steps, errors and their cost, and the run's origin."""

from datetime import datetime
from itertools import starmap

from matplotlib.figure import Figure

from tactile_viewgcn import plots
from tactile_viewgcn.evaluation.results import error_text
from tactile_viewgcn.evaluation.trials import PROTOCOLS
from tactile_viewgcn.messages import several
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.outcome import Outcome, again, next_steps
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.provenance import PACKAGES
from tactile_viewgcn.schema import as_change

PAIRS = 4


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    outcome, origin = Outcome(run), run.records["evaluate"].origin
    date = f"{datetime.fromisoformat(origin['time']):%d %B %Y, %H:%M} UTC"
    scores = {name: run.metrics[name] for name in reversed(PROTOCOLS) if name in run.metrics}
    by_views = {f"{name} protocol": score["by_views"] for name, score in scores.items() if "by_views" in score}
    counts = {f"{outcome.protocol} protocol, all trials": outcome.counts}
    return html.render(
        "report.html",
        run=run,
        origin=origin,
        title=f"Report: {run.name or run.params['model.system']}, {date}",
        date=date,
        outcome=outcome,
        steps=next_steps(outcome),
        scores=scores,
        error_text=error_text,
        by_views=by_views and plots.errors_by_views(by_views, outcome.chance),
        confusion=plots.confusions(counts, run.predictions.classes.tolist()),
        pairs=[_pair(outcome, first, second) for first, second in outcome.worst_pairs(PAIRS)],
        without_network=on_sensors(run.params["model.system"]),
        remarks=[note for note in run.notes("info") if note.topic != "candidates"],
        choices=run.notes("choice"),
        again=again(run.changed),
        changed=list(starmap(as_change, run.changed.items())),
        versions=[f"{name} {text}" for name, text in origin.items() if name in ("python", *PACKAGES)],
    )


def _pair(outcome: Outcome, first: int, second: int) -> tuple[Figure, str]:
    """Two objects side by side on the hand, and how often each was taken for the other."""
    predictions, counts, both = outcome.run.predictions, outcome.counts, [first, second]
    names = [str(predictions.classes[label]) for label in both]
    mistakes = [
        f"{name} was taken for {other} in {counts[label, answer]:,} of {several(int(counts[label].sum()), 'answer')}"
        for name, other, label, answer in zip(names, names[::-1], both, both[::-1], strict=True)
        if counts[label, answer]
    ]
    figure = plots.mean_frames(predictions.mean_frames[both], predictions.live, names, "network input")
    return figure, f"{'; '.join(mistakes)}."
