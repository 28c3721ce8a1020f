"""The page of an inspection: whether the recordings can be used, the settings that fit them, and pictures of both."""

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn import plots
from tactile_viewgcn.pages import html, inspection_text
from tactile_viewgcn.pages.source_inspection import SAMPLE, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import frames_by_recording

MOST_LINES = 12  # recordings whose time lines are drawn
MOST_OBJECTS = 48  # whose mean frames are drawn
POINTS = 100  # of a time line, at most


def inspection_page(overview: Overview) -> str:
    """The page as HTML."""
    path, warnings = overview.recordings.path, inspection_text.warnings(overview)
    return html.render(
        "inspection.html",
        title=f"Recordings: {path.name}",
        path=path,
        simulated=str(path) == VIRTUAL,
        verdict=inspection_text.verdict(overview, warnings),
        facts=inspection_text.facts(overview),
        command="\n".join(inspection_text.command_lines(overview)),
        of_sessions="\n".join(inspection_text.command_lines(overview, new_sessions=True)),
        settings=overview.settings,
        warnings=warnings,
        remarks=[note for note in overview.remarks if note.level == "info"],
        tables=inspection_text.tables(overview),
        mean_frames=_mean_frames(overview),
        time_lines=_time_lines(overview),
    )


def _mean_frames(overview: Overview) -> Figure:
    """Mean frame of each object with frames in contact; an empty one where there is none."""
    recordings, label = overview.recordings, overview.recordings.columns["object"]
    drawn = np.unique(label[overview.in_contact])[:MOST_OBJECTS]
    frames = np.zeros((max(1, len(drawn)), *recordings.shape))
    for frame, one in zip(frames, drawn, strict=False):
        sample = evenly(np.flatnonzero(overview.in_contact & (label == one)), SAMPLE)
        frame[recordings.live] = overview.excess(sample).mean(axis=0)
    names = [recordings.objects[one] for one in drawn] or ["no contact"]
    return plots.mean_frames(frames, recordings.live, names, f"{overview.unit} above baseline")


def _time_lines(overview: Overview) -> Figure:
    """The load of the first recording of each object over time."""
    rows = evenly(np.unique(overview.label, return_index=True)[1], MOST_LINES)
    recorded, lines, in_contact = frames_by_recording(overview.recordings), [], []
    for index in (recorded[row] for row in rows):
        load, contact, points = overview.excess(index).mean(axis=1), overview.in_contact[index], min(POINTS, len(index))
        lines.append(np.array([part.mean() for part in np.array_split(load, points)]))
        in_contact.append(np.array([part.mean() for part in np.array_split(contact, points)]))
    names = [overview.recordings.objects[overview.label[row]] for row in rows]
    return plots.time_lines(lines, in_contact, overview.seconds[rows].tolist(), names)
