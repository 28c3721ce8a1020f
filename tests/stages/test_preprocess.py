"""The stage preprocess at its command line: what it decides, warns of and refuses."""

import json

import numpy as np

from tests.stag_files import metadata
from tests.stages.running import ingest, left, preprocess, refused


def test_what_was_decided_stands_in_the_record_beside_what_was_asked(place):
    ingest(place, metadata(objects=3, frames=30, blank=8))
    result = preprocess(place, "preprocess.contact_sensors=14")
    record = json.loads((place / "preprocess.json").read_text())
    asked, counts = record["params"]["values"], record["counts"]
    assert (asked["preprocess.baseline"], counts["resolved.preprocess.baseline"]) == ("auto", "empty_hand")
    assert (asked["preprocess.filter"], counts["resolved.preprocess.filter"]) == ("auto", "flags")
    assert "resolved.preprocess.contact_sensors" not in counts
    assert "  preprocess.baseline empty_hand: recorded in every session" in result.stdout
    assert "preprocess.scale" in {note["key"] for note in record["notes"]}


def test_objects_that_frames_without_contact_give_away_are_warned_of(place):
    tree = metadata(objects=4, frames=30, blank=14)
    sensors = tree["pressure"].min(axis=0) < tree["pressure"].max(axis=0)
    offsets = np.random.default_rng(0).choice([-3, 3], (4, 32, 32)) * sensors
    offsets[0] = 0
    ingest(place, tree | {"pressure": tree["pressure"] + offsets[tree["objectId"].ravel()].astype(np.int16)})
    for baseline, warned in (("empty_hand", True), ("grasp", False)):
        result = preprocess(place, "split.by=recording", f"preprocess.baseline={baseline}")
        record = json.loads((place / "preprocess.json").read_text())
        counts = record["counts"]
        assert counts["recordings.train"] + counts["recordings.test"] == 12
        leak_notes = [note for note in record["notes"] if note["topic"] == "leak check"]
        assert ("warning" in {note["level"] for note in leak_notes}) == warned, result.stderr
        assert (counts["leak.high"] < counts["leak.chance"]) == warned and counts["leak.groups"] == 9
        assert f"error of {100 * counts['leak.error']:.1f} %" in leak_notes[0]["text"]


def test_an_empty_side_is_refused_in_one_line_and_nothing_is_left(place):
    tree = metadata(objects=3, frames=10)
    ingest(place, tree | {"splitId": np.ones_like(tree["splitId"])})
    assert "the train side of split.by source" in refused(preprocess(place)) and left(place) == set()
