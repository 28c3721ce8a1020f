"""The page of an inspection shows the facts of a glove, which are known."""

import base64
import re
import shlex
from copy import copy
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

from studies.grid import read_study
from tactile_viewgcn.intervals import FEW
from tactile_viewgcn.messages import Note
from tactile_viewgcn.pages import channels as channels_module
from tactile_viewgcn.pages import html, inspection
from tactile_viewgcn.pages.channels import channel_curves
from tactile_viewgcn.pages.inspection import WIDTH, inspection_lines, inspection_page
from tactile_viewgcn.pages.inspection_commands import command_lines, each_fold_lines
from tactile_viewgcn.pages.inspection_facts import checks, facts, verdict, warnings
from tactile_viewgcn.pages.source_inspection import grid_notes, inspect_source, split_settings
from tactile_viewgcn.params import PreprocessSection, default_params
from tactile_viewgcn.readers.source import Form
from tests.pages.test_html import parsed, text_of

NAMES = ["Öl & <b>", "mug", "$x$"]


@pytest.fixture(scope="module")
def overview(tmp_path_factory):
    """Return the inspection of three objects, with four recordings each.

    A frame has 8 x 12 sensors of real numbers, and one sensor is dead.
    """
    rng = np.random.default_rng(0)
    folder = tmp_path_factory.mktemp("glove") / "my glove"
    folder.mkdir()
    load = np.clip(np.sin(np.arange(60) / 60 * 4 * np.pi), 0, None)[:, None, None]
    for label, name in enumerate(NAMES):
        shape = rng.uniform(0.5, 2.0, (8, 12)) * (rng.random((8, 12)) < 0.4)
        for repeat in range(4):
            pressure = load * shape + 0.02 * rng.standard_normal((60, 8, 12))
            pressure[:, 7, 11] = 0
            with h5py.File(folder / f"{label} {repeat}.h5", "w") as file:
                file["pressure"] = pressure.astype(np.float32)
                file.attrs.update({"object": name, "session": f"s{repeat % 2}"})
    return inspect_source(folder)


def test_the_page_shows_the_facts_and_the_settings(overview):
    page = inspection_page(overview)
    text = text_of(page)
    assert page.startswith("<!DOCTYPE html>")
    assert "12 recordings of 3 objects in 2 sessions" in text
    assert "95 of 96 sensors vary; row " in text
    assert " reads the same in all frames and is not used" in text
    assert all(name in text for name in NAMES) and "-S 'data.source=\"" in text
    assert all(note.text in text and note.key in text for note in overview.settings)
    # most healthy sensors are pressed by no object
    assert verdict(overview, warnings(overview)).kind == "open"
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"})
    assert facts(changed(overview, rates={0: 20.0, 1: 21.0}))[4] == ("20.5 Hz", "is the frame rate")
    assert facts(changed(overview, rates={0: 20.0, 1: 40.0}))[4][0] == "20 to 40 Hz"


def test_a_page_never_gives_an_all_clear_and_lists_what_was_checked_and_what_cannot_be(overview):
    page = text_of(inspection_page(overview))
    lines = " ".join(" ".join(inspection_lines(overview)).split())
    for text in (page, lines):
        assert warnings(overview) == []
        assert "Yes" not in text
        assert "nothing was found that would" not in text
        assert "What was checked" in text
        assert "units that differ four times or more" in text
        assert "What the files cannot tell" in text
        assert "augmented" in text
        assert "windows" in text
        assert f"{100 * overview.error.error:.1f} %, is too low" in text
    topics = ("unit", "unit", "names")
    rows = checks(overview, [Note("", "warning", topic) for topic in topics])
    outcomes = {row.what: (row.outcome, row.warned) for row in rows}
    assert outcomes["units that differ four times or more"] == ("2 warnings", True)
    assert outcomes["all else"] == ("1 warning", True)
    assert outcomes["columns that are no sensor"] == ("nothing found", False)
    assert outcomes["times and frame rates"] == ("not checked: no times", False)


def test_how_readings_move_is_not_checked_where_every_recording_is_one_frame(overview):
    ones = np.ones_like(overview.counts["frames"])
    rows = checks(changed(overview, counts=overview.counts | {"frames": ones}), [])
    assert [row.what for row in rows if "every recording is one frame" in row.outcome] == [
        "recordings or sensors that stand still",
        "equal frames at the ends of recordings",
        "units that differ four times or more",
        "columns that are no sensor",
    ]
    assert not [row.what for row in checks(overview, []) if "one frame" in row.outcome]


@pytest.fixture(scope="module")
def channels(tmp_path_factory):
    """Return the inspection of three objects with four recordings each.

    They have five channels in different units. The name of one channel looks like a tag.
    """
    rng = np.random.default_rng(0)
    folder = tmp_path_factory.mktemp("glove") / "channels"
    scale = np.array([100, 60, 30, 0.1, 0.002])
    for label, name in enumerate(("ball", "mug", "pen")):
        for repeat in range(4):
            bend = np.linspace(0, label, 50)[:, None] * (np.arange(5) < 3)
            readings = scale * (5 * (np.arange(5) < 2) + bend + 0.1 * rng.standard_normal((50, 5)))
            header = "index,thumb,yaw,ax,<b>"
            path = folder / name / f"{repeat}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savetxt(path, readings, fmt="%.5f", delimiter=",", header=header, comments="")
    return inspect_source(folder)


def test_channels_are_shown_as_curves_on_a_scale_each_and_nothing_is_said_of_contact(channels):
    page = inspection_page(channels)
    text = text_of(page)
    head = text.partition("What to do next")[0]
    objects = text.partition("Objects")[2].partition("Words")[0]
    for word in ("pressure", "contact", "open hand", "Pictures"):
        assert word not in head + objects
    assert "contact" not in "\n".join(inspection_lines(channels)).partition("Can they be used?")[0]
    svg = "data:image/svg+xml;base64,"
    pictures = [address for address in parsed(page).addresses if address.startswith(svg)]
    assert len(pictures) == 3
    for picture in pictures:
        drawn = base64.b64decode(picture.partition(",")[2]).decode()
        assert all(f">{name}<" in drawn for name in ("index", "thumb", "yaw", "ax", "&lt;b&gt;"))
    assert "image/png" not in page


def test_a_channel_has_the_same_scale_for_all_objects(channels, monkeypatch):
    drawn = []
    monkeypatch.setattr(channels_module, "_picture", lambda *shown: drawn.append(shown) or "")
    curves = channel_curves(channels.recordings)
    assert [curve.object for curve in curves] == ["ball", "mug", "pen"]
    all_readings = np.concatenate([readings for readings, *_ in drawn])
    for readings, low, high, names in drawn:
        assert readings.shape == (50, 5)
        assert names == ["index", "thumb", "yaw", "ax", "<b>"]
        np.testing.assert_array_equal(low, all_readings.min(axis=0))
        np.testing.assert_array_equal(high, all_readings.max(axis=0))


def test_the_size_of_a_small_page_is_not_0_mb(tmp_path):
    page = f"{html.GENERATOR}</html>"
    small = html.write(tmp_path / "a.html", page + 5000 * " " + "</html>")
    assert re.search(r": [1-9]\d* kB;", small)
    large = html.write(tmp_path / "b.html", page + 2_500_000 * " " + "</html>")
    assert ": 2.5 MB;" in large


def test_outside_a_clone_the_first_thing_to_do_is_to_go_to_one(overview, tmp_path, monkeypatch):
    monkeypatch.delenv("DVC_ROOT", raising=False)
    monkeypatch.chdir(tmp_path)
    assert "root of a clone" in " ".join(inspection_lines(overview))
    assert "clone" in text_of(inspection_page(overview))
    assert all(len(line) <= WIDTH for line in inspection_lines(overview) if "clone" in line)
    (tmp_path / "clone" / "data").mkdir(parents=True)
    for name in ("dvc.yaml", "params.yaml"):
        (tmp_path / "clone" / name).touch()
    monkeypatch.chdir(tmp_path / "clone" / "data")
    lines = inspection_lines(overview)
    change_folder, run = lines[lines.index("") + 1 :][:2]
    assert change_folder == f"cd {tmp_path / 'clone'}"
    assert change_folder in text_of(inspection_page(overview))
    assert run.startswith("dvc exp run")
    monkeypatch.chdir(tmp_path / "clone")
    assert "clone of" not in text_of(inspection_page(overview))
    assert "clone of" not in "\n".join(inspection_lines(overview))


def changed(overview, **facts):
    """Return the overview of recordings with other facts."""
    other = copy(overview)
    vars(other).update(facts)
    return other


def with_groups(overview, groups, **facts):
    """Return an overview with other numbers of groups, and the split recommended for them."""
    groups = {by: np.array(numbers) for by, numbers in groups.items()}
    others = [note for note in overview.settings if not note.key.startswith("split.")]
    return changed(overview, groups=groups, settings=[*others, *split_settings(groups)], **facts)


def test_each_fault_has_a_warning_that_names_what_is_at_fault(overview):
    assert warnings(overview) == []
    mug = overview.recordings.objects.index("mug")
    oil = overview.recordings.objects.index("Öl & <b>")
    groups = {"recording": np.where(np.arange(3) == oil, 1, 4)}
    contact = np.where(overview.label == mug, 0, overview.counts["in contact"])
    faulty = with_groups(
        overview,
        groups,
        counts=overview.counts | {"in contact": contact},
        error=replace(overview.error, high=overview.error.chance),
    )
    texts = {note.topic: note.text for note in warnings(faulty)}
    assert list(texts) == ["contact", "error", "split"]
    names = {"contact": ": mug.", "split": ": Öl & <b>."}
    assert all(name in texts[topic] for topic, name in names.items())
    assert verdict(faulty, warnings(faulty)).kind == "unsure"
    # the interval ends below and above the error for a new session
    for high, topics in ((0.3, ["session"]), (0.6, [])):
        error = replace(overview.error, error=0.5, low=0.0, high=high)
        with_errors = changed(overview, error=error, session_error=error)
        assert [note.topic for note in warnings(with_errors)] == topics


def test_quick_errors_are_of_recordings_or_sessions_left_out_and_chance_of_what_is_answered(
    overview,
):
    assert overview.error.groups == 12
    assert overview.error.chance == pytest.approx(2 / 3)
    assert overview.session_error.groups == 2
    assert overview.session_error.chance == pytest.approx(2 / 3)
    columns = overview.recordings.columns
    group = np.where(columns["object"] == 0, 99, columns["recording"])
    of_two_objects = overview.quick_error(group=group)
    assert (of_two_objects.groups, of_two_objects.chance) == (8, 0.5)


GRIDS = [
    (1, 1024, "auto", "32 32"),
    (1, 48, "auto", "ROWS COLUMNS"),
    (1, 17, "auto", ""),
    (8, 8, "auto", ""),
]


@pytest.mark.parametrize(("rows", "sensors", "asked", "advice"), [*GRIDS, (1, 64, [1, 64], "")])
def test_sensors_in_one_row_may_be_a_grid_of_which_the_user_says_the_shape(
    rows, sensors, asked, advice
):
    texts = [note.text for note in grid_notes((rows, sensors), Form(asked))]
    if advice:
        (text,) = texts
        assert f"add `--shape {advice}`" in text
    else:
        assert texts == []


@pytest.mark.parametrize(("sessions", "folds"), [(2, 2), (4, 4), (30, 5)])
def test_the_line_for_a_new_session_has_five_folds_at_most(overview, sessions, folds):
    spread = changed(overview, session=np.arange(len(overview.session)) % sessions)
    words = set(" ".join(command_lines(spread, new_sessions=True)).split())
    assert {"split.by=session", f"split.folds={folds}"} <= words


def test_the_line_for_every_part_is_a_study_of_all_sessions(overview):
    spread = changed(overview, session=np.arange(len(overview.session)) % 12)
    line = " ".join(" ".join(each_fold_lines(spread)).replace("\\", "").split())
    words = shlex.split(line.partition(")")[2])
    assert line.startswith(
        "python -m studies each_fold --out 'each_fold/my glove' $(tactile-viewgcn preset "
    )
    assert {"split.by=session", "split.folds=12"} <= {*words}
    changes = tuple(word for word in words if word != "-S")
    cells = read_study("each_fold").cells(changes)
    assert [cell.fold for cell in cells] == [*range(12)]


def test_a_setting_that_the_user_has_fixed_is_taken_and_named_in_the_line(overview):
    section = PreprocessSection(contact_sensors=7)
    fixed = inspect_source(overview.recordings.path, preprocess=section)
    assert fixed.choice.plan.params.contact_sensors == 7
    assert "preprocess.contact_sensors=7" in " ".join(command_lines(fixed))


def test_pictures_are_means_of_the_frames_in_contact_in_colours_of_one_scale(overview, monkeypatch):
    frame = np.array([[0, 5], [np.nan, 10]])
    assert html.heat_map(frame, 20) == html.heat_map(3 * frame, 60)
    assert html.heat_map(frame, 20) != html.heat_map(frame, 10)
    monkeypatch.setattr(html, "heat_map", lambda frame, top: (frame, top))
    pictures = inspection._mean_frames(overview)
    label = overview.recordings.columns["object"]
    assert len({top for _, top in pictures.values()}) == 1
    for name, (frame, _) in pictures.items():
        is_object = label == overview.recordings.objects.index(name)
        index = np.flatnonzero(overview.in_contact & is_object)
        expected = overview.excess(index).mean(axis=0)
        np.testing.assert_allclose(frame[overview.recordings.live], expected, rtol=1e-5)
        assert np.isnan(frame[7, 11])


def test_where_one_object_alone_is_touched_no_command_is_printed(overview):
    mug = overview.recordings.objects.index("mug")
    counts = overview.counts
    contact = np.where(overview.label == mug, counts["in contact"], 0)
    one_touched = changed(overview, counts=counts | {"in contact": contact})
    assert overview.choice.plan.params.filter == "contact"
    assert command_lines(overview)
    assert command_lines(one_touched) == []
    judged = verdict(one_touched, warnings(one_touched))
    assert judged.kind == "bad" and "mug" in judged.answer


@pytest.mark.parametrize(
    ("groups", "answer"),
    [
        ({"recording": [1, 1, 4]}, "no two objects"),
        ({"recording": [1, 1, 4], "grasp": [3, 3, 12]}, "3 grasps"),
        ({"recording": [1, 1, 4], "source": [2, 2, 2]}, "both published sets"),
        ({"recording": [0, 5, 4], "grasp": [0, 5, 4]}, "4 recordings or more"),
    ],
)
def test_what_can_be_held_out_is_judged_by_the_recommended_split(overview, groups, answer):
    judged = verdict(with_groups(overview, groups), [])
    assert answer in " ".join([judged.answer, *judged.reasons])
    assert (judged.kind == "bad") == (len(groups) == 1)


@pytest.mark.parametrize(
    ("recordings", "folds"),
    [([2, 30], 2), ([9, 60], 4), ([10, 60], 5), ([8, 8, 8], 2), ([8] * 5, 4), ([1, 6, 30], 3)],
)
def test_each_fold_tests_two_recordings_of_an_object_and_ten_in_all_where_there_are_so_many(
    recordings, folds
):
    notes = split_settings({"recording": np.array([0, *recordings])})
    settings = {note.key: note.value for note in notes}
    assert settings == {"split.by": "recording", "split.folds": folds}
    if folds > 2:
        fewest = min(count for count in recordings if count > 1)
        assert sum(recordings) // folds >= FEW
        assert fewest // folds >= 2


def test_a_line_names_what_it_rests_on_and_what_another_has_left_in_params_yaml(
    overview, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    before = " ".join(command_lines(overview))
    changes = (
        "split.deal=3",
        "split.train_groups=1",
        "preprocess.filter=none",
        "data.layout=OBJECT/FILE",
        "views=1",
    )
    params = default_params((*changes, "precision=float32"))
    Path("params.yaml").write_text(yaml.safe_dump(asdict(params)))
    line = " ".join(command_lines(overview))
    added = {"preprocess.filter=auto", "split.deal=0", "split.train_groups=all"}
    assert set(line.split()) - set(before.split()) == added
    assert {"data.layout=auto", "split.fold=0", "views=8"} <= set(before.split())
    Path("params.yaml").write_text("views: [1")  # of a different program
    assert " ".join(command_lines(overview)) == before
