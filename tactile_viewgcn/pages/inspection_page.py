"""The page of an inspection: whether the recordings can be used, the settings that fit them, and mean frames."""

import numpy as np
from matplotlib.figure import Figure

from tactile_viewgcn import plots
from tactile_viewgcn.pages import html, inspection_text
from tactile_viewgcn.pages.source_inspection import SAMPLE, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.tables.counts import evenly

MOST_OBJECTS = 48  # whose mean frames are drawn


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
