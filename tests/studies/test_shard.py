"""Which cells a shard has."""

from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from studies.shard import read_shard, shards

from studies import __main__ as main_module
from studies import cells as cells_module
from studies.__main__ import main
from studies.cells import code_of_stages, key_of
from studies.grid import Cell, read_study
from tactile_viewgcn.errors import UserError

SYSTEMS = ("view_gcn", "mvcnn", "trees", "lda")
CELLS = {
    f"{system} {seed} {fold}": Cell(
        system, seed, 0, fold, (f"model.system={system}", f"seed={seed}", "split.folds=3", f"split.fold={fold}")
    )
    for seed in range(2)
    for system in SYSTEMS
    for fold in range(3)
}  # 12 with a backbone, of which two share each, and 12 without


@settings(deadline=None, max_examples=20)
@given(keys=st.sets(st.sampled_from(sorted(CELLS))), count=st.integers(1, 30))
def test_every_cell_is_in_exactly_one_shard_and_the_shards_are_as_large_as_each_other(keys, count):
    cells = {key: cell for key, cell in CELLS.items() if key in keys}
    parts = shards(cells, count)
    assert len(parts) == count and sorted(key for part in parts for key in part) == sorted(keys)
    assert all(cell is CELLS[key] for part in parts for key, cell in part.items())
    for systems in (SYSTEMS[:2], SYSTEMS[2:]):
        sizes = [sum(cell.variant in systems for cell in part.values()) for part in parts]
        assert max(sizes) - min(sizes) <= 1


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_cells_that_share_a_backbone_are_in_the_same_shard(count):
    places = {}
    for number, part in enumerate(shards(CELLS, count)):
        for cell in part.values():
            if cell.variant in SYSTEMS[:2]:
                places.setdefault((cell.seed, cell.fold), set()).add(number)
    assert len(places) == 6 and all(len(numbers) == 1 for numbers in places.values())


@pytest.mark.parametrize("text", ["0/2", "3/2", "x", "1", "1/0", "-1/2", "1/2/3", "1.0/2", "²/3", ""])
def test_a_wrong_shard_is_one_line(text):
    with pytest.raises(UserError, match="expected i/n"):
        read_shard(text)
    result = CliRunner().invoke(main, ["folds", "--shard", text])
    assert result.exit_code == 1
    assert result.output.count("\n") == 1 and f"--shard is {text!r}; expected i/n" in result.output


def test_a_shard_of_a_rehearsal_runs_its_part_and_writes_no_report(tmp_path, monkeypatch):
    ran, code = [], code_of_stages()
    whole = [key_of(cell, code) for cell in read_study("compare").cells(quick=True)]
    finished = {f"compare-{whole[0]}": "a commit that was pulled"}

    def run_cells(name, cells, queue, *, jobs):
        ran.append(list(cells))
        return {}

    monkeypatch.setattr(cells_module, "STORE", tmp_path)
    monkeypatch.setattr(main_module, "run_cells", run_cells)
    monkeypatch.setattr(main_module, "DvcQueue", lambda: SimpleNamespace(finished=lambda: finished))
    monkeypatch.setattr(main_module, "read_answers", lambda cell, key: None)
    monkeypatch.setattr("studies.report.write_report", lambda *words, **more: pytest.fail("a shard's report"))
    told = []
    for shard in ("1/2", "2/2"):
        result = CliRunner().invoke(main, ["compare", "--quick", "--shard", shard])
        assert result.exit_code == 0, result.output
        told.append(result.output.splitlines()[1])
    assert ran[0] and ran[1] and sorted(ran[0] + ran[1]) == sorted(whole)
    assert told == [
        f"compare, shard {number} of 2: {len(keys)} cells, {int(whole[0] in keys)} of them finished before"
        for number, keys in enumerate(ran, start=1)
    ]
