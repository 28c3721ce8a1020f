"""Apply a plan to recordings: the baseline of each frame, and which frames are in contact.

Once a plan is made, no other file looks at readings. All fallbacks for a baseline stand here and in
`frames/baseline.py`. With `preprocess.baseline: grasp` they serve recordings in which the hand
never opens. With `empty_hand` they serve every recording. A recording takes the first that is
available:

1. the empty hand of its session;
2. the open hand in the recordings of its session. A new recording counts as a session of its own
   here, so it takes nothing from other recordings;
3. if the recording is new, the baseline that the training set has for a session of this name. If
   the session has no name, or the training set does not know it, the mean over the training set's
   sessions;
4. its five quietest frames.

So a new recording depends on no other recording, except on the empty hand of its session.

New recordings can lack the flags of the source that a plan filters by. Then the frames above the
baseline are in contact. If the plan has no baseline, all frames count as contact, provided that the
filter kept nearly all training frames.
"""

from dataclasses import replace

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    sessions_with_empty_hand,
    without_empty_hand,
)
from tactile_viewgcn.frames.drift import accepting_drift, drift_between
from tactile_viewgcn.frames.filter import flags_of, pressed_frames
from tactile_viewgcn.frames.moments import Moments, session_moments
from tactile_viewgcn.frames.open_hand import HandStates, hand_states
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings

# if the filter kept this share of the training frames or more, all frames count as contact
ALL_KEPT = 0.99


def apply(
    plan: Plan, recordings: Recordings, *, new: bool = False, states: HandStates | None = None
) -> tuple[Baseline, np.ndarray]:
    """Return the baseline of recordings, and which of their frames are in contact.

    Recordings of the training, validation and test set are measured session by session. Only the
    plan's settings and sensors are used for them. New recordings are measured one by one. Where
    they show no baseline, the plan's baseline of the training set is used.

    The names of objects are not used, except the name of the empty hand.

    Args:
        plan: how readings become frames. For new recordings, `measured_on` has to have made it.
        recordings: T frames.
        new: whether the recordings are new.
        states: the states of the hand in these recordings, if they are known already.

    Returns:
        The baseline, and bool (T,), the frames in contact. If the plan filters by flags of the
        source, these are the frames with a flag.
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
        if new:
            moments = [of_session.with_drift(plan.drift) for of_session in moments]
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
    """Return the frames in contact, bool (T,), by the plan's filter or by its substitute."""
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
    """Return whether all frames of recordings without flags count as contact."""
    if plan.params.filter == "none":
        return True
    return plan.params.baseline == "none" and plan.kept_share >= ALL_KEPT


def _measured_apart(recordings: Recordings) -> Recordings:
    """Return the recordings, each as its own session if its session has no empty hand."""
    session = recordings.columns["session"]
    has_empty_hand = sessions_with_empty_hand(recordings)[session]
    recording = np.where(has_empty_hand, -1, recordings.columns["recording"])
    keys = pd.DataFrame({"session": session, "recording": recording})
    parts = keys.groupby(["session", "recording"])
    names = [recordings.sessions[number] for number in parts["session"].first()]
    columns = recordings.columns | {"session": parts.ngroup().to_numpy()}
    return replace(recordings, columns=columns, sessions=names)


def _trained_moments(plan: Plan, sessions: list[str]) -> list[Moments]:
    """Return the moments that the training set has for each session."""
    mean_of = dict(zip(plan.sessions, plan.baselines, strict=True))
    mean_of.pop(NO_SESSION, None)
    average = plan.mean_baseline()
    noise = plan.noise[plan.live]
    drift_of_unknown = new_session_drift(plan)
    moments = []
    for name in sessions:
        drift = plan.drift if name in mean_of else drift_of_unknown
        mean = mean_of.get(name, average)[plan.live]
        moments.append(Moments(mean, noise, np.hypot(noise, drift), drift))
    return moments


def new_session_drift(plan: Plan) -> float:
    """Return how far the open hand of a new session is from the mean of the training's sessions.

    The standard deviation in counts is returned. It has the drift within a session and the drift
    between sessions, of the median sensor. It is larger if the open hand of one of these sessions
    would count as contact otherwise, see `accepting_drift`.
    """
    means = plan.baselines[:, plan.live]
    of_median = float(np.hypot(plan.drift, drift_between(means)))
    return accepting_drift(
        means, of_median, plan.noise[plan.live], int(plan.params.contact_sensors)
    )
