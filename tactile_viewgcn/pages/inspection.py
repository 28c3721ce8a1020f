"""An inspection as text of 80 columns and as a page: facts, tables, checks, warnings, a command, pictures."""

import shlex
import textwrap
from collections.abc import Iterable
from dataclasses import asdict
from itertools import groupby

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.columns import ALIKE
from tactile_viewgcn.frames.leak import QuickError
from tactile_viewgcn.frames.split import one_class
from tactile_viewgcn.messages import EMPTY_HAND, NEW_SESSION, Note, listed, several, warnings_of
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.channels import Curves, channel_curves
from tactile_viewgcn.pages.checks import NEED_FRAMES, UNKNOWN, Check, outcomes, way_to_the_clone
from tactile_viewgcn.pages.source_inspection import MOST_FOLDS, SAMPLE, Overview
from tactile_viewgcn.params import VIRTUAL, default_params, everywhere, unlike_the_file
from tactile_viewgcn.schema import as_change, flatten
from tactile_viewgcn.tables.counts import evenly

WIDTH = 80
NAME = 24  # letters of an object's or session's name
TWICE = "Record each object at least twice, better five times in two sessions."
FIRMLY = (
    "Record more of each, held firmly; or are sessions taken for objects? See the table of objects."
)


def inspection_lines(overview: Overview) -> list[str]:
    """The inspection, the command to use, and the reason of each setting."""
    lines = [
        str(overview.recordings.path),
        *_wrapped(f"{figure} {text}" for figure, text in facts(overview)),
    ]
    lines += _wrapped(note.text for note in overview.remarks if note.level == "info")
    for title, table in tables(overview).items():
        rows = table.rename(
            index=lambda name: name if len(name) <= NAME else f"{name[: NAME - 1]}…"
        ).to_string()
        lines += [title, *textwrap.indent(rows, "  ").splitlines()]
    warned = warnings(overview)
    judged = verdict(overview, warned)
    lines += ["Can they be used?", *_wrapped([" ".join([judged.answer, *judged.reasons])])]
    lines += _wrapped(note.text for note in warned)
    lines += [
        "What was checked",
        *_wrapped(f"{check.what}: {check.outcome}" for check in checks(overview, warned)),
    ]
    lines += ["What the files cannot tell", *_wrapped(unknown(overview))]
    command = command_lines(overview)
    if not command:
        return lines
    lines += ["To use", *_wrapped(map(str, overview.settings))]
    sentence, change_folder = way_to_the_clone()
    if sentence:
        lines += _wrapped([sentence])
    lines.append("")
    if change_folder:
        lines.append(change_folder)
    lines += command
    other = command_lines(overview, new_sessions=True)
    if other:
        lines += ["", f"To test it on {NEW_SESSION}", *other]
    return lines


def inspection_page(overview: Overview) -> str:
    """The page as HTML."""
    path = overview.recordings.path
    warned = warnings(overview)
    page = html.environment().get_template("inspection.html")
    sentence, change_folder = way_to_the_clone()
    pictures, curves = dict[str, str](), list[Curves]()
    if overview.is_array:
        pictures = _mean_frames(overview)
    else:
        curves = channel_curves(overview.recordings)
    return page.render(
        title=f"Recordings: {path.name}",
        path=path,
        simulated=str(path) == VIRTUAL,
        verdict=verdict(overview, warned),
        facts=facts(overview),
        command="\n".join(command_lines(overview)),
        of_sessions="\n".join(command_lines(overview, new_sessions=True)),
        settings=overview.settings,
        warnings=warned,
        remarks=[note for note in overview.remarks if note.level == "info"],
        tables=tables(overview),
        mean_frames=pictures,
        curves=curves,
        is_array=overview.is_array,
        checks=checks(overview, warned),
        unknown=unknown(overview),
        elsewhere=sentence,
        change_folder=change_folder,
    )


def facts(overview: Overview) -> list[tuple[str, str]]:
    """Pairs of a figure and a text, which read as one sentence."""
    table, frames, states = overview.recordings, overview.counts["frames"], overview.states
    (height, width), low, high = table.shape, frames.min(), frames.max()
    objects = several(len(np.unique(overview.label)), "object")
    sessions = several(len(np.unique(overview.session)), "session")
    lengths = f"{low} to {high} frames" if low < high else f"{several(int(low), 'frame')} each"
    pressed = f"{overview.choice.plan.params.contact_sensors} or more sensors are pressed"
    pressed = "recordings are taken as they are" if states.all_contact else pressed
    rows = [
        (f"{frames.sum():,}", f"frames of {height} x {width}, kept as {table.counts.dtype}"),
        (f"{len(frames):,}", f"recordings of {objects} in {sessions}: {lengths}"),
    ]
    if overview.finds_contact:
        share = 100 * overview.counts["in contact"].sum() / frames.sum()
        rows.append((f"{share:.0f} %", f"of the frames count as contact: {pressed}"))
    varying = f"of {several(table.live.size, 'sensor')} vary"
    if table.channel_names and not table.live.all():
        unused = table.sensor_names(~table.live)
        if len(unused) == 1:
            varying += f"; {unused[0]} reads the same in all frames and is not used"
        else:
            varying += f"; {listed(unused)} read the same in all frames and are not used"
    rows.append((f"{table.live.sum():,}", varying))
    if rates := sorted(overview.rates.values()):
        alike = rates[-1] < rates[0] * ALIKE
        rate = f"{np.median(rates):.4g}" if alike else f"{rates[0]:.4g} to {rates[-1]:.4g}"
        rows.append((f"{rate} Hz", "is the frame rate"))
    rows += _error(
        overview.error, "is a first guess of the error on a new recording, by one quick classifier"
    )
    rows += _error(overview.session_error, f"is that guess for {NEW_SESSION}")
    return rows + _error(
        overview.choice.leak, "is its error without contact: the nearer to guessing, the better"
    )


def tables(overview: Overview) -> dict[str, pd.DataFrame]:
    """Numbers of recordings and of frames of each kind, as texts: a row for each object, and for each session."""
    recordings, counts, tables = (
        overview.recordings,
        pd.DataFrame(overview.counts),
        dict[str, pd.DataFrame](),
    )
    if not overview.finds_contact:
        counts = counts.drop(columns=["in contact", "open hand"])
    of = {
        "Objects": (recordings.objects, overview.label),
        "Sessions": (recordings.sessions, overview.session),
    }
    for title, (names, index) in of.items():
        table = counts.groupby(index).sum().map("{:,}".format)
        tables[title] = table.set_axis([names[one] for one in table.index])
    return tables


def _error(error: QuickError | None, text: str) -> list[tuple[str, str]]:
    """A pair for `facts`, where that error was measured."""
    if not error:
        return []
    interval, chance = (
        f"{100 * error.low:.1f} to {100 * error.high:.1f}",
        f"{100 * error.chance:.1f}",
    )
    return [(f"{100 * error.error:.1f} %", f"{text} ({interval}; guessing: {chance})")]


def warnings(overview: Overview) -> list[Note]:
    """What may spoil a result with the recommended settings, each with a remedy."""
    by = overview.setting("split.by")
    contact = np.bincount(
        overview.label, overview.counts["in contact"], len(overview.recordings.objects)
    )
    untouched, single = _names(overview, contact == 0), _names(overview, overview.groups[by] == 1)
    error, session = overview.error, overview.session_error
    guessing = error and not error.beats_chance
    texts = {
        "contact": untouched
        and f"Never in contact: {untouched}. Record these objects again, held firmly.",
        "error": guessing
        and f"The error of a quick classifier cannot be told from guessing. {FIRMLY}",
        "session": error
        and session
        and error.high < min(session.error, error.chance)
        and f"On {NEW_SESSION} a quick classifier errs by {100 * session.error:.1f} %, on a new recording by "
        f"{100 * error.error:.1f} %. Test both, and record more sessions.",
        "split": single and f"One {by} alone: {single}. Nothing is left to test with. {TWICE}",
    }
    return warnings_of(overview.remarks) + [
        Note(text, "warning", topic) for topic, text in texts.items() if text
    ]


def verdict(overview: Overview, warned: list[Note]) -> html.Verdict:
    """Whether the recordings can be trained and tested on; never that nothing would spoil a result."""
    by = overview.setting("split.by")
    groups = overview.groups[by]
    if len(left := _kept(overview)) < 2:
        return html.Verdict("bad", f"Not yet: {one_class(', '.join(left) or 'none')}.", [])
    if (groups > 1).sum() < 2:
        return html.Verdict(
            "bad", f"Not yet: there are no two objects with two recordings each. {TWICE}", []
        )
    reason = "Each object is on both published sides."
    if by != "source":
        fewest = several(int(groups[groups > 0].min()), by)
        reason = f"Each object has {fewest} or more."
    if warned:
        return html.Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", [reason])
    unseen = "The files cannot tell augmented copies, windows or persons: see below."
    return html.Verdict("open", "No check below gave a warning.", [reason, unseen])


def checks(overview: Overview, warned: list[Note]) -> list[Check]:
    """What was checked, and what was found."""
    not_made = dict[str, str]()
    if overview.counts["frames"].max() == 1:
        not_made |= dict.fromkeys(NEED_FRAMES, "not checked: every recording is one frame")
    if not overview.choice.leak:
        not_made["objects told without any contact"] = "not checked: too few frames without contact"
    if not overview.rates:
        not_made["times and frame rates"] = "not checked: no times"
    return outcomes(warned, not_made)


def unknown(overview: Overview) -> list[str]:
    """What the files cannot tell, in sentences."""
    sentences = [*UNKNOWN]
    if overview.error:
        sentences.append(
            f"With such copies or pieces, the first guess of the error, {100 * overview.error.error:.1f} %, is too low."
        )
    return sentences


def command_lines(overview: Overview, *, new_sessions: bool = False) -> list[str]:
    """The command `dvc exp run` with the recommended settings, in lines of a shell that go on after a backslash.

    Args:
        new_sessions: hold out sessions in place of recordings; none where these cannot be.

    None where `preprocess` would keep one class, or nothing can be held out: no setting makes these
    usable. Every `auto` of `preprocess` stays `auto`: unlike an inspection, `preprocess` does not
    look at the test side. What a line for other recordings has set in params.yaml is named too.
    """
    if verdict(overview, []).kind == "bad" or (new_sessions and not overview.session_error):
        return []
    form, settings, defaults = (
        overview.form,
        [*overview.remarks, *overview.settings],
        flatten(default_params()),
    )
    advised = {
        note.key: note.value
        for note in settings
        if note.key and not note.key.startswith("preprocess.")
    }
    preset, left_out = advised.pop("preset"), advised.pop("data.columns", [])
    if new_sessions:
        advised |= {
            "split.by": "session",
            "split.folds": min(MOST_FOLDS, len(np.unique(overview.session))),
        }
    always = ["split.by", "split.folds", "split.fold", "views"]
    values = unlike_the_file(
        {key: defaults[key] for key in defaults if key.startswith(("split.", "preprocess."))}
    )
    asked = {f"preprocess.{key}": value for key, value in asdict(overview.asked).items()}
    values |= {key: value for key, value in asked.items() if value != defaults[key]}
    values |= {key: defaults[key] for key in always} | {
        "data.source": str(everywhere(overview.recordings.path)),
        "data.shape": form.shape if isinstance(form.shape, str) else list(form.shape),
        "data.layout": form.layout,
        "data.columns": [*form.columns, *left_out],
    }
    values |= advised
    sections = groupby(
        sorted(values), lambda key: key if key == "data.source" else key.partition(".")[0]
    )
    options = [
        " ".join(f"-S {shlex.quote(as_change(key, values[key]))}" for key in keys)
        for _, keys in sections
    ]
    lines = [f"dvc exp run $(tactile-viewgcn preset {preset})", *options]
    return " \\\n  ".join(lines).split("\n")


def _kept(overview: Overview) -> list[str]:
    """Names of the objects of which `preprocess` keeps frames; it keeps those of the empty hand too."""
    kind = {"flags": "flagged", "contact": "in contact"}.get(
        overview.choice.plan.params.filter, "frames"
    )
    kept, objects = overview.label[overview.counts[kind] > 0], overview.recordings.objects
    return [
        name
        for label, name in enumerate(objects)
        if label in kept or (name == EMPTY_HAND and label in overview.label)
    ]


def _names(overview: Overview, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    names = [
        overview.recordings.objects[label] for label in np.unique(overview.label) if chosen[label]
    ]
    return listed([name for name in names if name != EMPTY_HAND])


def _wrapped(texts: Iterable[str]) -> list[str]:
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    return [line for text in texts for line in wrapper.wrap(text)]


def _mean_frames(overview: Overview) -> dict[str, str]:
    """By object with frames in contact, the picture of their mean; one scale for all, sensors that do not vary grey."""
    recordings, label, means = (
        overview.recordings,
        overview.recordings.columns["object"],
        dict[str, np.ndarray](),
    )
    for one in np.unique(label[overview.in_contact]):
        sample = evenly(np.flatnonzero(overview.in_contact & (label == one)), SAMPLE)
        means[recordings.objects[one]] = frame = np.full(recordings.shape, np.nan)
        frame[recordings.live] = overview.excess(sample).mean(axis=0)
    top = np.nanpercentile([*means.values()], 99.5) if means else 1
    return {name: html.heat_map(frame, top) for name, frame in means.items()}
