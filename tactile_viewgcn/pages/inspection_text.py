"""The words of an inspection, for a page and as text of 80 columns: facts, tables, warnings, a verdict, a command."""

import shlex
import textwrap
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from tactile_viewgcn.files import arrays_below
from tactile_viewgcn.frames.preprocessing import one_class
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import EMPTY_HAND, Note, several, warnings_of
from tactile_viewgcn.pages.html import Verdict
from tactile_viewgcn.pages.source_inspection import GAP, SATURATED, Overview
from tactile_viewgcn.params import MAX_SIDE, everywhere
from tactile_viewgcn.readers.source import FRAMES_LAST, listed
from tactile_viewgcn.schema import as_change

WIDTH = 80
NAME = 24  # letters of an object's or session's name
EVERY_SOURCE = ("object", "recording", "session", "frame", "time")  # the columns that are not optional
MANY_GAPS = 0.01  # of the frames
LARGEST = f"at the largest reading in more than {100 * SATURATED:g} % of the frames"
TWICE = "Record each object at least twice, better five times in two sessions."
LESS = "errors will say less about touch than they seem to"


class Table(NamedTuple):
    """Rows of text under a header; their first column is a name, the others are numbers."""

    title: str
    remark: str
    header: list[str]
    rows: list[list[str]]


def inspection_lines(overview: Overview) -> list[str]:
    """The inspection, the command to use, and the reason of each setting."""
    lines = [str(overview.recordings.path), *_wrapped(f"{figure} {text}" for figure, text in facts(overview))]
    for table in tables(overview):
        lines += [table.title, *_aligned(table), *_wrapped([table.remark])]
    warned = warnings(overview)
    judged = verdict(overview, warned)
    lines += ["Can they be used?", *_wrapped([" ".join([judged.answer, *judged.reasons])])]
    lines += _wrapped(note.text for note in warned)
    if command := command_lines(overview):
        lines += ["To use", *_wrapped(map(str, overview.settings)), "", *command]
    return lines


def facts(overview: Overview) -> list[tuple[str, str]]:
    """Pairs of a figure and a text, which read as one sentence."""
    table, counts = overview.recordings, overview.counts
    (height, width), frames = table.shape, counts["frames"]
    objects = several(len(np.unique(overview.label)), "object")
    sessions = several(len(np.unique(overview.session)), "session")
    low, middle, high = np.percentile(frames, [0, 50, 100])
    lengths = f"{low:g} to {high:g} frames, median {middle:g}" if low < high else f"{several(int(low), 'frame')} each"
    pressed = f"{overview.hand.sensors} or more sensors are pressed"
    pressed = "all are, even the quietest" if overview.hand.all_contact else pressed
    faults = {"hardly": overview.stuck.sum(), f"are {LARGEST}": overview.saturated.sum()}
    faulty = "".join(f"; {number} {fault}" for fault, number in faults.items() if number)
    rate, times = "no times", "of frames in the recordings, so no frame rate"
    if overview.interval:
        gaps = f"{several(overview.gaps, 'gap')} of more than {GAP} intervals"
        rate = f"{1 / overview.interval:.4g} Hz"
        times = f"is the frame rate; {gaps}, {np.median(overview.seconds):.3g} s a recording"
    rows = [
        _counted(frames.sum(), "frame", f" of {height} x {width}, kept as {table.dtype}"),
        _counted(len(frames), "recording", f" of {objects} in {sessions}: {lengths}"),
        (f"{100 * counts['in contact'].sum() / frames.sum():.0f} %", f"of the frames are in contact: {pressed}"),
        (f"{table.live.sum():,}", f"of {several(table.live.size, 'sensor')} vary{faulty}"),
        (rate, times),
    ]
    if optional := [name for name in table.columns if name not in EVERY_SOURCE]:
        rows.append(_counted(len(optional), "optional column", f": {', '.join(optional)}"))
    for note in overview.remarks:
        if note.level == "info":
            figure, _, text = note.text.partition(" ")
            rows.append((figure, text))
    is_table = table.channel_names or not arrays_below(table.path)
    if low == high and overview.form.shape == "auto" and not is_table:  # the axes may mean something else
        if height == 1 and 1 < high <= MAX_SIDE:
            text = f"cells in each file: if that is one frame, --shape {high:g} {width}"
            if width > high:
                text += f"; if it is {high:g} cells in {width} frames, --set data.shape={FRAMES_LAST}"
            rows.append((f"{high:g} x {width}", text))
        if high == height != width and height > 1:
            text = "in each file, taken as frames, rows, columns; where frames come last: np.moveaxis(array, -1, 0)"
            rows.append((f"{high:g} x {height} x {width}", text))
    return rows


def _counted(count: int, thing: str, rest: str) -> tuple[str, str]:
    """A number of things as a figure and a text."""
    figure, _, things = several(count, thing).partition(" ")
    return figure, things + rest


def tables(overview: Overview) -> list[Table]:
    """Objects, sessions, and the measurements of baselines, the chosen one marked."""
    label, counts, recordings = overview.label, overview.counts, overview.recordings
    flagged = "; flagged: by the recordings themselves" if "flagged" in counts else ""
    every_table = [
        Table(
            "Objects",
            f"Frames of each kind{flagged}.",
            ["object", *counts],
            [
                [recordings.objects[one], *(f"{count[label == one].sum():,}" for count in counts.values())]
                for one in np.unique(label)
            ],
        ),
        Table(
            "Sessions",
            f"Frames of the empty hand; noise of the median sensor, in {overview.unit}.",
            ["session", "recordings", "empty hand", "noise"],
            [_session(overview, number) for number in np.unique(overview.session)],
        ),
        _measured(overview),
    ]
    return [table for table in every_table if table.rows]


def _session(overview: Overview, number: int) -> list[str]:
    number_of, noise = (overview.session == number).sum(), np.median(overview.hand.noise[number])
    return [overview.recordings.sessions[number], f"{number_of:,}", f"{overview.empty[number]:,}", f"{noise:.3g}"]


def _measured(overview: Overview) -> Table:
    errors, leaks, taken = overview.choice.errors, overview.choice.leaks, overview.choice.params.baseline
    remark = (
        "Errors of a quick classifier on held-out groups, with a standard error. Without contact: on frames of the "
        "open hand, or on the first frame of a recording; an error below chance there is a leak. All recordings: of "
        "both sides, above the baseline that is taken."
    )
    if errors:
        by = overview.setting("split.by")
        remark += f" The one marked * was chosen on the training side of split.by {by} alone, as preprocess does."
    measured: list[tuple[str, QuickError | None, QuickError | None]] = [
        *((kind + " *" * (kind == taken), error, leaks.get(kind)) for kind, error in errors.items()),
        ("all recordings", overview.error, overview.leak),
        ("first frame", None, overview.first_frame),
    ]
    rows = [[name, *_errors(error, leak)] for name, error, leak in measured if error or leak]
    return Table("Baseline", remark, ["", "error, %", "without contact, %", "chance, %", "leaks"], rows)


def _errors(error: QuickError | None, leak: QuickError | None) -> list[str]:
    """The cells of an error, and of one without contact."""
    cells = [f"{100 * error.error:.1f} ± {100 * error.standard_error:.1f}" if error else "", "", "", ""]
    if leak:
        interval = percent_interval(leak.error, leak.low, leak.high)
        cells[1:] = [interval, f"{100 * leak.chance:.1f}", "yes" if leak.beats_chance else "no"]
    return cells


def warnings(overview: Overview) -> list[Note]:
    """What may spoil a result with the recommended settings, each with a remedy."""
    by, stuck, saturated = overview.setting("split.by"), int(overview.stuck.sum()), int(overview.saturated.sum())
    contact = np.bincount(overview.label, overview.counts["in contact"], len(overview.recordings.objects))
    untouched, single = _names(overview, contact == 0), _names(overview, overview.groups[by] == 1)
    notes = warnings_of(overview.remarks)

    def warn(topic: str, text: str) -> None:
        notes.append(Note(text, "warning", topic))

    if untouched:
        warn("contact", f"Never in contact: {untouched}. Record these objects again, held firmly.")
    if overview.leak and overview.leak.beats_chance:
        leak = f"The object can be recognised before it is touched (baseline {overview.choice.params.baseline})"
        warn("leak", f"{leak}: {LESS}. Record each object in several sessions, in another order in each.")
    if overview.first_frame and overview.first_frame.beats_chance:
        leak = "The first frame of a recording, before the hand holds anything, already predicts the object"
        warn("first frame", f"{leak}: {LESS}. Record the objects in another order in each session.")
    if overview.error and not overview.error.beats_chance:
        guessing = "A quick classifier predicts the objects no better than guessing."
        exchanged = overview.session_error and overview.session_error.beats_chance
        swapped = "It predicts the sessions: are these the objects? Then name what is a session session1, session2, ..."
        warn("error", f"{guessing} {swapped if exchanged else 'Record more of each, held firmly.'}")
    if single:
        once = f"{'Grasped' if by == 'grasp' else 'Recorded'} once: {single}."
        warn("split", f"{once} Nothing is left to test with. {TWICE}")
    if overview.gaps > MANY_GAPS * overview.counts["frames"].sum():
        remedy = "Look at the cable, and at the program that records."
        warn("time", f"Frames are missing at {several(overview.gaps, 'place')}. {remedy}")
    if stuck:
        warn("stuck", f"{several(stuck, 'sensor')} hardly {'varies' if stuck == 1 else 'vary'}. Check their wiring.")
    if saturated:
        sensors = f"{several(saturated, 'sensor')} {'is' if saturated == 1 else 'are'} {LARGEST}."
        warn("saturated", f"{sensors} Lower the gain of the electronics, or grip less.")
    return notes


def verdict(overview: Overview, warned: list[Note]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    by = overview.setting("split.by")
    groups = overview.groups[by]
    if len(left := _kept(overview)) < 2:
        return Verdict("bad", f"Not yet: {one_class(', '.join(left) or 'none')}.", [])
    if (groups > 1).sum() < 2:
        return Verdict("bad", f"Not yet: there are no two objects with two recordings each. {TWICE}", [])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    if overview.leak and not overview.leak.beats_chance:
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warned:
        return Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", reasons)
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def command_lines(overview: Overview) -> list[str]:
    """The command `dvc exp run` with the recommended settings, in lines of a shell that go on after a backslash.

    None where `preprocess` would keep one class, or nothing can be held out: no setting makes these usable. Every
    `auto` of `preprocess` stays `auto`: unlike an inspection, `preprocess` does not look at the test side.
    """
    if verdict(overview, []).kind == "bad":
        return []
    path, settings = overview.recordings.path, overview.settings
    presets = [f"$(tactile-viewgcn preset {note.value})" for note in settings if note.key == "preset"]
    form = overview.form
    if form.shape == FRAMES_LAST:
        shape: Any = FRAMES_LAST
    else:
        shape = list(overview.recordings.shape) if arrays_below(path) else "auto"
    values = {  # all of `data`: params.yaml may be set for other recordings
        "data.source": str(everywhere(path)),
        "data.shape": shape,
        "data.layout": form.layout,
        "data.columns": [f"{kind}:{name}" for kind, name in form.columns.items()],
    }
    values |= {note.key: note.value for note in settings if not note.key.startswith(("preset", "preprocess."))}
    options = [f"  -S {shlex.quote(as_change(key, value))}" for key, value in values.items()]
    return " \\\n".join([" ".join(["dvc exp run", *presets]), *options]).split("\n")


def _kept(overview: Overview) -> list[str]:
    """Names of the objects of which `preprocess` keeps frames; it keeps those of the empty hand too."""
    kind = {"flags": "flagged", "contact": "in contact"}.get(overview.choice.params.filter, "frames")
    kept, objects = overview.label[overview.counts[kind] > 0], overview.recordings.objects
    return [
        name for label, name in enumerate(objects) if label in kept or (name == EMPTY_HAND and label in overview.label)
    ]


def _names(overview: Overview, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    names = [overview.recordings.objects[label] for label in np.unique(overview.label) if chosen[label]]
    return listed([name for name in names if name != EMPTY_HAND])


def _wrapped(texts: Iterable[str]) -> list[str]:
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    return [line for text in texts for line in wrapper.wrap(text)]


def _aligned(table: Table) -> list[str]:
    """Header and rows, the first column to the left and the others to the right."""
    names, *columns = zip(table.header, *table.rows, strict=True)
    names = tuple(name if len(name) <= NAME else f"{name[: NAME - 1]}…" for name in names)
    padded = [[name.ljust(max(map(len, names))) for name in names]]
    padded += [[cell.rjust(max(map(len, column))) for cell in column] for column in columns]
    return ["  ".join(["", *row]) for row in zip(*padded, strict=True)]
