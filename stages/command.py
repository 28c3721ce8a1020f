"""What every stage's command line shares: parameters, tracking, errors in one line, the record of its run."""

import json
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click

from tactile_viewgcn import tracking
from tactile_viewgcn.files import whole
from tactile_viewgcn.params import Params, flat, load
from tactile_viewgcn.preset import PRESETS, preset_changes


class Input(click.Path):
    """An option that names a file the stage reads."""


LATER = ("diverged_in_epoch",)  # metrics that stages to come are told by the record
INPUT, OUTPUT = Input(path_type=Path), click.Path(path_type=Path)


def stage(*reads: str, row: bool = False) -> Callable[[Callable], click.Command]:
    """A click command from `body(params, run, **paths)`.

    Args:
        reads: the keys of params.yaml, or `section.part`, that the body is given, the same as in dvc.yaml; no others.
        row: the run carries every parameter of params.yaml, as the row that people compare.

    The command ends with exit code 1 and one line where the user can mend what is wrong, and writes the run's
    id, seconds and peak memory to `--record`. The body may return metrics, which are logged; the seconds of one that
    goes on where an earlier run was interrupted include that run's.
    """

    def wrap(body: Callable[..., dict[str, float] | None]) -> click.Command:
        @click.option("--params", "params_path", type=OUTPUT, default="params.yaml", show_default=True)
        @click.option("--preset", type=click.Choice(PRESETS), help="Put on top of params.yaml.")
        @click.option("--set", "changes", multiple=True, metavar="KEY=VALUE", help="Put on top of both.")
        @click.option("--record", type=OUTPUT, required=True, help="Where the run's id and its costs are written.")
        @click.option("--debug", is_flag=True, help="Show the traceback of an error.")
        @click.pass_context
        def command(
            context: click.Context,
            params_path: Path,
            preset: str | None,
            changes: tuple[str, ...],
            record: Path,
            debug: bool,
            **paths: Any,
        ) -> None:
            try:
                params = load(params_path, (*(preset_changes(preset) if preset else ()), *changes))
                given = _given(params, reads)
                logged = flat(params) if row else _declared(params, reads)
                _run(body, given, logged, _inputs(context, paths), record, paths)
            except (ValueError, OSError, MemoryError, RuntimeError) as error:
                if debug or not _expected(error):
                    raise
                raise click.ClickException(" ".join(str(error).split()) or "out of memory") from None

        command.__click_params__ = body.__click_params__ + command.__click_params__
        made = click.command(body.__name__, help=body.__doc__)(command)
        made.reads = reads
        return made

    return wrap


def _run(
    body: Callable,
    given: SimpleNamespace,
    logged: dict[str, Any],
    inputs: dict[str, Path],
    record: Path,
    paths: dict[str, Any],
) -> None:
    begin = time.perf_counter()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # `dvc queue kill`: the run is closed, nothing half-written
    with tracking.stage_run(body.__name__) as run:
        run.inputs(inputs)
        run.parameters(logged)
        metrics = body(given, run, **paths) or {}
        before = metrics.get("seconds_before_interruption", 0.0)
        costs = {"seconds": before + time.perf_counter() - begin, "peak_mb": peak_mb()}
        run.metrics(metrics | costs)
        with whole(record) as part:
            known = {name: metrics[name] for name in LATER if name in metrics}
            part.write_text(json.dumps({"stage": body.__name__, "run_id": run.id, **costs, **known}, indent=2) + "\n")


def _expected(error: Exception) -> bool:
    """Whether the user can mend it; any other RuntimeError is a fault of ours and shows its traceback."""
    out_of_memory = isinstance(error, MemoryError) or "memory" in str(error)
    return out_of_memory or isinstance(error, ValueError | OSError | tracking.TrackingError)


def _declared(params: Params, reads: tuple[str, ...]) -> dict[str, Any]:
    """The values of these keys and sections under their dotted keys."""
    return {key: value for key, value in flat(params).items() if any(f"{key}.".startswith(f"{r}.") for r in reads)}


def _given(params: Params, reads: tuple[str, ...]) -> SimpleNamespace:
    """The keys and sections that a stage reads; of a section of which it reads a part, that part."""
    found = SimpleNamespace()
    for key in reads:
        section, _, part = key.partition(".")
        value = getattr(params, section)
        setattr(found, section, SimpleNamespace(**{part: getattr(value, part)}) if part else value)
    return found


def _inputs(context: click.Context, paths: dict[str, Any]) -> dict[str, Path]:
    """The files that the stage reads, each there."""
    found = {}
    for option in context.command.params:
        if isinstance(option.type, Input):
            many = paths[option.name] if option.multiple else [paths[option.name]]
            found |= {option.name if not option.multiple else path.stem: path for path in many}
    for path in found.values():
        if not path.exists():
            raise FileNotFoundError(
                f"{path}: no such file or folder; `dvc repro` makes what a stage reads, "
                "and data.source in params.yaml names what ingest reads"
            )
    return found


def peak_mb() -> float:
    """The most memory this process has held, in MB (10^6 bytes)."""
    status = Path("/proc/self/status")
    if status.exists():  # Linux, whose ru_maxrss would count the process that started this one
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
