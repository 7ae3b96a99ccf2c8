"""`--figures DIR` of analyse, batch and simulate: which files it writes, and when it writes them anew."""

from pathlib import Path

import numpy as np

from tests.pipelines.conftest import Run, WriteCsv, half_circle

SHAPE = ["curvature", "resolution", "route", "tension"]
RUN = sorted([*SHAPE, "time", "transmission"])


def names(name: str, figures: list[str]) -> list[str]:
    return [f"{name}_{figure}.{ending}" for figure in figures for ending in ("pdf", "svg")]


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_analyse_draws_a_shape_and_a_recording(run: Run, half: Path, recording: Path, tmp_path: Path) -> None:
    run("analyse", half, recording, "--figures", tmp_path / "new" / "figures", "--quiet")
    assert files(tmp_path / "new" / "figures") == [*names("half", SHAPE), *names("pull", RUN)]


def test_without_the_option_no_figure_is_written(run: Run, half: Path, tmp_path: Path) -> None:
    before = files(tmp_path)
    run("analyse", half, "--quiet")
    assert files(tmp_path) == before


def test_batch_draws_each_input_once_and_again_where_a_figure_is_gone(
    run: Run, half: Path, recording: Path, tmp_path: Path
) -> None:
    figures = tmp_path / "figures"
    ask = ("batch", half, recording, "--out", tmp_path / "out", "--figures", figures, "--workers", "1")
    assert run(*ask, "--quiet").status == 1  # the recording has a broken line
    assert files(figures) == [*names("half", SHAPE), *names("pull", RUN)]
    first = {path.name: path.read_bytes() for path in figures.iterdir()}
    times = {path.name: path.stat().st_mtime_ns for path in figures.iterdir()}
    run(*ask, "--quiet")
    assert {path.name: path.stat().st_mtime_ns for path in figures.iterdir()} == times
    (figures / "half_route.pdf").unlink()
    run(*ask, "--quiet")
    assert {path.name: path.read_bytes() for path in figures.iterdir()} == first
    assert (figures / "pull_route.pdf").stat().st_mtime_ns == times["pull_route.pdf"]


def test_simulate_draws_the_run_on_its_route(
    run: Run, half: Path, write_csv: WriteCsv, tmp_path: Path
) -> None:
    drive = np.column_stack([np.arange(5.0), [1.0, 5.0, 9.0, 6.0, 3.0]])
    csv = write_csv("pull.csv", drive, "time_s,tension_in_N")
    assert run("simulate", half, "--drive", csv, "--out", tmp_path / "out", "--figures", tmp_path / "figures")
    assert files(tmp_path / "figures") == names("half_pull", RUN)


def test_a_folder_that_cannot_be_written_is_one_line(run: Run, half: Path, write_csv: WriteCsv) -> None:
    taken = write_csv("taken", half_circle())
    outcome = run("analyse", half, "--figures", taken)
    assert outcome.status == 1
    assert "taken" in outcome.errors[0]


def test_a_style_is_that_of_the_figures_and_a_batch_draws_anew_in_another(
    run: Run, half: Path, tmp_path: Path
) -> None:
    figures = tmp_path / "figures"
    ask = ("batch", half, "--out", tmp_path / "out", "--figures", figures, "--no-pictures", "--quiet")
    by_style = dict[str, str]()
    for style in ("light", "dark", "paper"):
        run(*ask, "--style", style)
        assert files(figures) == names("half", SHAPE)
        by_style[style] = (figures / "half_curvature.svg").read_text("utf-8")
    assert "#111318" in by_style["dark"]  # its ground
    assert "#111318" not in by_style["light"]
    assert f'width="{88 / 25.4 * 72:.2f}'[:11] in by_style["paper"]
    run("analyse", half, "--figures", tmp_path / "again", "--quiet")
    assert (tmp_path / "again" / "half_curvature.svg").read_text("utf-8") == by_style["light"]


def test_figures_of_a_recording_state_their_moment_which_at_chooses(run, recording, tmp_path):
    def titles(folder, *words):
        assert run("analyse", recording, "--figures", tmp_path / folder, *words).status == 1
        parts = ("route", "tension", "curvature", "resolution", "time")
        return [(tmp_path / folder / f"{recording.stem}_{part}.svg").read_text("utf-8") for part in parts]

    *moment, history = titles("at", "--at", "2.9")
    assert all("At 3 s:" in text for text in moment)
    assert "3 s: " not in history
    assert all("<!-- 3 s -->" in text for text in titles("paper", "--at", "2.9", "--style", "paper")[:-1])
    assert all("At 3 s:" not in text for text in titles("peak")[:-1])
    assert run("analyse", recording, "--at", "nan").status == 2
