"""The page of an inspection: whether the recordings can be used, the settings that fit them, and pictures of both."""

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn import plots
from tactile_viewgcn.pages import html, inspection_text
from tactile_viewgcn.pages.source_inspection import Overview
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
        settings=overview.settings,
        warnings=warnings,
        tables=inspection_text.tables(overview),
        mean_frames=_mean_frames(overview),
        time_lines=_time_lines(overview),
    )


def _excess(overview: Overview, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts (n, S) above the baseline of the frames in an index (n,), and which of them are in contact."""
    recordings, baseline = overview.recordings, overview.choice.baseline
    excess = overview.states.counts[index] - baseline.mean[baseline.of_frame[index]][:, recordings.live]
    return excess, overview.states.contact[index] & ~recordings.empty_hand[index]


def _mean_frames(overview: Overview) -> Figure:
    """Mean frame of each object with frames in contact; an empty one where there is none."""
    recordings, label = overview.recordings, overview.label
    sums, number = np.zeros((len(recordings.objects), *recordings.shape)), np.zeros(len(recordings.objects))
    for of_object, index in zip(label, frames_by_recording(recordings), strict=True):
        excess, contact = _excess(overview, index)
        sums[of_object, recordings.live] += excess[contact].sum(axis=0)
        number[of_object] += contact.sum()
    drawn = np.flatnonzero(number)[:MOST_OBJECTS]
    frames, names = sums[drawn] / number[drawn, None, None], [recordings.objects[label] for label in drawn]
    if not len(drawn):
        frames, names = sums[:1], ["no contact"]
    return plots.mean_frames(frames, recordings.live, names, f"{overview.unit} above baseline", columns=5)


def _time_lines(overview: Overview) -> Figure:
    """The load of the first recording of each object over time."""
    rows = evenly(np.unique(overview.label, return_index=True)[1], MOST_LINES)
    recorded, lines, in_contact = frames_by_recording(overview.recordings), [], []
    for row in rows:
        excess, contact = _excess(overview, recorded[row])
        points = min(POINTS, len(contact))
        lines.append(np.array([part.mean() for part in np.array_split(excess.mean(axis=1), points)]))
        in_contact.append(np.array([part.mean() for part in np.array_split(contact, points)]))
    names = [overview.recordings.objects[overview.label[row]] for row in rows]
    return plots.time_lines(lines, in_contact, overview.seconds[rows].tolist(), names)
