"""An inspection as text of 80 columns, which ends with the command to use and the reason of each setting."""

import shlex
import textwrap
from collections.abc import Iterable

import numpy as np

from tactile_viewgcn.frames.automatic import Recommendation
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.leak import Leak
from tactile_viewgcn.frames.readings import SATURATED
from tactile_viewgcn.readers.source import EMPTY_HAND, listed
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.recordings import is_table

WIDTH = 80
NAME = 24  # letters of an object's or session's name


def inspection_lines(seen: Inspection, chosen: list[Recommendation]) -> list[str]:
    """The inspection, and what to set: `chosen` is what `recommend` returns."""
    parts = [
        (f"{seen.path}{', written by ingest' if is_table(seen.path) else ''}", _what(seen)),
        ("Sampling", [_sampling(seen)]),
        ("Readings", _readings(seen)),
        ("Sessions", _sessions(seen)),
        ("Objects", _objects(seen)),
        ("Without contact", _leaks(seen)),
        ("To use", [str(one) for one in chosen]),
    ]
    lines = []
    for title, texts in parts:
        lines.append(title)
        for text in texts:
            lines += (
                textwrap.wrap(text, WIDTH, initial_indent="  ", subsequent_indent="    ")
                if " | " not in text
                else [text]
            )
    return [*(line.replace(" | ", "  ") for line in lines), "", *command_lines(seen, chosen)]


def command_lines(seen: Inspection, chosen: list[Recommendation]) -> list[str]:
    """The command `dvc exp run` with these settings, in lines of a shell that go on after a backslash."""
    words = ["dvc exp run"]
    words += [f"$(tactile-viewgcn preset {one.value})" for one in chosen if one.key == "preset"]
    changes = [] if is_table(seen.path) else [as_change("data.source", str(seen.path))]
    changes += [as_change(one.key, one.value) for one in chosen if one.key != "preset"]
    lines = [" ".join(words)]
    for change in changes:
        word = f"-S {shlex.quote(change)}"
        if len(lines[-1]) + len(word) + 3 <= WIDTH:
            lines[-1] += f" {word}"
        else:
            lines[-1] += " \\"
            lines.append(f"  {word}")
    return lines


def _what(seen: Inspection) -> list[str]:
    height, width = seen.shape
    columns = ", ".join(seen.columns) or "none"
    frames = f"{seen.frames.sum():,} frames of {height} x {width}, kept as {seen.dtype}"
    objects, sessions = len(np.unique(seen.label)), len(np.unique(seen.session))
    return [
        f"{frames}; {len(seen.frames)} recordings, {objects} objects, {sessions} sessions",
        f"optional columns: {columns}",
    ]


def _sampling(seen: Inspection) -> str:
    low, middle, high = np.percentile(seen.frames, [0, 50, 100])
    spread = f"{low:g} to {high:g} frames a recording, {middle:g} in the middle"
    frames = spread if low < high else f"{low:g} frames a recording"
    if seen.interval is None:
        return f"no times; {frames}"
    gaps = "no gaps" if not seen.gaps else f"{seen.gaps} gaps of more than 2.5 intervals"
    return f"{1 / seen.interval:.4g} Hz, {gaps}; {frames}, {np.median(seen.seconds):.3g} s"


def _readings(seen: Inspection) -> list[str]:
    told, live = seen.readings, int(seen.live.sum())
    names = ("smallest", "1 %", "median", "99 %", "largest")
    values = ", ".join(f"{name} {value:.4g}" for name, value in zip(names, told.percentiles, strict=True))
    above = ", ".join(f"{name} {value:.3g}" for name, value in zip(names[1:], told.above[1:], strict=True))
    pressed = f"{100 * told.pressed_share:.1f} % of the readings in held frames are of pressed sensors"
    saturated = int((told.saturated > SATURATED).sum())
    return [
        f"all: {values}",
        f"of pressed sensors, above the baseline: {above}"
        if not np.isnan(told.above).any()
        else "no sensor is pressed",
        f"{pressed}; {seen.contact_sensors} pressed sensors or more are contact",
        f"{live} of {seen.live.size} sensors vary; {int(told.stuck.sum())} hardly do; {saturated} are at the largest "
        f"reading in more than {100 * SATURATED:g} % of the frames",
    ]


def _sessions(seen: Inspection) -> list[str]:
    rows = [("", "recordings", "empty hand", "noise", "drift, of noise")]
    for number in np.unique(seen.session):
        member = seen.session == number
        drift = seen.drift[member & np.isfinite(seen.drift)]
        noise = float(np.median(seen.noise[number][seen.live]))
        told = f"{np.median(drift):.2g}, at most {drift.max():.2g}" if len(drift) else "-"
        rows.append((seen.sessions[number], f"{member.sum()}", f"{seen.empty[number]:,}", f"{noise:.3g}", told))
    return _table(rows)


def _objects(seen: Inspection) -> list[str]:
    columns = {"frames": seen.frames, "contact": seen.contact, "open hand": seen.open}
    if seen.flagged is not None:
        columns["flagged"] = seen.flagged
    rows: list[tuple[str, ...]] = [("", "recordings", *columns)]
    for number in np.unique(seen.label):
        of = seen.label == number
        rows.append((seen.objects[number], f"{of.sum()}", *(f"{count[of].sum():,}" for count in columns.values())))
    held = np.array(seen.objects)[seen.label] != EMPTY_HAND
    without = [name for name, count in zip(seen.recordings, seen.contact + ~held, strict=True) if not count]
    told = [f"{len(without)} recordings without a frame in contact: {listed(without)}"] if without else []
    return _table(rows) + told


def _leaks(seen: Inspection) -> list[str]:
    lines = []
    if seen.all_contact:
        lines.append("even the quietest frames are in contact: there is no open hand to compare with")
    for kind, leak in seen.leaks.items():
        told = "tell the object, which is a leak" if leak.found else "do not tell the object"
        lines.append(f"open-hand frames above the baseline {kind} {told}: {_error(leak)}")
    if seen.first_frame:
        told = "tells the object" if seen.first_frame.found else "does not tell the object"
        told += ", a leak if nothing is held yet" if seen.first_frame.found and not seen.all_contact else ""
        lines.append(f"the first frame of a recording alone {told}: {_error(seen.first_frame)}")
    return lines or ["no open-hand frames of objects with two recordings: leaks are not checked"]


def _error(leak: Leak) -> str:
    interval = f"{100 * leak.low:.0f} to {100 * leak.high:.0f}"
    return f"error {100 * leak.error:.0f} % ({interval}), chance {100 * leak.chance:.0f} %"


def _table(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Rows with the first column to the left and the others to the right, cells divided by " | "."""
    rows = [(name if len(name) <= NAME else f"{name[: NAME - 1]}…", *cells) for name, *cells in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  "
        + " | ".join(
            [name.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))]
        )
        for name, *cells in rows
    ]
