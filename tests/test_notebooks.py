"""The notebooks of docs/notebooks: they run, and their committed output is what they print."""

import base64
import re
from pathlib import Path

import nbclient
import nbformat
import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
MOST_BYTES = 600_000  # of a notebook with its pictures
# Numbers that a notebook prints, and how far a new one can be from the committed one. Another
# machine adds in another order, so a few answers can change.
NUMBERS = {
    "own_glove": {
        r"(\d+) recordings, each": 0,
        r"([\d,]+) frames of 32 x 32": 0,
        r"(\d+) % of the frames count as contact": 3,
        r"([\d.]+) % is a first estimate": 13,
        r"error rate: ([\d.]+)": 13,
        r"error rate: [\d.]+ \([\d.]+ to ([\d.]+)\)": 15,
        r"(\d+) of 24 recordings wrong": 3,
        r"([\d.]+) s  final   cat": 1,
    },
    "paper": {
        r"(\d+) frames in contact": 5,
        r"(\d+) of them in the test set": 5,
        r"pretraining: loss .*, ([\d.]+) in the last": 0.3,
        r"fine-tuning: loss ([\d.]+)": 3,
        r"fine-tuning: loss .*, ([\d.]+) in the last": 0.5,
    },
}


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def kinds(cell) -> list[tuple[str, ...]]:
    """Return the kinds of a cell's outputs: streams by their names, data by their types."""
    of_outputs = []
    for output in cell.outputs:
        types = sorted(output.get("data", {}))
        of_outputs.append((output.output_type, output.get("name", ""), *types))
    return of_outputs


def inspected(notebook) -> str:
    """Return the text of `tactile-viewgcn inspect`, in one line, with # in place of numbers."""
    cells = [cell for cell in code_cells(notebook) if '"inspect"' in cell.source]
    text = "".join(output.text for cell in cells for output in cell.outputs)
    return re.sub(r"[\d.,]+", "#", " ".join(text.split()))


def printed(notebook) -> str:
    """Return all text that the cells printed."""
    texts = []
    for cell in code_cells(notebook):
        texts += [output.text for output in cell.outputs if output.output_type == "stream"]
    return "".join(texts)


def number(pattern: str, text: str) -> float:
    """Return the number that the pattern's group matches."""
    match = re.search(pattern, text)
    assert match, f"{pattern} is not in the output:\n{text}"
    return float(match[1].replace(",", ""))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_committed_with_the_output_of_one_run_from_top_to_bottom(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert [cell.execution_count for cell in cells] == list(range(1, 1 + len(cells)))
    assert path.stat().st_size < MOST_BYTES
    outputs = [output for cell in cells for output in cell.outputs]
    tables = [output.get("data", {}).get("text/html", "") for output in outputs]
    for folder in (str(ROOT), "/tmp/", "site-packages"):
        assert folder not in printed(notebook) + "".join(tables), folder
    assert all(output.get("name") != "stderr" for output in outputs)
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) >= 3
    for picture in pictures:
        assert len(picture.metadata["image/png"]["alt"]) > 20
        assert base64.b64decode(picture.data["image/png"]).startswith(b"\x89PNG")


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_committed(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    folder = tmp_path / "work"
    folder.mkdir()
    committed = nbformat.read(path, as_version=4)
    new = nbformat.read(path, as_version=4)
    for cell in code_cells(new):
        cell.outputs = []
    client = nbclient.NotebookClient(
        new,
        timeout=500,
        kernel_name="python3",
        coalesce_streams=True,  # on a busy machine two prints can come as two outputs
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute()  # raises what a cell raises

    for before, after in zip(code_cells(committed), code_cells(new), strict=True):
        assert kinds(after) == kinds(before), after.source
    text = printed(new)
    assert inspected(new) == inspected(committed)
    assert str(tmp_path) not in text
    checks = re.findall(r"(?:equal|same).*: (\w+)", text)
    assert checks and set(checks) == {"True"}
    for pattern, tolerance in NUMBERS[path.stem].items():
        expected = number(pattern, printed(committed))
        assert number(pattern, text) == pytest.approx(expected, abs=tolerance), pattern
