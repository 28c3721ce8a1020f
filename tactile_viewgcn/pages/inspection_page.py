"""The page of an inspection: whether the recordings can be used, the settings that fit them, and pictures of both."""

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.frames.baseline import evenly
from tactile_viewgcn.pages import html, inspection_facts
from tactile_viewgcn.pages.html import Picture, picture
from tactile_viewgcn.pages.source_inspection import SATURATED, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.schema import as_change

MOST_LINES = 12  # recordings whose time lines are drawn
MOST_OBJECTS = 48  # whose mean frames are drawn
STATES = ["varies", "does not vary", "hardly varies", "often at the largest reading"]


def inspection_page(overview: Overview) -> str:
    """The page as HTML."""
    warnings = inspection_facts.warnings(overview)
    noise = plots.mean_frames(overview.noise[None], overview.live, [""], "counts")
    return html.render(
        "inspection.html",
        title=f"Recordings: {overview.path.name}",
        path=overview.path,
        simulated=str(overview.path) == VIRTUAL,
        verdict=inspection_facts.verdict(overview, warnings),
        facts=inspection_facts.facts(overview),
        command="\n".join(inspection_facts.command_lines(overview)),
        settings=[(as_change(note.key, note.value), note.text) for note in overview.settings],
        warnings=warnings,
        tables=inspection_facts.tables(overview),
        pictures={
            "Objects": [_mean_frames(overview)],
            "Sessions": [_time_lines(overview)],
            "Readings": [
                _sensor_states(overview),
                picture(noise, "Noise of each sensor: how much it varies without contact."),
            ],
        },
    )


def _mean_frames(overview: Overview) -> Picture:
    """Mean frame of each object with frames in contact; an empty one where there is none."""
    of, means = overview, overview.mean_frame
    drawn = [label for label in np.unique(of.label) if np.isfinite(means[label][of.live]).all()][:MOST_OBJECTS]
    frames, names = (means[drawn], [of.objects[label] for label in drawn]) if drawn else (0 * means[:1], ["no contact"])
    figure = plots.mean_frames(frames, of.live, names, "counts above baseline", columns=5)
    return picture(
        figure,
        "Mean of the frames in contact. All objects have the same colours. Grey: no sensor, or one that does not vary. "
        "Objects that look alike here will be hard to tell apart.",
    )


def _time_lines(overview: Overview) -> Picture:
    """The load of the first recording of each object over time."""
    of = overview
    rows = evenly(np.unique(of.label, return_index=True)[1], MOST_LINES)
    figure = plots.time_lines(
        [overview.activity[row] for row in rows],
        [overview.in_contact[row] for row in rows],
        [float(overview.seconds[row]) for row in rows],
        [of.objects[of.label[row]] for row in rows],
    )
    return picture(figure, "Mean over all sensors in the first recording of some objects. Filled: in contact.")


def _sensor_states(overview: Overview) -> Picture:
    """Sensors that are dead, stuck or saturated, on the layout."""
    live = overview.live
    states = np.where(live, 0, 1)
    states[live & overview.stuck] = 2
    states[live & (overview.saturated > SATURATED)] = 3
    numbers = np.bincount(states.ravel(), minlength=len(STATES))
    names = [f"{name}: {number:,}" for name, number in zip(STATES, numbers, strict=True)]
    return picture(plots.sensor_states(states, names), "What the sensors do. A place without one does not vary either.")
