"""Runs that do without something, each in a process of its own that then says which libraries it has imported.

`python -m studies.stability.lean unclustered FOLDER VIEWS`: the stages from the frames in that folder on, without
clusters, and with a trained classifier. `python -m studies.stability.lean help`: the command line's help.
"""

import sys
from pathlib import Path

LIBRARIES = ("torch", "scipy", "sklearn", "mlflow")
PARAMS = Path(__file__).parents[2] / "params.yaml"


def unclustered(folder: str, views: str) -> None:
    """The cluster and the evaluate stage, by their own commands."""
    from stages.cluster import cluster
    from stages.evaluate import evaluate
    from tactile_viewgcn import evaluation

    evaluation.SINGLE_REPEATS = evaluation.BATCH_REPEATS = 1
    changes = ("cluster.method=none", "evaluate.trials=1", "evaluate.stop_at=0", f"views={views}", "viewpoints=sphere")
    given = ["--params", str(PARAMS), *(word for change in changes for word in ("--set", change))]
    given += ["--frames", f"{folder}/frames.h5"]
    cluster([*given, "--out", f"{folder}/views.h5", "--record", f"{folder}/cluster.json"], standalone_mode=False)
    outputs = ["--out", f"{folder}/results", "--record", f"{folder}/evaluate.json"]
    evaluate([*given, "--classifier", f"{folder}/classifier.pt", *outputs], standalone_mode=False)


def command_line_help() -> None:
    """What `tactile-viewgcn --help` does."""
    from tactile_viewgcn.cli import main

    sys.argv = ["tactile-viewgcn", "--help"]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise


if __name__ == "__main__":
    {"unclustered": unclustered, "help": command_line_help}[sys.argv[1]](*sys.argv[2:])
    print("imported", *(name for name in LIBRARIES if name in sys.modules))
