"""`python -m benchmarks.mutation`: the table of what mutmut found in this clone; docs/contributing.md starts mutmut."""

import ast
import json
from collections import Counter
from pathlib import Path

import click

from benchmarks.command import markdown, write_table

MUTANTS = Path("mutants/tactile_viewgcn")  # where mutmut keeps its results, a .meta file for each module
VERDICTS = {0: "survived", 1: "found", 3: "found", 33: "no test", 5: "no test", None: ""}  # by pytest's exit code
OTHERS = "found by time or memory"  # ended by mutmut's limit, or by a signal
WORDING = "wording"  # see `sentences_left_out`
COLUMNS = ("found", OTHERS, "survived", "no test", WORDING)
TEXT = """A mutant is the code with one operator, constant or argument changed (mutmut 3). It is `found` if one
of the tests of the seven folders that run the changed function fails, or never ends. `no test`: none of them runs it in
its own process; those of the stages may. `wording`: only a sentence for people changed, which no test reads, by rule;
these count neither as found nor as tried."""


@click.command()
@click.option("--mutants", type=click.Path(exists=True, path_type=Path), default=MUTANTS, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default="benchmarks/mutation", show_default=True)
def main(mutants: Path, out: Path) -> None:
    """Write OUT/results.csv and .md, a row for each folder, and print the mutants that no test found."""
    verdicts = read_verdicts(mutants)
    rows = rows_of(verdicts)
    write_table(out, rows, TEXT)
    print("\n".join([markdown(rows), *(name for name, verdict in verdicts.items() if verdict == "survived")]))


def read_verdicts(folder: Path) -> dict[str, str]:
    """What became of each mutant, by its name without the package; "" where it was not tried."""
    verdicts = {}
    for path in sorted(folder.rglob("*.meta")):
        functions = sentences_left_out(path.with_suffix("").read_text())
        for name, code in json.loads(path.read_text())["exit_code_by_key"].items():
            mutant = name.rpartition(".")[2]
            same = functions[mutant] == functions[mutant.rpartition("_")[0] + "_orig"]
            verdict = VERDICTS.get(code, OTHERS)
            verdicts[name.removeprefix("tactile_viewgcn.")] = WORDING if same and verdict else verdict
    return verdicts


def sentences_left_out(module: str) -> dict[str, str]:
    """The functions of a module, by name, as trees without their names and without texts that hold a blank."""
    functions = {}
    for function in ast.walk(ast.parse(module)):
        if isinstance(function, ast.FunctionDef) and "__mutmut_" in function.name:
            texts = [node for node in ast.walk(function) if isinstance(node, ast.Constant)]
            for node in texts:
                node.value = "" if isinstance(node.value, str) and " " in node.value else node.value
            functions[function.name] = "".join(map(ast.dump, function.body))
    return functions


def rows_of(verdicts: dict[str, str]) -> list[dict]:
    """A row for each folder of the package, and one of all."""
    counts: dict[str, Counter] = {}
    for name, verdict in verdicts.items():
        for folder in (name.split(".")[0], "all"):
            counts.setdefault(folder, Counter())[verdict] += 1
    rows = []
    for folder in [*(each for each in counts if each != "all"), "all"]:
        count = counts[folder]
        tried = count.total() - count[""] - count[WORDING]
        ran = tried - count["no test"]
        share = 100 * (count["found"] + count[OTHERS]) / ran if ran else float("nan")
        row = {"folder": folder, "mutants": count.total(), "tried": tried}
        rows.append(row | {name: count[name] for name in COLUMNS} | {"found, %": f"{share:.1f}"})
    return rows


if __name__ == "__main__":
    main()
