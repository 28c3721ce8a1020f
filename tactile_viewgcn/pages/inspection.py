"""An inspection as text of 80 columns and as a page.

Both have the same facts, tables, checks, warnings, command and settings; the page has pictures too.
"""

import shlex
import textwrap
from collections.abc import Iterable
from dataclasses import asdict
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd

from tactile_viewgcn.files import way_to_the_clone
from tactile_viewgcn.frames.columns import ALIKE_RATES
from tactile_viewgcn.frames.leak import QuickError
from tactile_viewgcn.frames.split import one_class
from tactile_viewgcn.messages import EMPTY_HAND, NEW_SESSION, Note, listed, several, warnings_of
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.channels import Curves, channel_curves
from tactile_viewgcn.pages.checks import NEED_FRAMES, UNKNOWN, Check, outcomes
from tactile_viewgcn.pages.run_page import each_fold, each_fold_changes
from tactile_viewgcn.pages.source_inspection import MOST_FOLDS, SAMPLE, Overview
from tactile_viewgcn.params import VIRTUAL, default_params, everywhere, unlike_the_file
from tactile_viewgcn.schema import as_change, flatten
from tactile_viewgcn.tables.counts import evenly

WIDTH = 80
NAME_LETTERS = 24  # of an object or a session
PICTURE_TOP = 99.5  # percentile of all mean frames that is the brightest colour
TWICE = "Record each object at least twice, better five times in two sessions."
FIRMLY = (
    "Record more of each, held firmly. "
    "Perhaps folders of sessions were read as objects: see the table of objects."
)
ENOUGH = 100  # split groups of a fold: the interval of its error is 20 points wide at most
# parameters that the command always names, since params.yaml may be left from other recordings
ALWAYS_NAMED = ("split.by", "split.folds", "split.fold", "views")


def inspection_lines(overview: Overview) -> list[str]:
    """Return the lines of an inspection: its results, the command, and the reason of each setting.

    Args:
        overview: the inspected recordings.
    """
    warned = warnings(overview)
    lines = [str(overview.recordings.path)]
    lines += _wrapped(f"{figure} {text}" for figure, text in facts(overview))
    lines += _wrapped(note.text for note in overview.remarks if note.level == "info")
    lines += _table_lines(overview)
    judged = verdict(overview, warned)
    lines.append("Can they be used?")
    lines += _wrapped([" ".join([judged.answer, *judged.reasons])])
    lines += _wrapped(note.text for note in warned)
    lines.append("What was checked")
    lines += _wrapped(f"{check.what}: {check.outcome}" for check in checks(overview, warned))
    lines.append("What the files cannot tell")
    lines += _wrapped(unknown(overview))
    return lines + _usage_lines(overview)


def _table_lines(overview: Overview) -> list[str]:
    """Return the tables as lines, with names cut to 24 letters."""
    lines = list[str]()
    for title, table in tables(overview).items():
        rows = table.rename(index=_shortened).to_string()
        lines.append(title)
        lines += textwrap.indent(rows, "  ").splitlines()
    return lines


def _shortened(name: str) -> str:
    if len(name) <= NAME_LETTERS:
        return name
    return f"{name[: NAME_LETTERS - 1]}…"


def _usage_lines(overview: Overview) -> list[str]:
    """Return the settings and commands to use, or nothing where no command can work."""
    command = command_lines(overview)
    if not command:
        return []
    lines = ["To use", *_wrapped(map(str, overview.settings))]
    sentence, change_folder = way_to_the_clone()
    if sentence:
        lines += _wrapped([sentence])
    lines.append("")
    if change_folder:
        lines.append(change_folder)
    lines += command
    of_sessions = command_lines(overview, new_sessions=True)
    if of_sessions:
        lines += ["", f"To test it on {NEW_SESSION}", *of_sessions]
    each_fold = each_fold_lines(overview)
    if each_fold:
        lines += ["", "To test every part once, with a row for each", *each_fold]
    return lines


def inspection_page(overview: Overview) -> str:
    """Return the page of an inspection as HTML.

    Args:
        overview: the inspected recordings.
    """
    path = overview.recordings.path
    warned = warnings(overview)
    sentence, change_folder = way_to_the_clone()
    mean_frames = dict[str, str]()
    curves = list[Curves]()
    if overview.is_array:
        mean_frames = _mean_frames(overview)
    else:
        curves = channel_curves(overview.recordings)
    page = html.environment().get_template("inspection.html")
    return page.render(
        title=f"Recordings: {path.name}",
        path=path,
        simulated=str(path) == VIRTUAL,
        verdict=verdict(overview, warned),
        facts=facts(overview),
        command="\n".join(command_lines(overview)),
        of_sessions="\n".join(command_lines(overview, new_sessions=True)),
        each_fold="\n".join(each_fold_lines(overview)),
        settings=overview.settings,
        warnings=warned,
        remarks=[note for note in overview.remarks if note.level == "info"],
        tables=tables(overview),
        mean_frames=mean_frames,
        curves=curves,
        is_array=overview.is_array,
        checks=checks(overview, warned),
        unknown=unknown(overview),
        elsewhere=sentence,
        change_folder=change_folder,
    )


def facts(overview: Overview) -> list[tuple[str, str]]:
    """Return pairs of a figure and a text, which read as one sentence.

    Args:
        overview: the inspected recordings.
    """
    recordings = overview.recordings
    frames = overview.counts["frames"]
    height, width = recordings.shape
    objects = several(len(np.unique(overview.label)), "object")
    sessions = several(len(np.unique(overview.session)), "session")
    rows = [
        (f"{frames.sum():,}", f"frames of {height} x {width}, kept as {recordings.counts.dtype}"),
        (f"{len(frames):,}", f"recordings of {objects} in {sessions}: {_lengths(frames)}"),
    ]
    if overview.finds_contact:
        share = 100 * overview.counts["in contact"].sum() / frames.sum()
        rows.append(
            (f"{share:.0f} %", f"of the frames count as contact: {_contact_rule(overview)}")
        )
    rows.append((f"{recordings.live.sum():,}", _varying_sensors(overview)))
    rates = sorted(overview.rates.values())
    if rates:
        rows.append((_frame_rate(rates), "is the frame rate"))
    error = "is a first estimate of the error on a new recording, by one quick classifier"
    session_error = f"is that estimate for {NEW_SESSION}"
    leak = "is its error without contact: the nearer to chance, the better"
    rows += _error_fact(overview.error, error)
    rows += _error_fact(overview.session_error, session_error)
    rows += _error_fact(overview.choice.leak, leak)
    return rows


def _lengths(frames: np.ndarray) -> str:
    """Return the lengths of recordings in words, from their numbers of frames (R,)."""
    shortest = int(frames.min())
    longest = int(frames.max())
    if shortest == longest:
        return f"{several(shortest, 'frame')} each"
    return f"{shortest} to {longest} frames"


def _contact_rule(overview: Overview) -> str:
    if overview.states.all_contact:
        return "recordings are taken as they are"
    return f"{overview.choice.plan.params.contact_sensors} or more sensors are pressed"


def _varying_sensors(overview: Overview) -> str:
    """Return how many sensors there are, and the names of the channels that are not used."""
    recordings = overview.recordings
    text = f"of {several(recordings.live.size, 'sensor')} vary"
    if not recordings.channel_names or recordings.live.all():
        return text
    unused = recordings.sensor_names(~recordings.live)
    if len(unused) == 1:
        return f"{text}; {unused[0]} reads the same in all frames and is not used"
    return f"{text}; {listed(unused)} read the same in all frames and are not used"


def _frame_rate(rates: list[float]) -> str:
    """Return the median of sorted rates (Hz) that are alike, else their range."""
    if rates[-1] < rates[0] * ALIKE_RATES:
        return f"{np.median(rates):.4g} Hz"
    return f"{rates[0]:.4g} to {rates[-1]:.4g} Hz"


def _error_fact(error: QuickError | None, text: str) -> list[tuple[str, str]]:
    """Return a pair for `facts`, or nothing where that error was not measured."""
    if not error:
        return []
    interval = f"{100 * error.low:.1f} to {100 * error.high:.1f}"
    chance = f"{100 * error.chance:.1f}"
    return [(f"{100 * error.error:.1f} %", f"{text} ({interval}; chance: {chance})")]


def tables(overview: Overview) -> dict[str, pd.DataFrame]:
    """Return the tables of objects and of sessions, by title.

    Args:
        overview: the inspected recordings.

    Returns:
        Tables with a row for each object or session. The columns are the number of recordings and
        the numbers of frames of each kind, as texts.
    """
    counts = pd.DataFrame(overview.counts)
    if not overview.finds_contact:
        counts = counts.drop(columns=["in contact", "open hand"])
    recordings = overview.recordings
    return {
        "Objects": _sums(counts, overview.label, recordings.objects),
        "Sessions": _sums(counts, overview.session, recordings.sessions),
    }


def _sums(counts: pd.DataFrame, code: np.ndarray, names: list[str]) -> pd.DataFrame:
    """Return the sums of counts (R rows) over recordings of one code (R,), as texts by name."""
    table = counts.groupby(code).sum().map("{:,}".format)
    return table.set_axis([names[index] for index in table.index])


def warnings(overview: Overview) -> list[Note]:
    """Return what may spoil a result with the recommended settings, each with a remedy.

    Args:
        overview: the inspected recordings.
    """
    notes = warnings_of(overview.remarks)
    objects = len(overview.recordings.objects)
    contact = np.bincount(overview.label, overview.counts["in contact"], objects)
    untouched = _names(overview, contact == 0)
    if untouched:
        text = f"Never in contact: {untouched}. Record these objects again, held firmly."
        notes.append(Note(text, "warning", "contact"))
    error = overview.error
    if error and not error.beats_chance:
        text = f"The error of a quick classifier cannot be told from chance. {FIRMLY}"
        notes.append(Note(text, "warning", "error"))
    if error and overview.session_error:
        notes += _session_warning(error, overview.session_error)
    by = overview.setting("split.by")
    single = _names(overview, overview.groups[by] == 1)
    if single:
        text = f"These have only one {by}: {single}. Nothing is left to test with. {TWICE}"
        notes.append(Note(text, "warning", "split"))
    return notes


def _session_warning(error: QuickError, session_error: QuickError) -> list[Note]:
    """Return a warning where new sessions have a clearly higher error than new recordings."""
    beats_chance = error.high < error.chance
    sessions_are_harder = error.high < session_error.error
    if not (beats_chance and sessions_are_harder):
        return []
    text = (
        f"The error rate of a quick classifier is {100 * session_error.error:.1f} % on "
        f"{NEW_SESSION}, and {100 * error.error:.1f} % on a new recording. "
        "Test both, and record more sessions."
    )
    return [Note(text, "warning", "session")]


def verdict(overview: Overview, warned: list[Note]) -> html.Verdict:
    """Return whether the recordings can be used; never that nothing would spoil a result.

    Args:
        overview: the inspected recordings.
        warned: what `warnings` gives for them.
    """
    usable = _usable_objects(overview)
    if len(usable) < 2:
        names = ", ".join(usable) or "none"
        return html.Verdict("bad", f"Not yet: {one_class(names)}.", [])
    by = overview.setting("split.by")
    groups = overview.groups[by]
    if (groups > 1).sum() < 2:
        answer = f"Not yet: there are no two objects with two recordings each. {TWICE}"
        return html.Verdict("bad", answer, [])
    reason = "Each object is in both published sets."
    if by != "source":
        fewest = several(int(groups[groups > 0].min()), by)
        reason = f"Each object has {fewest} or more."
    if warned:
        return html.Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", [reason])
    unseen = "The files cannot tell augmented copies, windows or persons: see below."
    return html.Verdict("open", "No check below gave a warning.", [reason, unseen])


def checks(overview: Overview, warned: list[Note]) -> list[Check]:
    """Return what was checked, and what was found.

    Args:
        overview: the inspected recordings.
        warned: what `warnings` gives for them.
    """
    not_made = dict[str, str]()
    if overview.counts["frames"].max() == 1:
        not_made |= dict.fromkeys(NEED_FRAMES, "not checked: every recording is one frame")
    if not overview.choice.leak:
        not_made["objects told without any contact"] = "not checked: too few frames without contact"
    if not overview.rates:
        not_made["times and frame rates"] = "not checked: no times"
    return outcomes(warned, not_made)


def unknown(overview: Overview) -> list[str]:
    """Return what the files cannot tell, in sentences.

    Args:
        overview: the inspected recordings.
    """
    sentences = [*UNKNOWN]
    if overview.error:
        error = f"{100 * overview.error.error:.1f} %"
        sentences.append(
            f"With such copies or pieces, the first estimate of the error, {error}, is too low."
        )
    return sentences


def command_lines(overview: Overview, *, new_sessions: bool = False) -> list[str]:
    r"""Return the command `dvc exp run` with the recommended settings.

    Every `auto` of `preprocess` stays `auto`: an inspection looks at all recordings, `preprocess`
    at the training set only. What params.yaml has from other recordings is named too.

    Args:
        overview: the inspected recordings.
        new_sessions: hold out sessions in place of recordings.

    Returns:
        The lines of the command, of which all but the last end in a backslash. There are none where
        no setting makes the recordings usable: `preprocess` would keep one class, or nothing can be
        held out.
    """
    if verdict(overview, []).kind == "bad":
        return []
    if new_sessions and not overview.session_error:
        return []
    advised = _advised(overview)
    values = _named_values(overview, advised)
    if new_sessions:
        values["split.by"] = "session"
        values["split.folds"] = min(MOST_FOLDS, len(np.unique(overview.session)))
    return _lines([f"dvc exp run $(tactile-viewgcn preset {advised['preset']})"], values)


def each_fold_lines(overview: Overview) -> list[str]:
    """Return the command that tests every part of the recordings once: each session if there are.

    Args:
        overview: the inspected recordings.

    Returns:
        The lines of the command; none where `command_lines` has none, and where there are no
        sessions and one fold tests so many split groups that it says enough.
    """
    if not command_lines(overview):
        return []
    advised = _advised(overview)
    values = _named_values(overview, advised)
    by = values["split.by"]
    is_divided = not overview.session_error and by != "source"
    if is_divided and overview.groups[by].sum() / values["split.folds"] >= ENOUGH:
        return []
    if values["split.by"] == "source":
        values["split.by"] = "recording"
    if overview.session_error:
        values["split.by"] = "session"
        values["split.folds"] = len(np.unique(overview.session))
    preset = f"$(tactile-viewgcn preset {advised['preset']})"
    return _lines([each_fold(values["data.source"]), preset], each_fold_changes(values))


def _advised(overview: Overview) -> dict[str, Any]:
    """Return what the inspection advises, by key of params.yaml; `preset` is one of them."""
    return {note.key: note.value for note in [*overview.remarks, *overview.settings]}


def _lines(command: list[str], values: dict[str, Any]) -> list[str]:
    """Return a command with options, in lines of which all but the last end in a backslash.

    Args:
        command: lines that stand before the options.
        values: of the options, by dotted key.
    """
    return " \\\n  ".join([*command, *_option_lines(values)]).split("\n")


def _named_values(overview: Overview, advised: dict[str, Any]) -> dict[str, Any]:
    """Return every parameter that the command names, by dotted key.

    Later values replace earlier ones:

    1. defaults, where params.yaml has another value;
    2. settings of `preprocess` that the user has fixed;
    3. defaults of the parameters that are always named;
    4. the source and its form;
    5. the advice of the remarks, and the recommended settings.

    Args:
        overview: the inspected recordings.
        advised: values by key, from the remarks and the recommended settings.
    """
    defaults = flatten(default_params())
    rested_on = {
        key: value for key, value in defaults.items() if key.startswith(("split.", "preprocess."))
    }
    values = unlike_the_file(rested_on)
    for name, value in asdict(overview.preprocess).items():
        key = f"preprocess.{name}"
        if value != defaults[key]:
            values[key] = value
    for key in ALWAYS_NAMED:
        values[key] = defaults[key]
    form = overview.form
    values["data.source"] = str(everywhere(overview.recordings.path))
    values["data.shape"] = form.shape
    if not isinstance(form.shape, str):
        values["data.shape"] = list(form.shape)
    values["data.layout"] = form.layout
    values["data.columns"] = [*form.columns, *advised.get("data.columns", [])]
    unnamed = ("", "preset", "data.columns")
    for key, value in advised.items():
        if key not in unnamed and not key.startswith("preprocess."):
            values[key] = value
    return values


def _option_lines(values: dict[str, Any]) -> list[str]:
    """Return the options `-S key=value`, those of a section in one line; the source has its own."""
    lines = list[str]()
    for _, keys in groupby(sorted(values), _line_of):
        options = [f"-S {shlex.quote(as_change(key, values[key]))}" for key in keys]
        lines.append(" ".join(options))
    return lines


def _line_of(key: str) -> str:
    if key == "data.source":
        return key
    return key.partition(".")[0]


def _usable_objects(overview: Overview) -> list[str]:
    """Return the names of the objects of which `preprocess` keeps frames, and of the empty hand."""
    kinds = {"flags": "flagged", "contact": "in contact"}
    kind = kinds.get(overview.choice.plan.params.filter, "frames")
    with_frames = overview.label[overview.counts[kind] > 0]
    names = list[str]()
    for label, name in enumerate(overview.recordings.objects):
        is_empty_hand = name == EMPTY_HAND and label in overview.label
        if label in with_frames or is_empty_hand:
            names.append(name)
    return names


def _names(overview: Overview, chosen: np.ndarray) -> str:
    """Return the names of the recorded objects among bool (O,), but for the empty hand, or ""."""
    names = list[str]()
    for label in np.unique(overview.label):
        name = overview.recordings.objects[label]
        if chosen[label] and name != EMPTY_HAND:
            names.append(name)
    return listed(names)


def _wrapped(texts: Iterable[str]) -> list[str]:
    """Return the texts as lines of 80 columns; a text's further lines are indented more."""
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    lines = list[str]()
    for text in texts:
        lines += wrapper.wrap(text)
    return lines


def _mean_frames(overview: Overview) -> dict[str, str]:
    """Return the picture of the mean frame in contact, by object, all in one scale of colours.

    Sensors that do not vary are grey. Objects without contact have no picture.
    """
    recordings = overview.recordings
    object_of_frame = recordings.columns["object"]
    means = dict[str, np.ndarray]()
    for label in np.unique(object_of_frame[overview.in_contact]):
        in_contact = np.flatnonzero(overview.in_contact & (object_of_frame == label))
        frame = np.full(recordings.shape, np.nan)
        frame[recordings.live] = overview.excess(evenly(in_contact, SAMPLE)).mean(axis=0)
        means[recordings.objects[label]] = frame
    if not means:
        return {}
    top = float(np.nanpercentile([*means.values()], PICTURE_TOP))
    return {name: html.heat_map(frame, top) for name, frame in means.items()}
