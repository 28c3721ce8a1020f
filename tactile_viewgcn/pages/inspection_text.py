"""What an inspection says, on a page and as text of 80 columns: facts, tables, warnings, a verdict and a command."""

import shlex
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.files import ARRAYS, files_below
from tactile_viewgcn.frames.preprocessing import one_class
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.pages.html import Verdict
from tactile_viewgcn.pages.source_inspection import GAP, SATURATED, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.readers.source import MAX_SIDE, listed
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
    lines = [str(overview.recordings.path), *_wrapped(f"{figure} {what}" for figure, what in facts(overview))]
    for table in tables(overview):
        lines += [table.title, *_aligned(table), *_wrapped([table.remark])]
    warned = warnings(overview)
    judged = verdict(overview, warned)
    answer = " ".join([judged.answer, *judged.reasons])
    lines += ["Can they be used?", *_wrapped([answer, *(note.text for note in warned)])]
    if command := command_lines(overview):
        lines.append("Until then, to try out the commands" if judged.kind == "bad" else "To use")
        lines += [*_wrapped(map(str, overview.settings)), "", *command]
    return lines


def facts(of: Overview) -> list[tuple[str, str]]:
    """A figure each, and what it is of."""
    table, (height, width), frames = of.recordings, of.recordings.shape, of.counts["frames"]
    objects, sessions = several(len(np.unique(of.label)), "object"), several(len(np.unique(of.session)), "session")
    low, middle, high = np.percentile(frames, [0, 50, 100])
    lengths = f"{low:g} to {high:g} frames, median {middle:g}" if low < high else f"{several(int(low), 'frame')} each"
    pressed = "all are, even the quietest" if of.hand.all_contact else f"{of.hand.sensors} or more sensors are pressed"
    rate, times = "no", "times of the frames"
    if of.interval:
        gaps = f"{several(of.gaps, 'gap')} of more than {GAP} intervals"
        rate = f"{1 / of.interval:.4g} Hz"
        times = f"is the frame rate; {gaps}, {np.median(of.seconds):.3g} s a recording"
    hardly = f"hardly: {of.stuck.sum()}, {LARGEST}: {of.saturated.sum()}"
    rows = [
        _counted(frames.sum(), "frame", f" of {height} x {width}, kept as {table.dtype}"),
        _counted(len(frames), "recording", f" of {objects} in {sessions}: {lengths}"),
        (f"{100 * of.counts['in contact'].sum() / frames.sum():.0f} %", f"of the frames are in contact: {pressed}"),
        (f"{table.live.sum()} of {table.live.size}", f"sensors vary; {hardly}"),
        (rate, times),
    ]
    if optional := [name for name in table.columns if name not in EVERY_SOURCE]:
        rows.append(_counted(len(optional), "optional column", f": {', '.join(optional)}"))
    if low == high and files_below(table.path, ARRAYS):  # the axes of an array may mean something else
        if height == 1 and 1 < high <= MAX_SIDE:
            text = f"cells in each file: if that is one frame, --shape {high:g} {width}"
            rows.append((f"{high:g} x {width}", text))
        if high == height != width and height > 1:
            text = "in each file, taken as frames, rows, columns; where frames come last: np.moveaxis(array, -1, 0)"
            rows.append((f"{high:g} x {height} x {width}", text))
    return rows


def _counted(count: int, thing: str, rest: str) -> tuple[str, str]:
    """A number of things as a figure and what it is of."""
    figure, _, things = several(count, thing).partition(" ")
    return figure, things + rest


def tables(of: Overview) -> list[Table]:
    """Objects, sessions, readings, and what was measured of baselines; the chosen one is marked."""
    flagged = "; flagged is what the recordings say" if "flagged" in of.counts else ""
    objects = [
        [of.recordings.objects[label], *(f"{count[of.label == label].sum():,}" for count in of.counts.values())]
        for label in np.unique(of.label)
    ]
    readings = [[name, *("" if np.isnan(x) else f"{x:.4g}" for x in values)] for name, values in of.readings.items()]
    every_table = [
        Table("Objects", f"Frames of each kind{flagged}.", ["object", *of.counts], objects),
        Table(
            "Sessions",
            "Frames of the empty hand; noise of the median sensor, in counts; drift of the open hand in the median "
            "recording, in standard deviations of noise.",
            ["session", "recordings", "empty hand", "noise", "drift"],
            [_session(of, number) for number in np.unique(of.session)],
        ),
        Table(
            "Readings",
            "The second row is of sensors in contact. 1 % of the readings are less than what stands under 1 %.",
            ["counts", "least", "1 %", "median", "99 %", "most"],
            readings,
        ),
        _measured(of),
    ]
    return [table for table in every_table if table.rows]


def _session(of: Overview, number: int) -> list[str]:
    drift = of.drift[of.session == number]
    finite = drift[np.isfinite(drift)]
    drifts = f"{np.median(finite):.2g}, at most {finite.max():.2g}" if len(finite) else "-"
    noise = f"{np.median(of.hand.noise[number]):.3g}"
    return [of.recordings.sessions[number], f"{len(drift):,}", f"{of.empty[number]:,}", noise, drifts]


def _measured(of: Overview) -> Table:
    errors, leaks, taken = of.choice.errors, of.choice.leaks, of.choice.params.baseline
    measured: dict[str, tuple[QuickError | None, QuickError | None]] = {
        kind + " *" * (kind == taken): (error, leaks.get(kind)) for kind, error in errors.items()
    }
    measured |= {"all recordings": (of.error, of.leak), "first frame": (None, of.first_frame)}
    remark = (
        "Errors of a quick classifier on held-out groups, with a standard error. Without contact: on frames of the "
        "open hand, or on the first frame of a recording; an error below chance there is a leak. All recordings: of "
        "both sides, above the baseline that is taken."
    )
    if errors:
        by = of.setting("split.by")
        remark += f" The one marked * was chosen on the training side of split.by {by} alone, as preprocess does."
    rows = [[name, *_errors(*pair)] for name, pair in measured.items() if any(pair)]
    return Table("Baseline", remark, ["", "error, %", "without contact, %", "chance, %", "leaks"], rows)


def _errors(error: QuickError | None, leak: QuickError | None) -> list[str]:
    """The cells of an error, and of one without contact."""
    cells = [f"{100 * error.error:.1f} ± {100 * error.standard_error:.1f}" if error else "", "", "", ""]
    if leak:
        interval = percent_interval(leak.error, leak.low, leak.high)
        cells[1:] = [interval, f"{100 * leak.chance:.1f}", "yes" if leak.beats_chance else "no"]
    return cells


def warnings(of: Overview) -> list[Note]:
    """What may spoil a result with the settings that are recommended, each with what to do about it."""
    by, notes = of.setting("split.by"), list[Note]()

    def warn(topic: str, text: str) -> None:
        notes.append(Note(text, "warning", topic))

    if names := _names(of, np.bincount(of.label, of.counts["in contact"], len(of.recordings.objects)) == 0):
        warn("contact", f"Never in contact: {names}. Record these objects again, held firmly.")
    if of.leak and of.leak.beats_chance:
        baseline = f"baseline {of.choice.params.baseline}"
        remedy = "Record each object in several sessions, in another order in each."
        warn("leak", f"The object can be recognised before it is touched ({baseline}): {LESS}. {remedy}")
    if of.first_frame and of.first_frame.beats_chance:
        leak = "The first frame of a recording, before anything is held, already predicts the object"
        warn("first frame", f"{leak}: {LESS}. Record the objects in another order in each session.")
    if of.error and not of.error.beats_chance:
        guessing = "A quick classifier predicts the objects no better than guessing."
        warn("error", f"{guessing} Record more of each, held firmly.")
    if names := _names(of, _groups(of, by) == 1):
        once = f"{'Grasped' if by == 'grasp' else 'Recorded'} once: {names}."
        warn("split", f"{once} Nothing is left to test with. {TWICE}")
    if of.gaps > MANY_GAPS * of.counts["frames"].sum():
        remedy = "Look at the cable, and at the program that records."
        warn("time", f"Frames are missing at {several(of.gaps, 'place')}. {remedy}")
    if number := int(of.stuck.sum()):
        warn("stuck", f"{several(number, 'sensor')} hardly {'varies' if number == 1 else 'vary'}. Check their wiring.")
    if number := int(of.saturated.sum()):
        sensors = f"{several(number, 'sensor')} {'is' if number == 1 else 'are'} {LARGEST}."
        warn("saturated", f"{sensors} Lower the gain of the electronics, or grip less.")
    return notes


def verdict(of: Overview, warned: list[Note]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    by = of.setting("split.by")
    groups = _groups(of, by)
    if len(np.unique(of.label)) == 1:
        return Verdict("bad", f"Not yet: {one_class(of.recordings.objects[of.label[0]])}.", [])
    if (groups > 1).sum() < 2:
        return Verdict("bad", f"Not yet: there are no two objects with two recordings each. {TWICE}", [])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    if of.leak and not of.leak.beats_chance:
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warned:
        return Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", reasons)
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def command_lines(of: Overview) -> list[str]:
    """The command `dvc exp run` with these settings, in lines of a shell that go on after a backslash.

    None for recordings of one class, which no setting makes usable.

    What `auto` decides is left to it: `preprocess` does not look at the test side for that.
    """
    if len(np.unique(of.label)) == 1:
        return []
    path, chosen = of.recordings.path, of.settings
    tracked = path == Path(VIRTUAL) or path.absolute().with_name(f"{path.name}.dvc").exists()
    source = path if tracked else path.absolute()  # a temporary folder holds what git and DVC track alone
    presets = [f"$(tactile-viewgcn preset {note.value})" for note in chosen if note.key == "preset"]
    changes = [as_change("data.source", str(source))]
    if files_below(path, ARRAYS):
        changes.append(as_change("data.shape", list(of.recordings.shape)))
    changes += [
        as_change(note.key, note.value) for note in chosen if not note.key.startswith(("preset", "preprocess."))
    ]
    lines = [" ".join(["dvc exp run", *presets]), *(f"  -S {shlex.quote(change)}" for change in changes)]
    return " \\\n".join(lines).split("\n")


def _names(of: Overview, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    names = [of.recordings.objects[label] for label in np.unique(of.label) if chosen[label]]
    return listed([name for name in names if name != EMPTY_HAND])


def _groups(of: Overview, by: str) -> np.ndarray:
    """How many groups of the recommended split each object has, (O,); recordings where single frames are held out."""
    return of.groups["recording" if by == "frame" else by]


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
