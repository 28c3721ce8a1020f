"""What an inspection says, on a terminal and on its page alike: facts, tables, warnings, a verdict and a command."""

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import ARRAYS, files_below
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.frames.selection import one_class
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import Note, several
from tactile_viewgcn.pages.html import Verdict
from tactile_viewgcn.pages.source_inspection import GAP, SATURATED, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.readers.source import MAX_SIDE, listed
from tactile_viewgcn.schema import as_change

MANY_GAPS = 0.01  # of the frames
_LARGEST = f"at the largest reading in more than {100 * SATURATED:g} % of the frames"
TWICE = "Record each object at least twice, better five times in two sessions."


@dataclass(frozen=True)
class Table:
    """Rows of text under a header; their first column is a name, the others are numbers."""

    title: str
    remark: str
    header: list[str]
    rows: list[list[str]]


def facts(overview: Overview) -> list[tuple[str, str]]:
    """A figure each, and what it is of."""
    of, (height, width), columns = overview.inspection, overview.shape, overview.columns
    objects, sessions = several(len(np.unique(of.label)), "object"), several(len(np.unique(of.session)), "session")
    low, middle, high = np.percentile(of.frames, [0, 50, 100])
    lengths = f"{low:g} to {high:g} frames, median {middle:g}" if low < high else f"{several(int(low), 'frame')} each"
    pressed = "all are, even the quietest" if of.all_contact else f"{of.hand.sensors} or more sensors are pressed"
    rate, times = "no", "times of the frames"
    if overview.interval:
        gaps = f"{several(overview.gaps, 'gap')} of more than {GAP} intervals"
        rate = f"{1 / overview.interval:.4g} Hz"
        times = f"is the frame rate; {gaps}, {np.median(overview.seconds):.3g} s a recording"
    rows = [
        (
            f"{of.frames.sum():,}",
            f"{'frame' if of.frames.sum() == 1 else 'frames'} of {height} x {width}, kept as {overview.dtype}",
        ),
        (
            f"{len(of.frames):,}",
            f"{'recording' if len(of.frames) == 1 else 'recordings'} of {objects} in {sessions}: {lengths}",
        ),
        (f"{100 * of.contact.sum() / of.frames.sum():.0f} %", f"of the frames are in contact: {pressed}"),
        (
            f"{of.live.sum()} of {of.live.size}",
            f"sensors vary; hardly: {overview.stuck.sum()}, {_LARGEST}: {(overview.saturated > SATURATED).sum()}",
        ),
        (rate, times),
    ]
    if columns:
        rows.append(
            (f"{len(columns)}", f"optional {'column' if len(columns) == 1 else 'columns'}: {', '.join(columns)}")
        )
    alike = low == high and 1 < high <= MAX_SIDE
    if height == 1 and alike and files_below(overview.path, ARRAYS):  # files of one frame each would look like this
        rows.append((f"{high:g} x {width}", f"cells in each file: if that is one frame, --shape {high:g} {width}"))
    if low == high == height != width and height > 1 and files_below(overview.path, ARRAYS):
        text = "in each file, taken as frames, rows, columns; where frames come last: np.moveaxis(array, -1, 0)"
        rows.append((f"{high:g} x {height} x {width}", text))
    return rows


def tables(overview: Overview, chosen: list[Note]) -> list[Table]:
    """Objects, sessions, readings, and what was measured of baselines and filters; `chosen` ones are marked."""
    all_tables = (_objects(overview.inspection), _sessions(overview), _readings(overview), _measured(overview, chosen))
    return [table for table in all_tables if table.rows]


def _objects(of: Inspection) -> Table:
    columns = {"recordings": np.ones_like(of.frames), "frames": of.frames, "in contact": of.contact}
    columns |= {"open hand": of.open} | ({} if of.flagged is None else {"flagged": of.flagged})
    rows = [
        [of.objects[label], *(f"{count[of.label == label].sum():,}" for count in columns.values())]
        for label in np.unique(of.label)
    ]
    flagged = "" if of.flagged is None else "; flagged is what the recordings say"
    return Table("Objects", f"Frames of each kind{flagged}.", ["object", *columns], rows)


def _sessions(overview: Overview) -> Table:
    of, rows = overview.inspection, []
    for number in np.unique(of.session):
        drift = overview.drift[of.session == number]
        known = drift[np.isfinite(drift)]
        drifts = f"{np.median(known):.2g}, at most {known.max():.2g}" if len(known) else "-"
        noise = f"{np.median(of.hand.noise[number]):.3g}"
        rows.append([overview.sessions[number], f"{len(drift):,}", f"{of.empty[number]:,}", noise, drifts])
    remark = (
        "Frames of the empty hand; noise of the median sensor, in counts; drift of the open hand in the median "
        "recording, in standard deviations of noise."
    )
    return Table("Sessions", remark, ["session", "recordings", "empty hand", "noise", "drift"], rows)


def _readings(overview: Overview) -> Table:
    above = ["" if np.isnan(value) else f"{value:.4g}" for value in overview.above]
    return Table(
        "Readings",
        "The second row is of sensors in contact. 1 % of the readings are less than what stands under 1 %.",
        ["counts", "least", "1 %", "median", "99 %", "most"],
        [["all", *(f"{value:.4g}" for value in overview.percentiles)], ["above the baseline", *above]],
    )


def _measured(overview: Overview, chosen: list[Note]) -> Table:
    measured, rows = overview.measurement, []
    if measured:
        taken = _chosen(chosen, "preprocess.baseline"), _chosen(chosen, "preprocess.filter")
        for kind, error in measured.baselines.items():
            rows.append([f"{kind}{' *' * (kind == taken[0])}", *_errors(error, measured.leaks.get(kind))])
        for kind, error in measured.filters.items():
            rows.append([f"filter {kind}{' *' * (kind == taken[1])}", *_errors(error, None)])
    if overview.first_frame:
        rows.append(["first frame", *_errors(None, overview.first_frame)])
    remark = (
        "Errors of a quick classifier on held-out groups, with a standard error: of contact above each baseline, and "
        "with each filter above the one marked *, which is taken; and of open-hand frames, or of the first frame of a "
        "recording alone, where nothing is held yet: if these tell the object it is a leak. All recordings were used "
        f"here, by split.by {_chosen(chosen, 'split.by')}; preprocess measures again, on its training side "
        "alone, and may choose another baseline or filter."
    )
    return Table("Baseline and filter", remark, ["", "error, %", "without contact, %", "chance", "leaks"], rows)


def _errors(error: QuickError | None, leak: QuickError | None) -> list[str]:
    """The cells of an error, and of one without contact."""
    cells = [f"{100 * error.error:.1f} ± {100 * error.standard_error:.1f}" if error else "", "", "", ""]
    if leak:
        interval = percent_interval(leak.error, leak.low, leak.high)
        cells[1:] = [interval, f"{100 * leak.chance:.1f}", "yes" if leak.tells_object else "no"]
    return cells


def warnings(overview: Overview, chosen: list[Note]) -> list[str]:
    """What may spoil a result with the settings that are recommended, each with what to do about it."""
    of, by = overview.inspection, _chosen(chosen, "split.by")
    baseline = _chosen(chosen, "preprocess.baseline")
    leaks_of, first_frame = overview.measurement.leaks if overview.measurement else {}, overview.first_frame
    leak = leaks_of.get(baseline)
    leaks = leak is not None and leak.tells_object
    first_leaks = first_frame is not None and first_frame.tells_object
    quick = overview.measurement.baselines.get(baseline) if overview.measurement else None
    at_chance = quick is not None and not quick.tells_object
    untouched = _names(of, np.bincount(of.label, of.contact, len(of.objects)) == 0)
    once = _names(of, _groups(of, by) == 1)
    stuck, saturated = int(overview.stuck.sum()), int((overview.saturated > SATURATED).sum())
    cases = {
        f"Never in contact: {untouched}. Record these objects again, held firmly.": untouched,
        f"Frames of the open hand tell the object, also above the baseline {baseline}: errors will say less about "
        "touch than they seem to. Record each object in several sessions, in another order in each.": leaks,
        "The first frame of a recording, before anything is held, already tells the object: errors will say less about "
        "touch than they seem to. Record the objects in another order in each session.": first_leaks,
        "A quick classifier may tell the objects no better than guessing. Record more of each, held firmly.": at_chance,
        f"{'Grasped' if by == 'grasp' else 'Recorded'} once: {once}. Nothing is left to test with. {TWICE}": once,
        f"Frames are missing at {several(overview.gaps, 'place')}. Look at the cable, and at the program that "
        "records.": overview.gaps > MANY_GAPS * of.frames.sum(),
        f"{several(stuck, 'sensor')} hardly {'varies' if stuck == 1 else 'vary'}. Check their wiring.": stuck,
        f"{several(saturated, 'sensor')} {'is' if saturated == 1 else 'are'} {_LARGEST}. Lower the gain of the "
        "electronics, or grip less.": saturated,
    }
    return [text for text, applies in cases.items() if applies]


def verdict(overview: Overview, chosen: list[Note], warned: list[str]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    by = _chosen(chosen, "split.by")
    of, groups = overview.inspection, _groups(overview.inspection, by)
    if len(np.unique(of.label)) == 1:
        return Verdict("bad", f"Not yet: {one_class(of.objects[of.label[0]])}.", [])
    if (groups > 1).sum() < 2:
        return Verdict("bad", f"Not yet: there are no two objects with two recordings each. {TWICE}", [])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    leaks = overview.measurement.leaks if overview.measurement else {}
    leak = leaks.get(_chosen(chosen, "preprocess.baseline"))
    if leak and not leak.tells_object:
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warned:
        return Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", reasons)
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def command_lines(overview: Overview, chosen: list[Note]) -> list[str]:
    """The command `dvc exp run` with these settings, in lines of a shell that go on after a backslash.

    None for recordings of one class, which no setting makes usable.

    What `auto` decides is left to it: `preprocess` does not look at the test side for that.
    """
    if len(np.unique(overview.inspection.label)) == 1:
        return []
    presets = [f"$(tactile-viewgcn preset {note.value})" for note in chosen if note.key == "preset"]
    changes = [as_change("data.source", _source(overview.path))]
    if files_below(overview.path, ARRAYS):
        changes.append(as_change("data.shape", list(overview.shape)))
    changes += [
        as_change(note.key, note.value) for note in chosen if not note.key.startswith(("preset", "preprocess."))
    ]
    lines = [" ".join(["dvc exp run", *presets]), *(f"  -S {shlex.quote(change)}" for change in changes)]
    return " \\\n".join(lines).split("\n")


def _source(path: Path) -> str:
    """A path that a queued experiment finds too, from a temporary folder of what git and DVC track; else as typed."""
    place = path.absolute()
    tracked = place.with_name(f"{place.name}.dvc").exists()
    return str(path if path == Path(VIRTUAL) or tracked else place)


def _chosen(chosen: list[Note], key: str) -> str:
    return next(str(note.value) for note in chosen if note.key == key)


def _names(of: Inspection, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    return listed([of.objects[i] for i in np.unique(of.label) if chosen[i] and of.objects[i] != EMPTY_HAND])


def _groups(of: Inspection, by: str) -> np.ndarray:
    """How many groups of the recommended split each object has, (O,); recordings where single frames are held out."""
    return of.groups["recording" if by == "frame" else by]
