"""`tactile-viewgcn compare` prints the differences of two runs, and refuses unlike runs."""

from dataclasses import replace

import pytest

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.pages import comparison
from tactile_viewgcn.pages.comparison import comparison_lines, read_both
from tests.pages.test_outcome import RIGHT, finished

SECONDS = {"pretrain": 10.0, "evaluate": 2.0, "total": 12.0}


def run(name, answers, *, md5="ab", **changes):
    """Return a finished run.

    Args:
        name: name of the run.
        answers: see `finished`.
        md5: digest of its recordings.
        changes: see `finished`.
    """
    finished_run = finished(answers, **changes)
    source = {"source": {"path": "my glove", "md5": md5}}
    finished_run.records["ingest"] = replace(
        finished_run.records["evaluate"], stage="ingest", inputs=source
    )
    finished_run.timing["seconds"] = SECONDS
    finished_run.name = name
    return finished_run


def test_what_differs_and_whether_it_can_be_told():
    worse = [[1] * 12, [1] * 12, [2] * 12]
    first = run("first", RIGHT, views=8)
    second = run("second", worse, views=4)
    second.timing["seconds"] = SECONDS | {"pretrain": 7.5}
    lines = comparison_lines(first, second)
    assert lines[0] == "second compared with first, 36 split groups in common"
    assert "  views=8 -> 4" in lines
    whole = lines[lines.index("") + 1 :]
    assert whole[0].startswith("whole recordings")
    assert "0.0 -> 33.3 %  +33.3 points (" in whole[0]
    assert whole[1] == "  second has the higher error"
    assert "  ball: 0 -> 12 of 12" in lines
    assert "  pretrain          10.0 ->       7.5  -2.5" in lines
    assert max(map(len, lines)) < 80


def test_the_same_run_twice_has_no_difference():
    lines = comparison_lines(run("", RIGHT), run("again", RIGHT))
    assert lines[0] == "again compared with the workspace, 36 split groups in common"
    assert lines[1] == "  all parameters are equal"
    assert "  both give the same answers" in lines
    assert not any("changed most" in line for line in lines)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"md5": "cd"}, "different recordings.*the files of data.source have changed"),
        ({"md5": "cd", "glove_seed": 1}, "different recordings.*glove.seed=null and 1"),
        ({"split_folds": 4}, "different parts of the recordings: split.folds=3 and 4"),
        ({"evaluate_side": "validation"}, "different parts of the recordings: evaluate.side="),
    ],
)
def test_runs_on_other_recordings_or_another_split_are_refused_in_one_line(changes, words):
    with pytest.raises(UserError, match=words) as error:
        comparison_lines(run("first", RIGHT), run("second", RIGHT, **changes))
    assert "\n" not in str(error.value)


def test_a_is_the_commit_or_without_its_results_the_workspace(monkeypatch):
    here = {"workspace", "HEAD", "best"}

    def read(name):
        if name not in here:
            raise UserError(f"{name}: no runs/ingest.json")
        return name

    monkeypatch.setattr(comparison, "read_run", read)
    assert read_both([]) == ("HEAD", "workspace")
    assert read_both(["best"]) == ("HEAD", "best")
    assert read_both(["workspace", "best"]) == ("workspace", "best")
    here.remove("HEAD")
    assert read_both(["best"]) == ("workspace", "best")
    with pytest.raises(UserError, match="the workspace's commit are not here"):
        read_both([])
    with pytest.raises(UserError, match="worst: no runs"):
        read_both(["worst"])
    with pytest.raises(UserError, match="two runs; got 3"):
        read_both(["a", "b", "c"])
