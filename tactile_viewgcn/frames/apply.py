"""Apply a plan: the baseline of each frame, and which frames are in contact.

Nothing else looks at readings once a plan is made. All fallbacks stand here and in
`frames/baseline.py`. With the baseline `grasp` a recording in which the hand never opens takes the
first of these that is available; with `empty_hand` each recording does:

1. the empty hand of its session;
2. the open hand of its session's recordings. A new recording has none of other recordings;
3. if it is new, what the training set measured in a session of this name. A session that has no
   name, or that the training set does not know, has the mean of the training set's sessions;
4. its five quietest frames.

So a new recording depends on no other one but the empty hand of its session.

New recordings may lack the flags of the source that a plan filters by. Then contact is found above
the baseline. If the plan has no baseline, all frames count as contact where nearly all training
frames did.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    session_moments,
    sessions_with_empty_hand,
    without_empty_hand,
)
from tactile_viewgcn.frames.filter import flags_of, pressed_frames
from tactile_viewgcn.frames.open_hand import HandStates, Moments, hand_states
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings

# share of the training frames that the filter kept, from which all frames count as contact
ALL_KEPT = 0.99


def apply(
    plan: Plan, recordings: Recordings, *, new: bool = False, states: HandStates | None = None
) -> tuple[Baseline, np.ndarray]:
    """Return the baseline of recordings, and which of their frames are in contact.

    The recordings of the training, validation and test set are measured session by session, and
    only the plan's settings and sensors are used. New recordings are measured one by one, and what
    they do not show comes from the training set.

    Names of objects are not used, except the name of the empty hand.

    Args:
        plan: for new recordings one of `measured_on`.
        recordings: T frames.
        new: whether the recordings are new.
        states: the hand's states of these recordings, if they are known already.

    Returns:
        The baseline, and bool (T,): the frames in contact, or with a flag of the source if the plan
        filters by flags.
    """
    params = plan.params
    recordings = replace(recordings, live=plan.live)
    if new:
        recordings = _measured_apart(recordings)
    moments = list[Moments]()
    if params.baseline != "none":
        trained = None
        if new:
            trained = _trained_moments(plan, recordings.sessions)
        moments = session_moments(recordings, trained)
    needs_states = params.baseline == "grasp" or (
        params.baseline == "empty_hand" and bool(without_empty_hand(recordings))
    )
    if needs_states and states is None:
        states = hand_states(recordings, int(params.contact_sensors), moments)
        if not plan.shows_open_hand:
            states = states.as_all_contact()
    baseline = measure_baseline(recordings, params, moments, states)
    return baseline, _in_contact(plan, recordings, baseline)


def _in_contact(plan: Plan, recordings: Recordings, baseline: Baseline) -> np.ndarray:
    """Return bool (T,): the frames in contact, by the plan's filter or what stands in for it."""
    flags = flags_of(recordings)
    if plan.params.filter == "flags" and flags is not None:
        return flags
    if keeps_every_frame(plan):
        return np.ones(len(recordings), dtype=bool)
    sensors = int(plan.params.contact_sensors)
    if np.isfinite(baseline.noise).all():
        return pressed_frames(recordings, baseline, sensors)
    return hand_states(recordings, sensors, session_moments(recordings)).contact


def keeps_every_frame(plan: Plan) -> bool:
    """Return whether every frame without a flag of the source counts as contact."""
    if plan.params.filter == "none":
        return True
    return plan.params.baseline == "none" and plan.kept_share >= ALL_KEPT


def _measured_apart(recordings: Recordings) -> Recordings:
    """Return the table in which each recording of a session without an empty hand is a session."""
    session = recordings.columns["session"]
    has_empty_hand = sessions_with_empty_hand(recordings)[session]
    recording = np.where(has_empty_hand, -1, recordings.columns["recording"])
    keys = pd.DataFrame({"session": session, "recording": recording})
    parts = keys.groupby(["session", "recording"])
    names = [recordings.sessions[number] for number in parts["session"].first()]
    columns = recordings.columns | {"session": parts.ngroup().to_numpy()}
    return replace(recordings, columns=columns, sessions=names)


def _trained_moments(plan: Plan, sessions: list[str]) -> list[Moments]:
    """Return for each session what the training set read there: baseline and noise (S,)."""
    mean_of = dict(zip(plan.sessions, plan.baselines, strict=True))
    mean_of.pop(NO_SESSION, None)
    average = plan.mean_baseline()
    noise = plan.noise[plan.live]
    return [(mean_of.get(name, average)[plan.live], noise) for name in sessions]
