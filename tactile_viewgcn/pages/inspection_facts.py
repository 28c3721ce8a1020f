"""What an inspection says, on a terminal and on its page alike: facts, tables, warnings, a verdict and a command."""

import shlex
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.files import ARRAYS, files_below
from tactile_viewgcn.frames.preprocessing import one_class
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.notes import several
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
    of, (height, width), columns = overview, overview.shape, overview.columns
    objects, sessions = several(len(np.unique(of.label)), "object"), several(len(np.unique(of.session)), "session")
    low, middle, high = np.percentile(of.frames, [0, 50, 100])
    lengths = f"{low:g} to {high:g} frames, median {middle:g}" if low < high else f"{several(int(low), 'frame')} each"
    pressed = "all are, even the quietest" if of.hand.all_contact else f"{of.hand.sensors} or more sensors are pressed"
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


def tables(overview: Overview) -> list[Table]:
    """Objects, sessions, readings, and what was measured of baselines; the chosen one is marked."""
    all_tables = (_objects(overview), _sessions(overview), _readings(overview), _measured(overview))
    return [table for table in all_tables if table.rows]


def _objects(of: Overview) -> Table:
    columns = {"recordings": np.ones_like(of.frames), "frames": of.frames, "in contact": of.contact}
    columns |= {"open hand": of.open} | ({} if of.flagged is None else {"flagged": of.flagged})
    rows = [
        [of.objects[label], *(f"{count[of.label == label].sum():,}" for count in columns.values())]
        for label in np.unique(of.label)
    ]
    flagged = "" if of.flagged is None else "; flagged is what the recordings say"
    return Table("Objects", f"Frames of each kind{flagged}.", ["object", *columns], rows)


def _sessions(overview: Overview) -> Table:
    of, rows = overview, []
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


def _measured(overview: Overview) -> Table:
    choice, rows = overview.choice, []
    for kind, error in choice.errors.items():
        taken = " *" * (kind == choice.params.baseline)
        rows.append([f"{kind}{taken}", *_errors(error, choice.leaks.get(kind))])
    if overview.error or overview.leak:
        rows.append(["all recordings", *_errors(overview.error, overview.leak)])
    if overview.first_frame:
        rows.append(["first frame", *_errors(None, overview.first_frame)])
    by = overview.setting("split.by")
    remark = (
        "Errors of a quick classifier on held-out groups, with a standard error. Without contact: on frames of the "
        "open hand, or on the first frame of a recording; an error below chance there is a leak. All recordings: of "
        "both sides, above the baseline that is taken."
    )
    if choice.errors:
        remark += f" The one marked * was chosen on the training side of split.by {by} alone, as preprocess does."
    return Table("Baseline", remark, ["", "error, %", "without contact, %", "chance", "leaks"], rows)


def _errors(error: QuickError | None, leak: QuickError | None) -> list[str]:
    """The cells of an error, and of one without contact."""
    cells = [f"{100 * error.error:.1f} ± {100 * error.standard_error:.1f}" if error else "", "", "", ""]
    if leak:
        interval = percent_interval(leak.error, leak.low, leak.high)
        cells[1:] = [interval, f"{100 * leak.chance:.1f}", "yes" if leak.tells_object else "no"]
    return cells


def warnings(overview: Overview) -> list[str]:
    """What may spoil a result with the settings that are recommended, each with what to do about it."""
    of, by, baseline = overview, overview.setting("split.by"), overview.choice.params.baseline
    leaks = overview.leak is not None and overview.leak.tells_object
    first_leaks = overview.first_frame is not None and overview.first_frame.tells_object
    at_chance = overview.error is not None and not overview.error.tells_object
    untouched = _names(of, np.bincount(of.label, of.contact, len(of.objects)) == 0)
    once = _names(of, _groups(of, by) == 1)
    stuck, saturated = int(overview.stuck.sum()), int((overview.saturated > SATURATED).sum())
    cases = {
        f"Never in contact: {untouched}. Record these objects again, held firmly.": untouched,
        f"The object can be recognised before it is touched (baseline {baseline}): errors will say less about touch "
        "than they seem to. Record each object in several sessions, in another order in each.": leaks,
        "The first frame of a recording, before anything is held, already predicts the object: errors will say less "
        "about touch than they seem to. Record the objects in another order in each session.": first_leaks,
        "A quick classifier predicts the objects no better than guessing. Record more of each, held firmly.": at_chance,
        f"{'Grasped' if by == 'grasp' else 'Recorded'} once: {once}. Nothing is left to test with. {TWICE}": once,
        f"Frames are missing at {several(overview.gaps, 'place')}. Look at the cable, and at the program that "
        "records.": overview.gaps > MANY_GAPS * of.frames.sum(),
        f"{several(stuck, 'sensor')} hardly {'varies' if stuck == 1 else 'vary'}. Check their wiring.": stuck,
        f"{several(saturated, 'sensor')} {'is' if saturated == 1 else 'are'} {_LARGEST}. Lower the gain of the "
        "electronics, or grip less.": saturated,
    }
    return [text for text, applies in cases.items() if applies]


def verdict(overview: Overview, warned: list[str]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    of, by = overview, overview.setting("split.by")
    groups = _groups(of, by)
    if len(np.unique(of.label)) == 1:
        return Verdict("bad", f"Not yet: {one_class(of.objects[of.label[0]])}.", [])
    if (groups > 1).sum() < 2:
        return Verdict("bad", f"Not yet: there are no two objects with two recordings each. {TWICE}", [])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    if of.leak and not of.leak.tells_object:
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warned:
        return Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", reasons)
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def command_lines(overview: Overview) -> list[str]:
    """The command `dvc exp run` with these settings, in lines of a shell that go on after a backslash.

    None for recordings of one class, which no setting makes usable.

    What `auto` decides is left to it: `preprocess` does not look at the test side for that.
    """
    if len(np.unique(overview.label)) == 1:
        return []
    chosen = overview.settings
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


def _names(of: Overview, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    return listed([of.objects[i] for i in np.unique(of.label) if chosen[i] and of.objects[i] != EMPTY_HAND])


def _groups(of: Overview, by: str) -> np.ndarray:
    """How many groups of the recommended split each object has, (O,); recordings where single frames are held out."""
    return of.groups["recording" if by == "frame" else by]
