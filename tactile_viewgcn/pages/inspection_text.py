"""An inspection as text of 80 columns, which ends with the command to use and the reason of each setting."""

import shlex
import textwrap
from collections.abc import Iterable

import numpy as np

from tactile_viewgcn.frames.leak import Leak
from tactile_viewgcn.notes import Note
from tactile_viewgcn.pages.source_inspection import SATURATED, Overview
from tactile_viewgcn.readers.source import listed
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.recordings import is_table

WIDTH = 80
NAME = 24  # letters of an object's or session's name


def inspection_lines(overview: Overview, chosen: list[Note]) -> list[str]:
    """The inspection, and what to set: `chosen` is what `recommend` returns."""
    lines = [f"{overview.path}{', written by ingest' if is_table(overview.path) else ''}", *_wrapped(_what(overview))]
    lines += ["Readings", *_wrapped(_readings(overview)), "Sessions", *_sessions(overview)]
    lines += ["Objects", *_objects(overview), "Without contact", *_wrapped(_leaks(overview))]
    return [*lines, "To use", *_wrapped(map(str, chosen)), "", *command_lines(overview, chosen)]


def command_lines(overview: Overview, chosen: list[Note]) -> list[str]:
    """The command `dvc exp run` with these settings, in lines of a shell that go on after a backslash."""
    presets = [f"$(tactile-viewgcn preset {note.value})" for note in chosen if note.key == "preset"]
    changes = [] if is_table(overview.path) else [as_change("data.source", str(overview.path))]
    changes += [as_change(note.key, note.value) for note in chosen if note.key != "preset"]
    lines = [" ".join(["dvc exp run", *presets])]
    for change in changes:
        word = f"-S {shlex.quote(change)}"
        if len(lines[-1]) + len(word) + 3 <= WIDTH:
            lines[-1] += f" {word}"
        else:
            lines[-1] += " \\"
            lines.append(f"  {word}")
    return lines


def _what(overview: Overview) -> list[str]:
    of, (height, width) = overview.inspection, overview.shape
    frames = f"{of.frames.sum():,} frames of {height} x {width}, kept as {overview.dtype}"
    objects, sessions = len(np.unique(of.label)), len(np.unique(of.session))
    low, middle, high = np.percentile(of.frames, [0, 50, 100])
    lengths = f"{low:g} to {high:g} frames a recording, {middle:g} in the middle"
    rate = "no times"
    if overview.interval is not None:
        gaps = f"{overview.gaps or 'no'} gaps of more than 2.5 intervals"
        rate = f"{1 / overview.interval:.4g} Hz, {gaps}; {np.median(overview.seconds):.3g} s a recording"
    return [
        f"{frames}; {len(of.frames)} recordings, {objects} objects, {sessions} sessions",
        f"{rate}; {lengths}",
        f"optional columns: {', '.join(overview.columns) or 'none'}",
    ]


def _readings(overview: Overview) -> list[str]:
    of, names = overview.inspection, ("smallest", "1 %", "median", "99 %", "largest")
    values = ", ".join(f"{name} {value:.4g}" for name, value in zip(names, overview.percentiles, strict=True))
    above = ", ".join(f"{name} {value:.3g}" for name, value in zip(names[1:], overview.above[1:], strict=True))
    pressed = f"of pressed sensors, above the baseline: {above}"
    share = f"{100 * overview.pressed_share:.1f} % of the readings in frames in contact are of pressed sensors"
    saturated = int((overview.saturated > SATURATED).sum())
    return [
        f"all: {values}",
        "no sensor is pressed" if np.isnan(overview.above).any() else pressed,
        f"{share}; {of.contact_sensors} pressed sensors or more are contact",
        f"{of.live.sum()} of {of.live.size} sensors vary; {overview.stuck.sum()} hardly do; {saturated} are at the "
        f"largest reading in more than {100 * SATURATED:g} % of the frames",
    ]


def _sessions(overview: Overview) -> list[str]:
    rows = [("", "recordings", "empty hand", "noise", "drift, of noise")]
    for name, recordings, empty, noise, drift in overview.session_rows():
        drifts = f"{np.median(drift):.2g}, at most {drift.max():.2g}" if len(drift) else "-"
        rows.append((name, f"{recordings}", f"{empty:,}", f"{noise:.3g}", drifts))
    return _table(rows)


def _objects(overview: Overview) -> list[str]:
    of, objects = overview.inspection, overview.object_rows()
    rows = [("", *objects[0][1]), *((name, *(f"{count:,}" for count in row.values())) for name, row in objects)]
    untouched = of.has_object & (of.contact == 0)
    without = [name for name, is_without in zip(overview.recordings, untouched, strict=True) if is_without]
    text = [f"{len(without)} recordings without a frame in contact: {listed(without)}"] if without else []
    return [*_table(rows), *_wrapped(text)]


def _leaks(overview: Overview) -> list[str]:
    lines, all_contact = [], overview.inspection.all_contact
    if all_contact:
        lines.append("even the quietest frames are in contact: there is no open hand to compare with")
    for kind, leak in overview.leaks.items():
        answer = "tell the object, which is a leak" if leak.tells_object else "do not tell the object"
        lines.append(f"open-hand frames above the baseline {kind} {answer}: {_error(leak)}")
    if first := overview.first_frame:
        doubt = "" if all_contact else ", a leak if nothing is held yet"
        answer = f"tells the object{doubt}" if first.tells_object else "does not tell the object"
        lines.append(f"the first frame of a recording alone {answer}: {_error(first)}")
    return lines or ["no open-hand frames of objects with two recordings: leaks are not checked"]


def _error(leak: Leak) -> str:
    interval = f"{100 * leak.low:.0f} to {100 * leak.high:.0f}"
    return f"error {100 * leak.error:.0f} % ({interval}), chance {100 * leak.chance:.0f} %"


def _wrapped(texts: Iterable[str]) -> list[str]:
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    return [line for text in texts for line in wrapper.wrap(text)]


def _table(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Rows with the first column to the left and the others to the right."""
    rows = [(name if len(name) <= NAME else f"{name[: NAME - 1]}…", *cells) for name, *cells in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            ["", name.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))]
        )
        for name, *cells in rows
    ]
