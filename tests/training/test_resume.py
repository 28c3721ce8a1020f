"""Training stages that are interrupted and started again."""

import shutil

import pytest
import torch

from tactile_viewgcn.tables.frames import save_table
from tactile_viewgcn.training import loop
from tests.glove_data import FILE, SMALL, pretrained, recipe, table, views_of
from tests.stages.running import changed, run_stage

STAGES = {
    "pretrain": "--needs needs.json --frames frames --out out.pt",
    "finetune": "--frames frames --views views --backbone backbone.pt --out out.pt",
}


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_that_was_interrupted_goes_on_and_ends_as_one_that_was_not(tmp_path, monkeypatch, stage):
    shutil.copy(FILE, tmp_path)
    (tmp_path / "needs.json").write_text('{"pretrain": true}')
    save_table(tmp_path / "frames", table())
    save_table(tmp_path / "views", views_of(table(), recipe()))
    torch.save(pretrained(), tmp_path / "backbone.pt")
    out, words = tmp_path / "out.pt", STAGES[stage].split() + changed(*SMALL, "precision=float32", "finetune.epochs=2")
    save = loop.save

    def stop(*state):
        save(*state)
        raise KeyboardInterrupt

    assert "before an interruption" not in run_stage(stage, *words, cwd=tmp_path).stdout
    whole = out.read_bytes()
    out.unlink()
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(loop, "save", stop)
        run_stage(stage, *words, cwd=tmp_path)
    assert not out.exists() and len(list(tmp_path.glob(f"checkpoints/{stage}-*.pt"))) == 1
    assert "1 of them before an interruption" in run_stage(stage, *words, cwd=tmp_path).stdout
    assert out.read_bytes() == whole and not list(tmp_path.glob("checkpoints/*.pt"))
