"""The page of an inspection: whether the recordings can be used, the settings that fit them, and pictures of both."""

import numpy as np

from tactile_viewgcn import plots
from tactile_viewgcn.frames.baseline import evenly
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.leak import Leak
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.html import Picture, Verdict, picture, several
from tactile_viewgcn.pages.inspection_text import command_lines
from tactile_viewgcn.pages.recommendation import recommend
from tactile_viewgcn.pages.source_inspection import SATURATED, Overview, on_layout
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.readers.source import EMPTY_HAND, listed

MOST_LINES = 12  # recordings whose time lines are drawn
MOST_OBJECTS = 48  # whose mean frames are drawn
MANY_GAPS = 0.01  # of the frames
STATES = ["varies", "does not vary", "hardly varies", "often at the largest reading"]
COUNTS = "counts above baseline"


def inspection_page(overview: Overview) -> str:
    """The page as HTML."""
    of, chosen = overview.inspection, recommend(overview)
    settings = {note.key: str(note.value) for note in chosen}
    warnings = attention(overview, settings)
    scale = float(settings.get("preprocess.scale", "inf"))
    mark = {"full scale": scale} if scale <= overview.edges[-1] else {}
    names = [of.objects[label] for label in np.unique(of.label)]
    counted = several(len(names) - (EMPTY_HAND in names), "object")
    rows = evenly(np.unique(of.label, return_index=True)[1], MOST_LINES)  # of the first recording of each object
    time_lines = plots.time_lines(
        [overview.activity[row] for row in rows],
        [overview.in_contact[row] for row in rows],
        [float(overview.seconds[row]) for row in rows],
        [of.objects[of.label[row]] for row in rows],
    )
    noise = on_layout(np.median(of.hand.noise[np.unique(of.session)], axis=0), of.live)
    return html.render(
        "inspection.html",
        title=f"Recordings: {overview.path.name}",
        overview=overview,
        inspection=of,
        simulated=str(overview.path) == VIRTUAL,
        objects=f"{counted} and the empty hand" if EMPTY_HAND in names else counted,
        sessions=len(np.unique(of.session)),
        every=f"{overview.interval:.3g} s" if overview.interval else "unknown",
        contact_share=f"{100 * of.contact.sum() / of.frames.sum():.0f}\N{NO-BREAK SPACE}%",
        verdict=_verdict(overview, settings, warnings),
        can_test=_can_test(of, settings),
        command="\n".join(command_lines(overview, chosen)),
        settings=[str(note).partition(": ") for note in chosen],
        warnings=warnings,
        object_rows=overview.object_rows(),
        few_flags=of.flagged is not None and of.flagged.sum() < of.contact.sum(),
        mean_frames=_mean_frames(overview),
        time_lines=picture(time_lines, "Load of recordings over time."),
        reading_rows=[
            ("all readings, counts", [f"{value:.4g}" for value in overview.percentiles]),
            (
                "sensors in contact, counts above baseline",
                [f"{value:.4g}" if np.isfinite(value) else "" for value in overview.above],
            ),
        ],
        histogram=picture(plots.histogram(overview.histogram, overview.edges, mark), "Histogram of the readings."),
        marked=bool(mark),
        states=_sensor_states(overview),
        noise=picture(plots.mean_frames(noise[None], of.live, [""], "counts"), "Noise of each sensor."),
        session_rows=[
            (*row, f"{noise:.3g}", f"{np.median(drift):.1f}" if len(drift) else "")
            for *row, noise, drift in overview.session_rows()
        ],
    )


def attention(overview: Overview, settings: dict[str, str]) -> list[tuple[str, str]]:
    """What may spoil a result with the settings that are recommended, each with what to do about it."""
    of, baseline = overview.inspection, settings["preprocess.baseline"]
    without = _names(of, np.bincount(of.label, of.contact, len(of.objects)) == 0)
    once = _names(of, _groups(of, settings) == 1)
    leak, first_frame = overview.leaks.get(baseline), overview.first_frame
    stuck, saturated = int(overview.stuck.sum()), int((overview.saturated > SATURATED).sum())
    grasped = "Grasped" if settings["split.by"] == "grasp" else "Recorded"
    cases = [
        (without, f"Never in contact: {without}.", "Record these objects again, held firmly."),
        (
            leak and leak.tells_object,
            f"Frames of the open hand tell the object, also above the baseline {baseline}{_errors(leak)}",
            "Record each object in several sessions, in another order in each.",
        ),
        (
            first_frame and first_frame.tells_object and not of.all_contact,
            f"The first frame of a recording, before anything is held, already tells the object{_errors(first_frame)}",
            "Record the objects in another order in each session.",
        ),
        (
            of.all_contact,
            "Even the quietest frames are contact: there is no open hand to take a baseline from.",
            "The settings above take the recordings as they are. Better begin each with an open hand.",
        ),
        (
            of.drifts_from_empty_hand,
            "The open hand drifts from the session's empty hand by as much as contact.",
            "The baseline above is taken before each grasp. Begin each grasp with an open hand.",
        ),
        (once, f"{grasped} once: {once}. Nothing is left to test with.", "Record each at least twice."),
        (
            overview.gaps > MANY_GAPS * of.frames.sum(),
            f"Frames are missing at {several(overview.gaps, 'place')}: the time between two is 2.5 times the usual or "
            "more.",
            "Look at the cable, and at the program that records.",
        ),
        (stuck, f"{several(stuck, 'sensor')} hardly vary.", "See the map under Sensors, and check their wiring."),
        (
            saturated,
            f"{several(saturated, 'sensor')} read the largest number that there is in more than 1 % of the frames.",
            "Lower the gain of the electronics, or grip less.",
        ),
    ]
    return [(text, remedy) for applies, text, remedy in cases if applies]


def _errors(leak: Leak | None) -> str:
    """How well a leak tells the object, and what follows."""
    if leak is None:
        return ""
    errors = f"error {100 * leak.error:.0f} %, guessing {100 * leak.chance:.0f} %"
    return f": {errors}. Errors will say less about touch than they seem to."


def _names(of: Inspection, chosen: np.ndarray) -> str:
    """Names of the recorded objects among bool (O,), the empty hand left out; "" without any."""
    return listed([of.objects[i] for i in np.unique(of.label) if chosen[i] and of.objects[i] != EMPTY_HAND])


def _groups(of: Inspection, settings: dict[str, str]) -> np.ndarray:
    """How many groups of the recommended split each object has, (O,); recordings where single frames are held out."""
    by = settings["split.by"]
    return of.groups["recording" if by == "frame" else by]


def _can_test(of: Inspection, settings: dict[str, str]) -> bool:
    """Whether two objects have a group to hold out."""
    return bool((_groups(of, settings) > 1).sum() >= 2)


def _verdict(overview: Overview, settings: dict[str, str], warnings: list[tuple[str, str]]) -> Verdict:
    """Whether the recordings can be trained and tested on."""
    groups, by = _groups(overview.inspection, settings), settings["split.by"]
    if not _can_test(overview.inspection, settings):
        return Verdict("bad", "Not yet: there are no two objects with two recordings each.", ["Nothing can be tested."])
    fewest = several(int(groups[groups > 0].min()), by)
    reasons = ["Each object is on both published sides." if by == "source" else f"Each object has {fewest} or more."]
    if overview.leaks and not any(leak.tells_object for leak in overview.leaks.values()):
        reasons.append("Without contact the objects cannot be told apart, as it should be.")
    if warnings:
        return Verdict("unsure", f"Usable, with {several(len(warnings), 'warning')}.", [*reasons, warnings[0][0]])
    return Verdict("good", "Yes: nothing was found that would spoil a result.", reasons)


def _mean_frames(overview: Overview) -> Picture | None:
    """Mean frame of each object; None where no frame is in contact."""
    of, means = overview.inspection, overview.mean_frame
    drawn = [label for label in np.unique(of.label) if np.isfinite(means[label][of.live]).all()][:MOST_OBJECTS]
    if not drawn:
        return None
    names = [of.objects[label] for label in drawn]
    return picture(plots.mean_frames(means[drawn], of.live, names, COUNTS, columns=5), "Mean frame of each object.")


def _sensor_states(overview: Overview) -> Picture:
    """Sensors that are dead, stuck or saturated, on the layout."""
    live = overview.inspection.live
    states = np.where(live, 0, 1)
    states[live & overview.stuck] = 2
    states[live & (overview.saturated > SATURATED)] = 3
    numbers = np.bincount(states.ravel(), minlength=len(STATES))
    names = [f"{name}: {number:,}" for name, number in zip(STATES, numbers, strict=True)]
    return picture(plots.sensor_states(states, names), f"Map of the sensors: {'; '.join(names)}.")
