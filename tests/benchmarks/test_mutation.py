"""The table of mutmut's results."""

import json

from click.testing import CliRunner

from benchmarks.mutation.__main__ import main


def test_a_row_counts_the_mutants_of_a_folder_without_those_of_sentences_and_those_that_no_test_ran(tmp_path):
    codes = {"views/sampling": [1, 3, 0, None, 0, 1], "nn/graph": [33, 36, 1, None], "nn/loss": [-11]}
    for module, of_module in codes.items():
        path = tmp_path / "mutants" / f"{module}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        changes = ["f('a word')", *(f"f({number})" for number in range(len(of_module)))]
        if module == "views/sampling":
            changes[5:] = "f('other words')", "f('word')"
        variants = zip(("orig", *range(len(of_module))), changes, strict=True)
        path.write_text("\n".join(f"def x__mutmut_{name}():\n    return {change}\n" for name, change in variants))
        names = [f"tactile_viewgcn.{module.replace('/', '.')}.x__mutmut_{number}" for number in range(len(of_module))]
        meta = json.dumps({"exit_code_by_key": dict(zip(names, of_module, strict=True))})
        path.with_suffix(".py.meta").write_text(meta)
    done = CliRunner().invoke(main, ["--mutants", str(tmp_path / "mutants"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0 and done.output.splitlines()[-1] == "views.sampling.x__mutmut_2"
    assert (tmp_path / "out" / "results.csv").read_text().splitlines()[1:] == [
        "nn,5,4,1,2,0,1,0,100.0",
        "views,6,4,3,0,1,0,1,75.0",
        "all,11,8,4,2,1,1,1,85.7",
    ]
