"""The page of an inspection: whether the recordings can be used, the settings that fit them, and pictures of both."""

from typing import Any

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.frames.automatic import Recommendation
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.leak import Leak
from tactile_viewgcn.frames.readings import SATURATED
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.html import Picture, Step, Verdict, picture, several
from tactile_viewgcn.pages.inspection_text import command_lines
from tactile_viewgcn.pages.recommendation import recommend
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.readers.source import EMPTY_HAND, listed

MOST_LINES = 12  # recordings whose time lines are drawn
MOST_OBJECTS = 48  # whose mean frames are drawn
MANY_GAPS = 0.01  # of the frames
STATES = ["varies", "does not vary", "hardly varies", "often at the largest reading"]
COUNTS = "counts above baseline"
WORDS = {
    "frame": "one reading of all sensors of the glove",
    "count": "the unit that the sensors are read in",
    "baseline": "what the sensors read when nothing presses them; it is subtracted",
    "open hand": "the glove worn, and nothing pressed, within a recording",
    "empty hand": "a recording of the open hand alone; the source names its object empty_hand",
    "contact": "a frame in which enough sensors read clearly more than the open hand; computed here, see Objects",
    "flagged": "a frame in which the recordings themselves say that an object is held",
    "recording": "the frames taken in one go, of one object",
    "session": "the recordings between two fittings of the glove",
    "noise": "how much a sensor that nothing presses varies: its standard deviation",
    "drift": "how far the open hand moves within a recording, or from its session, in standard deviations of noise",
    "leak": "an object that is told without touching it, by drift or by order: errors then say little about touch",
    "guessing": "always naming the object that has most recordings",
    "full scale": "counts above the baseline that a neural network sees as 1; more than that it sees as 1 too",
    "split": "which recordings the classifier learns from, and on which it is tested afterwards",
    "preset best": "settings of a classifier without a neural network, for few recordings",
}


def inspection_page(seen: Inspection) -> str:
    """The page as HTML."""
    chosen, readings = recommend(seen), seen.readings
    settings = {one.key: str(one.value) for one in chosen}
    warned = attention(seen, settings)
    mark = _full_scale(seen, chosen)
    return html.render(
        "inspection.html",
        title=f"Recordings: {seen.path.name}",
        seen=seen,
        simulated=str(seen.path) == VIRTUAL,
        objects=_objects(seen),
        sessions=len(np.unique(seen.session)),
        every=f"{seen.interval:.3g} s" if seen.interval else "unknown",
        contact_share=f"{100 * seen.contact.sum() / seen.frames.sum():.0f}\N{NO-BREAK SPACE}%",
        verdict=_verdict(seen, settings, warned),
        steps=_steps(seen, settings),
        command="\n".join(command_lines(seen, chosen)),
        settings=[str(one).partition(": ") for one in chosen],
        warnings=warned,
        object_rows=_object_rows(seen),
        few_flags=seen.flagged is not None and seen.flagged.sum() < seen.contact.sum(),
        mean_frames=_mean_frames(seen),
        time_lines=_time_lines(seen),
        reading_rows=_reading_rows(seen),
        histogram=picture(plots.histogram(readings.histogram, readings.edges, mark), "Histogram of the readings."),
        marked=bool(mark),
        states=_sensor_states(seen),
        noise=_noise(seen),
        session_rows=_session_rows(seen),
        words=WORDS,
    )


def _objects(seen: Inspection) -> str:
    """26 objects and the empty hand"""
    names = [seen.objects[label] for label in np.unique(seen.label)]
    told = several(len(names) - (EMPTY_HAND in names), "object")
    return f"{told} and the empty hand" if EMPTY_HAND in names else told


def attention(seen: Inspection, settings: dict[str, str]) -> list[tuple[str, str]]:
    """What may spoil a result with the settings that are recommended, each with what to do about it."""
    told, once, baseline = [], _names(seen, _groups(seen, settings) == 1), settings["preprocess.baseline"]
    leak, still = seen.first_frame, seen.leaks.get(baseline)
    if without := _names(seen, np.bincount(seen.label, seen.contact, len(seen.objects)) == 0):
        told.append((f"Never in contact: {without}.", "Record these objects again, held firmly."))
    if still and still.found:
        text = f"Frames of the open hand tell the object, also above the baseline {baseline}: {_told(still)}"
        told.append((text, "Record each object in several sessions, in another order in each."))
    if leak and leak.found and not seen.all_contact:
        text = f"The first frame of a recording, before anything is held, already tells the object: {_told(leak)}"
        told.append((text, "Record the objects in another order in each session."))
    if seen.all_contact:
        told.append(
            (
                "Even the quietest frames are contact: there is no open hand to take a baseline from.",
                "The settings above take the recordings as they are. Better begin each with an open hand.",
            )
        )
    if seen.drifts_from_empty_hand:
        told.append(
            (
                "The open hand drifts from the session's empty hand by as much as contact.",
                "The baseline above is taken before each grasp. Begin each grasp with an open hand.",
            )
        )
    if once:
        what = "Grasped" if settings["split.by"] == "grasp" else "Recorded"
        told.append((f"{what} once: {once}. Nothing is left to test with.", "Record each at least twice."))
    if seen.gaps > MANY_GAPS * seen.frames.sum():
        told.append(
            (
                f"Frames are missing at {several(seen.gaps, 'place')}: the time between two is 2.5 times the usual or "
                "more.",
                "Look at the cable, and at the program that records.",
            )
        )
    if stuck := int(seen.readings.stuck.sum()):
        told.append((f"{several(stuck, 'sensor')} hardly vary.", "See the map under Sensors, and check their wiring."))
    if saturated := int((seen.readings.saturated > SATURATED).sum()):
        told.append(
            (
                f"{several(saturated, 'sensor')} read the largest number that there is in more than 1 % of the frames.",
                "Lower the gain of the electronics, or grip less.",
            )
        )
    return told


def _told(leak: Leak) -> str:
    """How well a leak tells the object, and what follows."""
    errors = f"error {100 * leak.error:.0f} %, guessing {100 * leak.chance:.0f} %"
    return f"{errors}. Errors will say less about touch than they seem to."


def _names(seen: Inspection, those: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    return listed([seen.objects[i] for i in np.unique(seen.label) if those[i] and seen.objects[i] != EMPTY_HAND])


def _groups(seen: Inspection, settings: dict[str, str]) -> np.ndarray:
    """How many groups of the recommended split each object has, (O,); recordings where single frames are held out."""
    by = settings["split.by"]
    return seen.groups["recording" if by == "frame" else by]


def _verdict(seen: Inspection, settings: dict[str, str], warned: list[tuple[str, str]]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    groups, by = _groups(seen, settings), settings["split.by"]
    if (groups > 1).sum() < 2:
        return Verdict("bad", "Not yet: there are no two objects with two recordings each.", ["Nothing can be tested."])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    if seen.leaks and not any(leak.found for leak in seen.leaks.values()):
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warned:
        return Verdict("unsure", f"Usable, with {several(len(warned), 'warning')}.", [*reasons, warned[0][0]])
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def _steps(seen: Inspection, settings: dict[str, str]) -> list[Step]:
    """What to do, the most urgent first; the command with the settings is a section of its own."""
    if (_groups(seen, settings) > 1).sum() < 2:
        return [Step("Record each object at least twice.", "Five or more times, in two sessions, is better.")]
    return [Step("Train and test a classifier with the settings below.", "")]


def _object_rows(seen: Inspection) -> list[tuple[str, int, int, int, int]]:
    """Name, recordings, frames, frames in contact and flagged frames of each object."""
    rows = []
    for label in np.unique(seen.label):
        of_object = seen.label == label
        flagged = int(seen.flagged[of_object].sum()) if seen.flagged is not None else 0
        counts = int(of_object.sum()), int(seen.frames[of_object].sum()), int(seen.contact[of_object].sum())
        rows.append((seen.objects[label], *counts, flagged))
    return rows


def _mean_frames(seen: Inspection) -> Picture | None:
    """Mean frame of each object; None where no frame is in contact."""
    means = seen.readings.mean_frame
    drawn = [label for label in np.unique(seen.label) if np.isfinite(means[label][seen.live]).all()][:MOST_OBJECTS]
    if not drawn:
        return None
    names = [seen.objects[label] for label in drawn]
    return picture(plots.mean_frames(means[drawn], seen.live, names, COUNTS, columns=5), "Mean frame of each object.")


def _time_lines(seen: Inspection) -> Picture:
    """The load of one recording of each object over time."""
    first = np.unique(seen.label, return_index=True)[1]
    rows = first[np.unique(np.linspace(0, len(first) - 1, MOST_LINES).astype(int))]
    figure = plots.time_lines(
        [seen.readings.activity[row] for row in rows],
        [seen.readings.held[row] for row in rows],
        [float(seen.seconds[row]) for row in rows],
        [seen.objects[seen.label[row]] for row in rows],
    )
    return picture(figure, "Load of recordings over time.")


def _reading_rows(seen: Inspection) -> list[tuple[str, list[str]]]:
    """Percentiles of the readings."""
    above = [f"{value:.4g}" if np.isfinite(value) else "" for value in seen.readings.above]
    return [
        ("all readings, counts", [f"{value:.4g}" for value in seen.readings.percentiles]),
        ("sensors in contact, counts above baseline", above),
    ]


def _full_scale(seen: Inspection, chosen: list[Recommendation]) -> dict[str, float]:
    """The place of full scale in the histogram, where it is there."""
    scale = [float(one.value) for one in chosen if one.key == "preprocess.scale"]
    return {"full scale": scale[0]} if scale and scale[0] <= seen.readings.edges[-1] else {}


def _sensor_states(seen: Inspection) -> Picture:
    """Sensors that are dead, stuck or saturated, on the layout."""
    states = np.where(seen.live, 0, 1)
    states[seen.live & seen.readings.stuck] = 2
    states[seen.live & (seen.readings.saturated > SATURATED)] = 3
    numbers = np.bincount(states.ravel(), minlength=len(STATES))
    names = [f"{name}: {number:,}" for name, number in zip(STATES, numbers, strict=True)]
    return picture(plots.sensor_states(states, names), f"Map of the sensors: {'; '.join(names)}.")


def _noise(seen: Inspection) -> Picture:
    """Noise of each sensor, the median of the sessions."""
    noise = np.median(seen.noise[np.unique(seen.session)], axis=0)
    return picture(plots.mean_frames(noise[None], seen.live, [""], "counts"), "Noise of each sensor.")


def _session_rows(seen: Inspection) -> list[tuple[Any, ...]]:
    """Name, recordings, frames of the empty hand, noise and drift of each session."""
    rows = []
    for number in np.unique(seen.session):
        of_session = seen.session == number
        drift, noise = seen.drift[of_session], float(np.median(seen.noise[number][seen.live]))
        told = f"{np.nanmedian(drift):.1f}" if np.isfinite(drift).any() else ""
        rows.append((seen.sessions[number], int(of_session.sum()), int(seen.empty[number]), f"{noise:.3g}", told))
    return rows
