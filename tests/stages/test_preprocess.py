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
    assert "leak check" in {note["topic"] for note in record["notes"]} and counts["classes"] == 3


def test_an_empty_side_is_refused_in_one_line_and_nothing_is_left(place):
    tree = metadata(objects=3, frames=10)
    ingest(place, tree | {"splitId": np.ones_like(tree["splitId"])})
    assert "the train side of split.by source" in refused(preprocess(place)) and left(place) == set()
