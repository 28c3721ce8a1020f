"""Leak checks of recordings with each baseline that they allow, and of first frames."""

from contextlib import suppress
from dataclasses import replace

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import Baseline, empty_hand_baseline
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.leak import Leak, check_first_frames, check_leak
from tactile_viewgcn.params import Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.recordings import Recordings


def with_every_leak(recordings: Recordings, seen: Inspection) -> Inspection:
    """The inspection with all leak checks that its recordings allow."""
    kinds = ("empty_hand", "grasp") if not seen.all_contact else ()
    first_frame = check_first_frames(recordings, seen.hand, stream(0, "first frame"))
    return replace(seen, leaks=_leaks(recordings, seen, *kinds), first_frame=first_frame)


def with_deciding_leaks(recordings: Recordings, seen: Inspection) -> Inspection:
    """The inspection with the leak checks that decide between the baselines empty_hand and grasp; often with none."""
    if not seen.has_empty_hand or seen.has_published_split or seen.drifts_from_empty_hand:
        return seen
    leaks = _leaks(recordings, seen, "empty_hand")
    if "empty_hand" in leaks and leaks["empty_hand"].found:
        leaks |= _leaks(recordings, seen, "grasp")
    return replace(seen, leaks=leaks)


def leak_of_split(recordings: Recordings, seen: Inspection, baseline: Baseline, kind: str, split: Split) -> Leak | None:
    """The leak check with the baseline that was taken and the groups of the split, unless it was made to decide.

    None where all frames are contact, and as `check_leak` says.

    Args:
        kind: of the baseline, `preprocess.baseline`.
    """
    if seen.all_contact:
        return None
    by = "recording" if split.by == "source" else split.by  # whose groups are recordings
    if kind in seen.leaks and by == _groups(seen):
        return seen.leaks[kind]
    return check_leak(recordings, baseline, seen.hand, split.by, stream(split.seed, "leak"))


def _groups(seen: Inspection) -> str:
    """`split.by` of the checks that decide: recordings, or grasps where no object has two recordings."""
    return "grasp" if (seen.groups["recording"] < 2).all() and "grasp" in seen.groups else "recording"


def _leaks(recordings: Recordings, seen: Inspection, *kinds: str) -> dict[str, Leak]:
    """The leak check with each of these baselines that the recordings allow."""
    leaks: dict[str, Leak] = {}
    by = _groups(seen)
    for kind in kinds:
        with suppress(UserError):  # no such baseline
            if kind == "grasp":
                baseline = grasp_baseline(recordings, sensors=seen.contact_sensors, sigmas=seen.contact_sigmas)
            else:
                baseline = empty_hand_baseline(recordings)
            leak = check_leak(recordings, baseline, seen.hand, by, stream(0, "leak"))
            leaks |= {kind: leak} if leak else {}
    return leaks
