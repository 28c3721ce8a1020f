"""The page of a finished run: the answer, the road to it, the errors, and what it was made from."""

import shlex
from datetime import datetime

from tactile_viewgcn import html
from tactile_viewgcn.evaluation.answers import chance_error
from tactile_viewgcn.evaluation.error_sections import (
    clusters_section,
    curves_section,
    error_section,
    main_protocol,
    objects_section,
    pairs_section,
)
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.wording import (
    BASELINES,
    FILTERS,
    SPLITS,
    error_ends,
    interval,
    percent,
    seconds,
    system,
)
from tactile_viewgcn.html import Html, bar, bold, bullets, code, command, named, paragraph, section, several, table
from tactile_viewgcn.provenance import PACKAGES
from tactile_viewgcn.schema import as_change

WARNING = "warning: "
SIMULATED = (
    " A virtual glove computed these recordings: the figures compare methods and do not say how well a real glove does."
)
WORDS = {
    "frame": "one reading of all sensors of the glove",
    "baseline": "what the sensors read when nothing presses them",
    "recording": "the frames taken in one go, of one object",
    "session": "the recordings between two fittings of the glove",
    "view set": "the frames that are classified together",
    "split group": "frames that never stand on two sides of the split, because they resemble each other",
    "training and test side": "what the classifier learns from, and what it is asked about afterwards",
    "95 % interval": "where the error would lie, in 95 of 100 repetitions with other groups from the same source",
    "trial": "one drawing of a view set around each test frame",
}


def run_page(run: FinishedRun) -> str:
    """The page as HTML."""
    sections = [
        _warnings_section(run),
        _road_section(run),
        error_section(run),
        objects_section(run),
        pairs_section(run),
        *curves_section(run),
        *clusters_section(run),
        _next_section(run),
        _lineage_section(run),
        section("Words", table(("word", "meaning"), [(bold(word), meaning) for word, meaning in WORDS.items()])),
    ]
    return html.page(f"Report: {_name(run)}", _head(run), sections)


def _name(run: FinishedRun) -> str:
    return run.name or f"{run.params['model.system']}, {_date(run)}"


def _date(run: FinishedRun) -> str:
    return f"{datetime.fromisoformat(run.records['evaluate']['origin']['time']):%d %B %Y, %H:%M} UTC"


def _head(run: FinishedRun) -> list[Html]:
    """Title, question and answer."""
    protocol = main_protocol(run)
    score, chance, views = run.metrics[protocol], chance_error(run.predictions), run.metrics["views"]
    ((side, groups),) = run.metrics["groups"].items()
    error, ends = percent(score["error"]["mean"]), error_ends(score)
    frames = "one pressure frame" if views == 1 else f"{views} pressure frames"
    of = "of a recording that it has not learnt from" if protocol == "recording" else "of the test recordings"
    told = " The interval includes guessing." if ends and ends[1] >= chance else ""
    simulated = [html.badge("Simulated data"), SIMULATED]
    return [
        html.element("h1", f"Which of {run.metrics['classes']} objects does the hand hold?"),
        paragraph(f"Report of the run {run.name or 'in the workspace'}, {_date(run)}", kind="soft"),
        *([paragraph(*simulated)] if run.simulated else []),
        paragraph(
            f"From {frames} {of}, the classifier names the wrong object in ",
            bold(f"{error} of the cases"),
            f" (95 % interval {interval(score)}). Guessing would be wrong in {percent(chance)}.{told}",
            kind="lead",
        ),
        *([paragraph("These are validation groups: the test side was not read.")] if side == "validation" else []),
        html.tiles(
            [
                (error, f"wrong answers; interval {interval(score)}, over {several(groups, 'split group')}"),
                (percent(chance), "wrong answers when always naming the same object"),
                (percent(1 - score["top3"]["mean"]), "of the right objects are not among the first three answers"),
                (f"{run.timing['latency_ms']['single']['median']:.1f} ms", "for one answer"),
                (seconds(run.timing["seconds"]["total"]), "from raw recordings to this result"),
            ]
        ),
        paragraph(f"The classifier: {system(run.params)}."),
    ]


def _warnings_section(run: FinishedRun) -> tuple[str, Html]:
    """Every warning that a stage gave."""
    told = [f"{stage}: {note.replace(WARNING, '')}" for stage, note in run.notes if WARNING in note]
    for stage, epoch in run.metrics.get("diverged_in_epoch", {}).items():
        told.append(
            f"{stage}: the training diverged in epoch {epoch:g}, and this is what the weights before it give; lower "
            f"{stage}.lr"
        )
    if not told:
        return section("Warnings", paragraph("No stage gave a warning.", kind="good"))
    return section("Warnings", *(paragraph(text, kind="warning") for text in told))


def _road_section(run: FinishedRun) -> tuple[str, Html]:
    """How many frames and recordings there are at each stage."""
    read, kept = run.records["ingest"]["counts"], run.records["preprocess"]["counts"]
    (side,) = run.metrics["groups"]
    sets, trials, views = run.metrics["frames"][side], run.metrics["trials"], run.metrics["views"]
    rows = [
        (
            "Recorded",
            read["frames"],
            read["recordings"],
            f"{several(read['objects'], 'object')}, {several(read['sessions'], 'session')}, "
            f"{several(read['sensors'], 'sensor')} that vary",
        ),
        (
            "Kept",
            kept["frames.kept"],
            kept["recordings.kept"],
            f"{FILTERS[_used(run, 'preprocess.filter')]}; {BASELINES[_used(run, 'preprocess.baseline')]}",
        ),
        *(
            (
                title,
                kept[f"frames.{name}"],
                kept[f"recordings.{name}"],
                f"{several(kept[f'groups.{name}'], 'split group')}",
            )
            for name, title in (("train", "Training"), ("validation", "Validation"), ("test", "Test"))
            if kept[f"frames.{name}"]
        ),
    ]
    most = read["frames"]
    body = [
        (named(name, remark), f"{frames:,}", bar(frames / most), f"{recordings:,}")
        for name, frames, recordings, remark in rows
    ]
    answers = (
        f"Tested with {several(sets, 'view set')} of {several(views, 'frame')} each, one around every "
        f"{side} frame that counts, drawn anew in {several(trials, 'trial')}: {sets * trials:,} answers in all."
    )
    noted = ((stage, note) for stage, note in run.notes if WARNING not in note)
    notes = [note if note.startswith(f"{stage}.") else f"{stage}: {note}" for stage, note in noted]
    return section(
        "From raw counts to the answer",
        table(("", "frames", "", "recordings"), body, numbers="tntn"),
        paragraph(f"Sides are divided by {SPLITS[run.params['split.by']]}. {answers}"),
        *([html.element("h3", "What the stages noted"), bullets(notes)] if notes else []),
    )


def _used(run: FinishedRun, key: str) -> str:
    """The value of a parameter, or what it was decided to be where it is `auto`."""
    return run.records["preprocess"]["counts"].get(f"resolved.{key}", run.params[key])


def _next_section(run: FinishedRun) -> tuple[str, Html]:
    commit, changed = run.records["evaluate"]["origin"].get("mlflow.source.git.commit"), _changed(run)
    again = ["dvc exp run", *(f"-S {shlex.quote(change)}" for change in changed)]
    return section(
        "What to do next",
        paragraph("Ask the classifier about new recordings of the same glove:"),
        command("tactile-viewgcn predict models/classifier.pt NEW_RECORDINGS"),
        paragraph("See what the recordings hold, and which settings fit them:"),
        command(f"tactile-viewgcn inspect {run.params['data.source']}"),
        paragraph("Compare with other runs, or make this one again:"),
        command("\n".join(["mlflow ui", *([f"git checkout {commit}"] if commit else []), " ".join(again)])),
        paragraph(
            "An interval narrows with more split groups, so with more recordings of each object in more sessions; more "
            "frames of the same recordings hardly narrow it.",
            kind="soft",
        ),
    )


def _changed(run: FinishedRun) -> list[str]:
    """Parameters that differ from the committed ones, as `dvc exp run -S` takes them."""
    changed = run.records["evaluate"]["params"]["changed"].items()
    return [as_change(key, value) for key, value in changed]


def _lineage_section(run: FinishedRun) -> tuple[str, Html]:
    """What the result was made from, where and when."""
    records, origin = run.records, run.records["evaluate"]["origin"]
    source, changed = records["ingest"]["inputs"]["source"], _changed(run)
    commit = origin.get("mlflow.source.git.commit", "outside git")
    dirty = ", with changes that are not committed" if origin.get("git.dirty") == "true" else ""
    versions = {name: text for name, text in origin.items() if name in ("python", *PACKAGES)}
    machine = f"{origin['host']}: {origin['processor']}, {several(int(origin['cores']), 'core')}"
    rows = [
        ("Recordings", html.join([code(source["path"]), "md5", code(source["md5"])], " ")),
        ("Code", html.join([code(commit), dirty], "")),
        (
            "Changed parameters",
            html.join(map(code, changed), " ") if changed else "none",
        ),
        ("Evaluated", f"{_date(run)} on {machine}"),
        ("Computed on", f"{origin['device']} in {origin['precision']}"),
        ("Versions", ", ".join(f"{name} {text}" for name, text in versions.items())),
        (
            "MLflow runs",
            bullets(
                html.join([f"{stage} ", code(record["run_id"])], "")
                for stage, record in records.items()
                if record["run_id"]
            ),
        ),
    ]
    values = [(code(key), str(value)) for key, value in run.params.items()]
    return section(
        "What it was made from",
        table(("", ""), [(bold(name), text) for name, text in rows]),
        html.details("All parameters", table(("parameter", "value"), values)),
    )
