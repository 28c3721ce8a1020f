"""Run ten trials on the test set, and answer its recordings once, as new ones and as a stream."""

from functools import partial
from pathlib import Path

from stages.command import run
from stages.job import Job
from tactile_viewgcn.evaluation import earlier_stages, results
from tactile_viewgcn.evaluation.as_new import right_as_new
from tactile_viewgcn.evaluation.evaluate import evaluate_table, evaluated_frames, latency
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.live import answer_live
from tactile_viewgcn.evaluation.row import log_row
from tactile_viewgcn.evaluation.versus import next_line, versus_head
from tactile_viewgcn.pages.card import model_card
from tactile_viewgcn.pages.run_page import run_page
from tactile_viewgcn.provenance import ROW, peak_mb
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.frames import Frames, load_table
from tactile_viewgcn.tables.recordings import Recordings


def evaluate(
    job: Job, recordings: Path, frames: Path, classifier: Path, records: Path, out: Path
) -> str:
    """Evaluate the classifier, and return the lines to print."""
    table = load_table(frames, Frames)
    recogniser = Recogniser(classifier)
    earlier = earlier_stages.read_records(records)
    for stage in earlier:
        job.record.inputs[stage] = {"path": str(records / f"{stage}.json")}
        job.md5(stage)  # by which `report` sees that a stage ran again
    temperature = recogniser.content.temperature
    predictions, metrics = evaluate_table(
        recogniser.classifier, table, job.params, job.compute(), temperature=temperature
    )
    whole = predictions.whole
    metrics |= earlier_stages.new_session(earlier)
    inputs = evaluated_frames(recogniser.classifier, table, job.params)
    latency_ms = latency(recogniser.classifier, inputs, table.live, whole.frames)
    raw = Recordings.read(recordings)
    is_right, notes = right_as_new(recogniser, raw, table, whole, job.params)
    live, live_notes = answer_live(recogniser.stream, raw, table, whole, is_right, job.params)
    notes += live_notes
    timing = earlier_stages.costs(latency_ms, earlier, job.seconds, peak_mb())
    finished = FinishedRun("", metrics, timing, predictions, earlier | {ROW: job.record}, live)
    versus = versus_head(finished)
    numbers = results.summary(metrics, timing)
    if versus:
        numbers |= versus.numbers
        notes.append(versus.note)
    for note in notes:
        job.note(note)
    results.write_results(out, predictions, metrics, timing, numbers, live)
    for folder in (out, records):
        job.run.log("log_artifacts", str(folder))
    lines = results.summary_lines(metrics, timing, live)
    card = partial(model_card, recogniser=recogniser)
    lines += log_row(
        job.run, finished, numbers, versus, model=classifier, table=table, page=run_page, card=card
    )
    return "\n".join([*lines, f"  next: {next_line(job.record, versus)}"])


if __name__ == "__main__":
    run(evaluate, "recordings", "frames", "classifier", "records")
