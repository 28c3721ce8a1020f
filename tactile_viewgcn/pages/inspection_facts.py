"""What an inspection says of recordings: facts, tables, warnings, a verdict and the checks.

The lines for a terminal and the page both take them from here.
"""

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.columns import ALIKE_RATES
from tactile_viewgcn.frames.leak import QuickError
from tactile_viewgcn.frames.split import one_class
from tactile_viewgcn.messages import EMPTY_HAND, NEW_SESSION, Note, listed, several, warnings_of
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.checks import NEED_FRAMES, UNKNOWN, Check, outcomes
from tactile_viewgcn.pages.source_inspection import Overview

MOST_DEAD = 0.1  # with a larger share of a grid's places that never vary, they have no sensor
TWICE = "Record each object at least twice, better five times in two sessions."
FIRMLY = (
    "Record more of each object, held firmly. "
    "Perhaps folders of sessions were read as objects: see the table of objects."
)


def facts(overview: Overview) -> list[tuple[str, str]]:
    """Return pairs of a figure and a text, which together read as one sentence.

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
    session_error = f"is the same classifier's estimate for {NEW_SESSION}"
    leak = (
        "is the error of another quick classifier, which sees only frames without contact; "
        "its interval should reach chance"
    )
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
    """Return in words how many sensors vary, and the names of those that are not used.

    Many places of a grid can be without a sensor. Then they are not named.
    """
    recordings = overview.recordings
    text = f"of {several(recordings.live.size, 'sensor')} vary"
    unused = recordings.sensor_names(~recordings.live)
    has_gaps = not recordings.channel_names and len(unused) > MOST_DEAD * recordings.live.size
    if not unused or has_gaps:
        return text
    if len(unused) == 1:
        return f"{text}; {unused[0]} reads the same in all frames and is not used"
    return f"{text}; {listed(unused)} read the same in all frames and are not used"


def _frame_rate(rates: list[float]) -> str:
    """Return the median of sorted rates (Hz) if they are alike, else their range."""
    if rates[-1] < rates[0] * ALIKE_RATES:
        return f"{np.median(rates):.4g} Hz"
    return f"{rates[0]:.4g} to {rates[-1]:.4g} Hz"


def _error_fact(error: QuickError | None, text: str) -> list[tuple[str, str]]:
    """Return a pair for `facts`, or nothing if the error was not measured."""
    if not error:
        return []
    interval = f"95 % interval {100 * error.low:.1f} to {100 * error.high:.1f}"
    chance = f"chance {100 * error.chance:.1f}"
    return [(f"{100 * error.error:.1f} %", f"{text} ({interval}; {chance})")]


def tables(overview: Overview) -> dict[str, pd.DataFrame]:
    """Return the tables of objects and of sessions, by title.

    Args:
        overview: the inspected recordings.

    Returns:
        Tables with a row for each object or session. The columns are the number of recordings and
        the number of frames of each kind, as texts.
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
    """Return the sums of counts over the recordings of each code (R,), as texts by name."""
    table = counts.groupby(code).sum().map("{:,}".format)
    return table.set_axis([names[index] for index in table.index])


def warnings(overview: Overview) -> list[Note]:
    """Return warnings of what can spoil a result with the recommended settings, with remedies.

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
        text = f"These objects have only one {by}: {single}. So they cannot be tested. {TWICE}"
        notes.append(Note(text, "warning", "split"))
    return notes


def _session_warning(error: QuickError, session_error: QuickError) -> list[Note]:
    """Return a warning if new sessions have a clearly higher error than new recordings."""
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
    """Return whether the recordings can be used; it never says that nothing spoils a result.

    Args:
        overview: the inspected recordings.
        warned: the warnings that `warnings` returns for them.
    """
    usable = _usable_objects(overview)
    if len(usable) < 2:
        names = ", ".join(usable) or "none"
        return html.Verdict("bad", f"Not yet: {one_class(names)}.", [])
    by = overview.setting("split.by")
    groups = overview.groups[by]
    if (groups > 1).sum() < 2:
        answer = f"Not yet: there are no two objects with two {by}s each. {TWICE}"
        return html.Verdict("bad", answer, [])
    reason = "Each object is in both published sets."
    if by != "source":
        fewest = several(int(groups[groups > 0].min()), by)
        reason = f"Each object has {fewest} or more."
    if warned:
        return html.Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", [reason])
    unseen = "The files cannot show augmented copies, windows or persons: see below."
    return html.Verdict("open", "No check below gave a warning.", [reason, unseen])


def checks(overview: Overview, warned: list[Note]) -> list[Check]:
    """Return the checks and their outcomes.

    Args:
        overview: the inspected recordings.
        warned: the warnings that `warnings` returns for them.
    """
    not_made = dict[str, str]()
    if overview.counts["frames"].max() == 1:
        not_made |= dict.fromkeys(NEED_FRAMES, "not checked: every recording is one frame")
    if not overview.choice.leak:
        text = "not checked: too few frames without contact"
        not_made["objects that are recognised without contact"] = text
    if not overview.rates:
        not_made["times and frame rates"] = "not checked: no times"
    return outcomes(warned, not_made)


def unknown(overview: Overview) -> list[str]:
    """Return sentences on what the files cannot tell.

    Args:
        overview: the inspected recordings.
    """
    sentences = [*UNKNOWN]
    if overview.error:
        error = f"{100 * overview.error.error:.1f} %"
        sentences.append(
            f"If there are such copies or pieces, the first estimate of the error, {error}, is too "
            "low."
        )
    return sentences


def _usable_objects(overview: Overview) -> list[str]:
    """Return the names of the objects with frames that `preprocess` keeps, and the empty hand."""
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
    """Return the chosen objects, bool (O,), in words, without the empty hand; "" if none."""
    names = list[str]()
    for label in np.unique(overview.label):
        name = overview.recordings.objects[label]
        if chosen[label] and name != EMPTY_HAND:
            names.append(name)
    return listed(names)
