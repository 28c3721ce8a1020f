"""The table of mutmut's results."""

import json

from click.testing import CliRunner

from benchmarks.mutation.__main__ import main


def test_a_row_counts_the_mutants_of_a_folder_and_those_that_no_test_ran_are_no_fault(tmp_path):
    codes = {"views/sampling": [1, 3, 0, None], "nn/graph": [33, 36, 1, None], "nn/loss": [-11]}
    for module, of_module in codes.items():
        path = tmp_path / "mutants" / f"{module}.py.meta"
        path.parent.mkdir(parents=True, exist_ok=True)
        names = [f"tactile_viewgcn.{module.replace('/', '.')}.x_{number}" for number in range(len(of_module))]
        path.write_text(json.dumps({"exit_code_by_key": dict(zip(names, of_module, strict=True))}))
    done = CliRunner().invoke(main, ["--mutants", str(tmp_path / "mutants"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0 and done.output.splitlines()[-1] == "views.sampling.x_2"
    assert (tmp_path / "out" / "results.csv").read_text().splitlines()[1:] == [
        "nn,5,4,1,2,0,1,100.0",
        "views,4,3,2,0,1,0,66.7",
        "all,9,7,3,2,1,1,83.3",
    ]
