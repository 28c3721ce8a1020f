"""The files that a frame passes on its way from the source to the answer.

They stand in a list, so that a reviewer sees when the list grows.
"""

from tests.imports import ROOT, imported_files

STAGES = ("ingest", "preprocess", "cluster", "pretrain", "finetune", "evaluate")
# imports the estimator for users, which no stage needs
NOT_ON_THE_ROAD = {"tactile_viewgcn/__init__.py"}


def test_the_stages_import_the_listed_files():
    starts = [*(f"stages/{name}.py" for name in STAGES), "tactile_viewgcn/systems/view_gcn.py"]
    imported = set()
    for start in starts:
        imported |= imported_files(start, NOT_ON_THE_ROAD)
    listed = (ROOT / "tests/road.txt").read_text().split()
    assert sorted(imported) == listed, "the stages import other files: change tests/road.txt too"
