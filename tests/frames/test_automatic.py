"""What `auto` becomes by what was inspected and measured, rule by rule."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames import automatic as module
from tactile_viewgcn.frames.automatic import AUTO, choose, compare, decide, first_look
from tactile_viewgcn.frames.baseline import MIN_FRAMES
from tactile_viewgcn.frames.inspection import inspect_recordings
from tactile_viewgcn.frames.measurement import Measurement, possible_baselines
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.params import load
from tests.drifting import drifting
from tests.grips import FILE
from tests.sources import written

ASKED = dict.fromkeys(AUTO, "auto")
MANUAL = {"baseline": "none", "filter": "none", "contact_sensors": 5, "scale": 100.0}


def settings(*changes):
    """The section `preprocess`, whose contact is of five sensors, and the split."""
    params = load(FILE, ("preprocess.contact_sensors=5", *changes))
    return params.preprocess, params.split


@pytest.fixture(scope="module")
def glove(tmp_path_factory):
    """The empty hand and four objects, two recordings of two grasps each, in one session."""
    made = drifting(recordings=2, grasps=2)
    return written(tmp_path_factory.mktemp("glove") / "t", made.counts, **made.columns)


@pytest.fixture(scope="module")
def inspection(glove):
    return inspect_recordings(glove, first_look(glove, settings()[0])[0])


def error(mistakes, *, tells=False):
    """An error of ten groups; above a baseline that tells the object."""
    cells = np.stack([np.repeat([1, 2], 5), np.arange(10)], axis=1)
    return QuickError(cells, (np.arange(10) < mistakes).astype(float), 0.0, 0.3 if tells else 0.9, 0.5, 100, 0.0)


def chosen(inspection, measurement=None, **asked):
    """The chosen values by key, and the reasons."""
    notes = choose(inspection, measurement, MANUAL | asked)
    assert all(note.level == "choice" and note.text and note.key.startswith("preprocess.") for note in notes)
    names = [note.key.removeprefix("preprocess.") for note in notes]
    values, reasons = ([getattr(note, field) for note in notes] for field in ("value", "text"))
    return dict(zip(names, values, strict=True)), dict(zip(names, reasons, strict=True))


def test_what_is_not_auto_is_not_chosen(inspection):
    assert chosen(inspection)[0] == {}
    for key in AUTO:
        assert chosen(inspection, **{key: "auto"})[0].keys() == {key}
    topics = {note.key: note.topic for note in choose(inspection, None, ASKED)}
    assert topics == {
        "preprocess.baseline": "baseline",
        "preprocess.filter": "filter",
        "preprocess.contact_sensors": "contact",
        "preprocess.scale": "scale",
    }


def test_a_published_split_has_the_paper_s_baseline_whatever_is_measured(inspection):
    measured = Measurement({"empty_hand": error(9), "grasp": error(0)}, {"empty_hand": error(0, tells=True)}, {})
    assert chosen(inspection, measured, baseline="auto")[0] == {"baseline": "grasp"}
    paper = replace(inspection, follows_paper=True, all_contact=True)
    assert chosen(paper, measured, baseline="auto")[0] == {"baseline": "empty_hand"}
    filters = replace(measured, filters={"flags": error(9), "contact": error(0)})
    assert chosen(inspection, filters, filter="auto")[0] == {"filter": "contact"}
    flagged = replace(paper, flagged=inspection.frames)
    assert chosen(flagged, filters, filter="auto")[0] == {"filter": "flags"}


@pytest.mark.parametrize("zero", [0.0, 480.0])
def test_where_all_is_contact_readings_stay_as_they_are_but_for_what_they_read_at_least(inspection, zero):
    page = replace(inspection, all_contact=True, zero=zero)
    values, reasons = chosen(page, Measurement({"grasp": error(0)}, {}, {}), baseline="auto")
    assert values == {"baseline": "none", "zero": zero}
    assert ("about 0" in reasons["zero"]) == (zero == 0)


@pytest.mark.parametrize(
    ("empty", "opened", "baseline", "short"),
    [
        ([20], 0, "empty_hand", ""),
        ([MIN_FRAMES], 0, "empty_hand", ""),
        ([MIN_FRAMES - 1], MIN_FRAMES, "grasp", ""),
        ([MIN_FRAMES - 1], MIN_FRAMES - 1, "quiet", "10 recordings"),
    ],
)
def test_without_a_measurement_the_baseline_is_what_the_recordings_have(inspection, empty, opened, baseline, short):
    rows = len(inspection.label)
    page = replace(inspection, empty=np.array(empty), open=np.full(rows, opened))
    for measurement in (None, Measurement({}, {}, {})):
        values, reasons = chosen(page, measurement, baseline="auto")
        assert values["baseline"] == baseline and short in reasons["baseline"]


def test_one_recording_without_an_open_hand_takes_the_quiet_baseline(inspection):
    opened = np.full(len(inspection.label), MIN_FRAMES)
    opened[3] -= 1
    page = replace(inspection, empty=np.array([0]), open=opened)
    values, reasons = chosen(page, baseline="auto")
    assert values["baseline"] == "quiet" and "1 recording" in reasons["baseline"]


def test_the_reason_names_errors_and_the_baselines_that_tell_the_object(inspection):
    baselines = {"empty_hand": error(1), "grasp": error(3)}
    leaks = {"empty_hand": error(2, tells=True), "grasp": error(8)}
    values, reasons = chosen(inspection, Measurement(baselines, leaks, {}), baseline="auto")
    assert values["baseline"] == "grasp"
    assert all(text in reasons["baseline"] for text in ("30.0 %", "with empty_hand by 10.0 %", "above empty_hand"))
    leaks["grasp"] = error(4, tells=True)
    values, reasons = chosen(inspection, Measurement(baselines, leaks, {}), baseline="auto")
    assert values["baseline"] == "grasp" and "above each of them" in reasons["baseline"]
    _, reasons = chosen(inspection, Measurement({"grasp": error(3)}, {"grasp": error(8)}, {}), baseline="auto")
    assert "told" not in reasons["baseline"] and "with grasp" not in reasons["baseline"]


def test_flags_are_taken_where_every_object_has_some(inspection):
    flags = np.where(inspection.has_object, 7, 0)  # none of the empty hand's
    page = replace(inspection, flagged=flags)
    assert chosen(page, filter="auto")[0] == {"filter": "flags"}
    for row in np.flatnonzero(inspection.label == 2):
        flags[row] = 0
    assert chosen(page, filter="auto", baseline="grasp")[0] == {"filter": "contact"}
    assert chosen(page, filter="auto")[0] == {"filter": "none"}  # the baseline is none
    only = Measurement({}, {}, {"contact": error(0)})  # nothing to compare it with
    assert chosen(page, only, filter="auto")[0] == {"filter": "none"}


def test_the_share_of_contact_is_of_all_frames(inspection):
    frames = inspection.frames
    page = replace(inspection, contact=np.where(np.arange(len(frames)) < len(frames) // 2, frames, 0))
    assert chosen(page, filter="auto", baseline="grasp")[1]["filter"].startswith("50 %")


@pytest.mark.parametrize(
    ("times", "scale"),
    [(0.4, pytest.approx(13, rel=0.1)), (0.6, 150), (1, 150), (4, 150), (100, pytest.approx(3200, rel=0.1))],
)
def test_the_released_scale_is_kept_at_one_to_ten_times_the_strongest_readings(tmp_path, times, scale):
    """A pressed sensor reads about 30 counts above the open hand, the strongest hundredth 32 or more."""
    made = drifting(recordings=2, grasps=2)
    counts = np.rint(500 + times * (made.counts - 500.0)).astype(np.int16)
    table = written(tmp_path / "t", counts, **made.columns)
    page = inspect_recordings(table, first_look(table, settings()[0])[0])
    assert chosen(page, scale="auto")[0] == {"scale": scale}


def test_without_contact_the_scale_is_the_released_one_and_one_beyond_params_is_refused(inspection):
    none = replace(inspection, in_hand=np.zeros_like(inspection.in_hand))
    assert chosen(none, scale="auto")[0] == {"scale": 150.0}
    far = replace(inspection, baseline=np.full_like(inspection.baseline, -1e31))
    with pytest.raises(UserError, match=r"1e\+31.*rescale"):
        choose(far, None, MANUAL | {"scale": "auto"})


@pytest.mark.parametrize(("reading", "scale"), [(1e30, 1e30), (1.1e30, None), (1e-30, 1e-30), (9e-31, None)])
def test_a_scale_is_refused_where_params_would_refuse_it(inspection, reading, scale, monkeypatch):
    monkeypatch.setattr(module, "contact_readings", lambda _: (None, np.full(9, reading)))
    if scale:
        assert chosen(inspection, scale="auto")[0] == {"scale": scale}
    else:
        with pytest.raises(UserError, match="expected 1e-30 to 1e\\+30"):
            chosen(inspection, scale="auto")


def test_contact_is_told_of_how_many_sensors(inspection):
    values, reasons = chosen(inspection, contact_sensors="auto")
    assert values == {"contact_sensors": 5} and "40 sensors" in reasons["contact_sensors"]
    assert "STAG" in reasons["contact_sensors"]
    live = np.arange(32 * 32).reshape(32, 32) < 548
    reason = chosen(replace(inspection, live=live), contact_sensors="auto")[1]["contact_sensors"]
    assert reason == "of 548 sensors"


def test_nothing_is_measured_of_single_frames_but_of_the_groups_that_are_given(glove):
    asked, split = settings("split.by=frame")
    assert decide(glove, asked, split).measurement is None
    group = glove.columns["recording"]
    assert decide(glove, asked, split, groups=group).measurement.baselines.keys() == {
        "empty_hand",
        "grasp",
        "quiet",
        "none",
    }
    fixed, _ = settings("preprocess.baseline=grasp", "preprocess.filter=contact", "preprocess.scale=100")
    decision = decide(glove, fixed, settings("split.by=recording")[1])
    assert decision.measurement is None and decision.choices == [] and decision.inspection is not None
    nothing, _ = settings("preprocess.baseline=none", "preprocess.filter=none", "preprocess.scale=100")
    assert decide(glove, nothing, split).inspection is None


def test_baselines_are_inspected_and_measured_on_training_groups(glove, monkeypatch):
    """The frames of the groups that the split holds out are in neither."""
    asked, split = settings("split.by=recording", "split.folds=2")
    given = {}
    real = module.inspect_recordings, module.possible_baselines, module.compare

    def inspect(recordings, hand, training):
        given["inspected"] = training
        return real[0](recordings, hand, training)

    def possible(recordings, hand, params):
        given["hand"] = hand
        return real[1](recordings, hand, params)

    def measure(recordings, inspection, baselines, params, group, training):
        given["measured"], given["params"] = training, params
        return real[2](recordings, inspection, baselines, params, group, training)

    for name, function in (("inspect_recordings", inspect), ("possible_baselines", possible), ("compare", measure)):
        monkeypatch.setattr(module, name, function)
    decide(glove, asked, split)
    assert 0 < given["inspected"].sum() < len(glove)
    np.testing.assert_array_equal(given["inspected"], given["measured"])
    hand, params = first_look(glove, asked)
    np.testing.assert_array_equal(given["hand"].open, hand.open)
    assert given["params"] == params
    decide(glove, asked, split, groups=glove.columns["recording"])
    assert given["inspected"].all() and given["measured"].all()


def test_the_decision_carries_the_baseline_that_it_names(glove):
    asked, split = settings("split.by=recording", "split.folds=2")
    decision = decide(glove, asked, split)
    assert decision.params.baseline == "empty_hand" == decision.choices[0].value
    np.testing.assert_array_equal(decision.baseline.of_frame, np.zeros(len(glove)))
    assert decision.baseline.mean.shape == (1, 5, 8) and decision.baseline.mean[0].mean() == pytest.approx(514.3, abs=1)


def test_filters_are_measured_above_the_baseline_that_is_taken(glove, inspection):
    asked, _ = settings()
    hand, params = first_look(glove, asked)
    baselines = possible_baselines(glove, hand, params)
    group, training = glove.columns["recording"], np.ones(len(glove), dtype=bool)
    measure = partial(compare, glove, group=group, training=training)
    for given in (params, replace(params, baseline="grasp")):
        measured = measure(inspection, baselines, given)
        assert measured.filters.keys() == {"contact"}
    among_none = {kind: baselines[kind] for kind in ("grasp", "quiet")}
    assert measure(inspection, among_none, replace(params, baseline="empty_hand")).filters == {}
    all_contact = replace(inspection, all_contact=True)
    assert measure(all_contact, baselines, params).baselines.keys() == {"none"}
    assert measure(all_contact, among_none, params).baselines.keys() == {"grasp", "quiet"}
    leaking = measure(inspection, {"none": baselines["none"]}, replace(params, baseline="none"))
    assert leaking.baselines.keys() == {"none"} and leaking.filters == {}


def test_contact_of_auto_is_a_fortieth_of_the_sensors_and_what_is_given_stays(glove):
    asked, _ = settings("preprocess.contact_sensors=auto")
    assert first_look(glove, asked)[1].contact_sensors == 2  # of 40
    assert first_look(glove, settings()[0])[1].contact_sensors == 5
    given, _ = settings("preprocess.baseline=none", "preprocess.zero=400")
    assert first_look(glove, given)[1].zero == 400
    assert first_look(glove, settings()[0])[1].zero == pytest.approx(512, abs=3)
