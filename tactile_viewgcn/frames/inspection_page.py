"""The page of an inspection: what the recordings hold, the settings that fit them, and pictures of both."""

from pathlib import Path

import numpy as np

from tactile_viewgcn import html, plots
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.inspection_text import command_lines
from tactile_viewgcn.frames.readings import SATURATED
from tactile_viewgcn.frames.recommendation import Recommendation, recommend
from tactile_viewgcn.html import Html, bold, code, command, paragraph, picture, section, several, table
from tactile_viewgcn.tables import VIRTUAL

MOST_LINES = 12  # recordings whose time lines are drawn
MOST_OBJECTS = 48  # whose mean frames are drawn
STATES = ["varies", "does not vary", "hardly varies", "often at the largest reading"]


def inspection_page(seen: Inspection) -> str:
    """The page as HTML."""
    chosen = recommend(seen)
    sections = [
        _settings_section(seen, chosen),
        _attention_section(seen),
        _objects_section(seen),
        _time_section(seen),
        _readings_section(seen, chosen),
        _sensors_section(seen),
        _sessions_section(seen),
    ]
    return html.page(f"Recordings: {seen.path.name}", _head(seen), sections)


def _head(seen: Inspection) -> list[Html]:
    """What there is, in a sentence and a few numbers."""
    frames, contact = int(seen.frames.sum()), int(seen.contact.sum())
    height, width = seen.shape
    every = f"{seen.interval:.3g} s" if seen.interval else "unknown"
    return [
        html.element("h1", "What do these recordings hold?"),
        paragraph(str(seen.path), kind="soft"),
        *([paragraph(html.badge("Simulated data"), " by the virtual glove.")] if seen.path == Path(VIRTUAL) else []),
        paragraph(
            f"{several(len(np.unique(seen.label)), 'object')} in {several(len(seen.frames), 'recording')} of "
            f"{several(len(np.unique(seen.session)), 'session')}. In ",
            bold(f"{100 * contact / frames:.0f} % of the frames"),
            " something presses the glove.",
            kind="lead",
        ),
        html.tiles(
            [
                (f"{frames:,}", "frames"),
                (f"{height} x {width}", f"sensors, of which {int(seen.live.sum()):,} vary"),
                (every, "between two frames" + (f"; {seen.gaps:,} gaps" if seen.gaps else "")),
                (seen.dtype, f"from {seen.readings.percentiles[0]:g} to {seen.readings.percentiles[-1]:g}"),
            ]
        ),
    ]


def _settings_section(seen: Inspection, chosen: list[Recommendation]) -> tuple[str, Html]:
    """The settings to use, as one command, and each with its reason."""
    return section(
        "What to do next",
        paragraph("Train and test a classifier with the settings that fit these recordings:"),
        command("\n".join(command_lines(seen, chosen))),
        paragraph("Then ", code("tactile-viewgcn report"), " writes a page of what came out."),
        html.bullets(
            html.join([code(told), reason], ": ") for told, _, reason in (str(one).partition(": ") for one in chosen)
        ),
    )


def _attention_section(seen: Inspection) -> tuple[str, Html]:
    """What may spoil a result."""
    told, once = [], int((seen.groups["recording"][np.unique(seen.label)] == 1).sum())
    leak = seen.first_frame
    if leak and leak.found and not seen.taken_whole:
        told.append(
            f"The first frame of a recording, before anything is held, already tells the object: error "
            f"{100 * leak.error:.0f} %, guessing {100 * leak.chance:.0f} %. Errors will say less about touch than they "
            "seem to. Record the objects in another order in each session."
        )
    if seen.taken_whole:
        told.append("Even the quietest frames are contact: there is no open hand to take a baseline from.")
    if seen.drifts:
        told.append("The open hand drifts from the session's empty hand by as much as contact.")
    if once:
        told.append(f"{once} objects have one recording: nothing is left to test them on. Record each at least twice.")
    if seen.gaps:
        told.append(f"Frames are missing at {seen.gaps:,} places: the time between two is 2.5 times the usual or more.")
    if stuck := int(seen.readings.stuck.sum()):
        told.append(f"{stuck} sensors hardly vary.")
    if saturated := int((seen.readings.saturated > SATURATED).sum()):
        told.append(f"{saturated} sensors are at the largest reading in more than 1 % of the frames.")
    if not told:
        return section("Warnings", paragraph("Nothing to warn of was found.", kind="good"))
    return section("Warnings", *(paragraph(text, kind="warning") for text in told))


def _objects_section(seen: Inspection) -> tuple[str, Html]:
    """Frames, contact and mean frame of each object."""
    present = np.unique(seen.label)
    rows = []
    for label in present:
        of_object = seen.label == label
        frames, contact = int(seen.frames[of_object].sum()), int(seen.contact[of_object].sum())
        share = contact / frames
        rows.append(
            [
                bold(seen.objects[label]),
                f"{of_object.sum():,}",
                f"{frames:,}",
                f"{contact:,}",
                html.bar(share),
                *([f"{int(seen.flagged[of_object].sum()):,}"] if seen.flagged is not None else []),
            ]
        )
    header = ["object", "recordings", "frames", "in contact", "", *(["flagged"] if seen.flagged is not None else [])]
    mean_frame = seen.readings.mean_frame
    drawn = [label for label in present if np.isfinite(mean_frame[label][seen.live]).all()][:MOST_OBJECTS]
    names = [seen.objects[label] for label in drawn]
    pictures = (
        picture(
            plots.mean_frames(mean_frame[drawn], seen.live, names, "counts above baseline", columns=5),
            "Mean frame of each object.",
            "Mean of the frames in contact, above the baseline, with the same colours for all.",
        )
        if drawn
        else paragraph("No frame is in contact, so that there is no mean frame to draw.")
    )
    return section("Objects", table(header, rows, numbers="tnnntn"), pictures)


def _time_section(seen: Inspection) -> tuple[str, Html]:
    """The load of one recording of each object over time."""
    first = np.unique(seen.label, return_index=True)[1]
    rows = first[np.unique(np.linspace(0, len(first) - 1, MOST_LINES).astype(int))]
    readings = seen.readings
    figure = plots.time_lines(
        [readings.activity[row] for row in rows],
        [readings.held[row] for row in rows],
        [float(seen.seconds[row]) for row in rows],
        [seen.objects[seen.label[row]] for row in rows],
    )
    return section(
        "Over time",
        picture(
            figure,
            "Load of recordings over time.",
            f"The mean over all sensors, in the first recording of {len(rows)} objects. Filled: in contact.",
        ),
    )


def _readings_section(seen: Inspection, chosen: list[Recommendation]) -> tuple[str, Html]:
    """How the readings are distributed."""
    readings, scale = seen.readings, [float(one.value) for one in chosen if one.key == "preprocess.scale"]
    marks = {"full scale": scale[0]} if scale and scale[0] <= readings.edges[-1] else {}
    rows = [
        (bold("all readings, counts"), *(f"{value:.4g}" for value in readings.percentiles)),
        (
            bold("sensors in contact, above baseline"),
            *(f"{value:.4g}" if np.isfinite(value) else "" for value in readings.above),
        ),
    ]
    return section(
        "Readings",
        table(("", "least", "1 %", "half", "99 %", "most"), rows, numbers="tnnnnn"),
        picture(
            plots.histogram(readings.histogram, readings.edges, marks),
            "Histogram of the readings.",
            f"Readings in frames of contact. {100 * readings.pressed_share:.1f} % of them are of sensors in contact. "
            + ("A network sees what is above full scale as full scale." if marks else ""),
        ),
    )


def _sensors_section(seen: Inspection) -> tuple[str, Html]:
    """Sensors that are dead, stuck, saturated or noisy, on the layout."""
    states = np.where(seen.live, 0, 1)
    states[seen.live & seen.readings.stuck] = 2
    states[seen.live & (seen.readings.saturated > SATURATED)] = 3
    numbers = np.bincount(states.ravel(), minlength=len(STATES))
    names = [f"{name}: {number:,}" for name, number in zip(STATES, numbers, strict=True)]
    noise = np.median(seen.noise[np.unique(seen.session)], axis=0)
    return section(
        "Sensors",
        html.element(
            "div",
            picture(
                plots.sensor_states(states, names),
                f"Map of the sensors: {'; '.join(names)}.",
                "What the sensors do. A place without a sensor does not vary either.",
            ),
            picture(
                plots.mean_frames(noise[None], seen.live, [""], "counts"),
                "Noise of each sensor.",
                "Noise: the standard deviation without contact, the median of the sessions.",
            ),
            kind="side-by-side",
        ),
    )


def _sessions_section(seen: Inspection) -> tuple[str, Html]:
    """Empty hand, noise and drift of each session."""
    rows = []
    for number in np.unique(seen.session):
        of_session = seen.session == number
        drift = seen.drift[of_session]
        rows.append(
            (
                bold(seen.sessions[number]),
                f"{of_session.sum():,}",
                f"{seen.empty[number]:,}",
                f"{np.median(seen.noise[number][seen.live]):.3g}",
                f"{np.nanmedian(drift):.1f}" if np.isfinite(drift).any() else "",
            )
        )
    header = ("session", "recordings", "frames of the empty hand", "noise, counts", "drift, standard deviations")
    return section(
        "Sessions",
        table(header, rows, numbers="tnnnn"),
        paragraph(
            "Noise: of the median sensor. Drift: how far the open hand moves within a recording, or from its session, "
            "in the median recording.",
            kind="soft",
        ),
    )
