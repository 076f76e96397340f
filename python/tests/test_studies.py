"""Studies of papers: their statistics against closed forms and planted data, and their pages."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from gshear import Run, programs, simulate
from gshear.studies import _output, bonfanti, lee_hurley
from gshear.tables import read_csv

SCENES = Path(__file__).resolve().parents[2] / "tests" / "scenes"
Originals = Callable[[str], Path]


def run_module(module: str, *arguments: str | os.PathLike[str]) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-m",
        f"gshear.studies.{module}",
        *(os.fspath(word) for word in arguments),
    ]
    return subprocess.run(command, check=False, capture_output=True, text=True)


def refused(module: str, *arguments: str | os.PathLike[str]) -> str:
    """Asks for exit code 2 and one line on standard error; returns it."""
    done = run_module(module, *arguments)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("error: ")
    return done.stderr


def numbers(folder: Path, what: str = "what") -> dict[str, str]:
    with (folder / "numbers.csv").open(encoding="utf-8") as file:
        return {row[what]: row["ours"] for row in csv.DictReader(file)}


def files_are_linked(folder: Path) -> str:
    """Returns the page, every file of which exists."""
    page = (folder / "index.html").read_text(encoding="utf-8")
    links = [part.split('"')[0] for mark in ('src="', 'href="') for part in page.split(mark)[1:]]
    assert links
    assert all((folder / link).stat().st_size > 0 for link in links), links
    return page


def test_spread_of_few_values() -> None:
    four = _output.spread([8.0, 2.0, np.nan, 4.0, 6.0])
    assert [four[name] for name in ("runs", "mean", "median", "least", "greatest")] == [
        4,
        5,
        5,
        2,
        8,
    ]
    # s² = (9 + 1 + 1 + 9)/3.
    assert four["error"] == pytest.approx(np.sqrt(20 / 12), rel=1e-15)
    one = _output.spread([3.0])
    assert (one["runs"], one["mean"]) == (1, 3.0)
    assert np.isnan(one["error"])
    none = _output.spread([np.nan])
    assert none["runs"] == 0
    assert np.isnan([none["mean"], none["median"], none["greatest"]]).all()


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (4e-6, 3, "4.000e-6"),
        (1e4, 0, "1e4"),
        (-2.5e12, 1, "-2.5e12"),
        (1.0, 2, "1.00e0"),
        (3e-100, 0, "3e-100"),
        (np.nan, 2, "NaN"),
    ],
)
def test_scientific_numbers(value: float, digits: int, text: str) -> None:
    assert _output.scientific(value, digits) == text


def correlations(pairs: list[int], rho: list[float], p: float = 0.01) -> pd.DataFrame:
    """A table of ranges, the last of which is not of Δτ."""
    head = {"of": "delta_tau_p", "with": "top_max", "over": "long", "range_of": "delta_tau_p"}
    ends = {"from": [-1e-2, -1e-3, 1e-3], "to": [-np.inf, -1e-2, 1e-2]}
    found = pd.DataFrame(head | ends | {"pairs": pairs, "rho": rho, "p": p})
    return pd.concat([found, found[:1].assign(range_of="top_max_over_mean_radius_squared")])


def test_means_over_seeds_leave_out_ranges_of_few_pairs() -> None:
    runs = [
        correlations([9, 9, 4], [-0.2, 0.5, 0.9], 0.01),
        correlations([8, 4, 3], [-0.4, 0.7, 0.8], 0.02),
        correlations([7, 6, 2], [-0.9, 0.1, 0.7], 0.40),
    ]
    merged = lee_hurley.seed_correlations(runs)
    assert merged["from"].tolist() == [-1e-2, -1e-3, 1e-3]
    assert merged["runs"].tolist() == [3, 2, 0]
    assert merged["least_pairs"].tolist() == [7, 6, 0]
    np.testing.assert_allclose(merged["rho_mean"], [-0.5, 0.3, np.nan], rtol=1e-15)
    # Deviations 0.3, 0.1 and -0.4 of three, ±0.2 of two.
    np.testing.assert_allclose(
        merged["rho_error"], [np.sqrt(0.26 / 2 / 3), np.sqrt(0.08 / 2), np.nan], rtol=1e-14
    )
    assert merged["rho_least"].tolist()[:2] == [-0.9, 0.1]
    np.testing.assert_allclose(merged["p_median"], [0.02, 0.205, np.nan], rtol=1e-15)


def test_words_for_coefficients() -> None:
    found = correlations([9, 9, 9], [-0.39, 0.4, 0.61])[:3]
    words = (
        "0.39 weak (from -1.0e-2, 9); 0.40 moderate (from -1.0e-3, 9); 0.61 strong (from 1.0e-3, 9)"
    )
    assert lee_hurley.described(found) == words
    slip = lee_hurley.within(found, -1, np.inf, 1e-3)
    assert slip["rho"].tolist() == [-0.39, 0.4]
    assert lee_hurley.within(found, -1, 1e-2, 1e-3)["rho"].tolist() == [0.4]
    assert lee_hurley.within(found, 0, np.inf, 0)["rho"].tolist() == found["rho"].tolist()
    for insignificant in (found.assign(p=0.051), found.assign(pairs=4)):
        assert lee_hurley.described(insignificant) == "no significant range"


@pytest.mark.parametrize(("rise", "lag"), [(6, 3), (9, 0), (10, -1), (None, None)])
def test_lag_of_the_drop(rise: int | None, lag: int | None) -> None:
    # Rows 2 to 5 are Stage I, 6 to 11 Stage II; τ falls fastest in the interval that ends in row 9.
    tau = np.cumsum([0, 1, 1, 1, 1, 1, -1, -1, -1, -5, -1, -1, 1])
    top = np.ones(13)
    if rise is not None:
        top[rise:] = 11.0
    assert lee_hurley.drop_lag(tau, top, slice(2, 6), slice(6, 12)) == lag


def test_dense_rows() -> None:
    coarse = np.arange(10.0)
    assert bonfanti.dense(coarse) is None
    fine = 10 + 0.1 * np.arange(30)
    time = np.concatenate([coarse, fine, fine[-1] + 1 + coarse])
    found = bonfanti.dense(time)
    assert found is not None
    assert (time[found] == fine[:-1]).all()
    assert bonfanti.dense(np.concatenate([coarse, fine[:10], 20 + coarse])) is None
    # Rows are dense at the end as well, where the growth is over.
    later = np.concatenate([time, time[-1] + 1 + fine - fine[0]])
    assert bonfanti.dense(later) != found
    assert bonfanti.oscillation(later, time[-1]) == found
    assert bonfanti.oscillation(later, np.nan) == bonfanti.dense(later)


@pytest.fixture(scope="module")
def of_seeds(originals: Originals, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("studies") / "lee-hurley"
    paths = [originals(name) for name in ("disks", "other disks", "disks")]
    done = run_module("lee_hurley", *paths, "--from", "0.02", "--out", out)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"wrote {out / 'index.html'}\n"
    return out


def test_numbers_of_lee_hurley(originals: Originals, of_seeds: Path) -> None:
    found = numbers(of_seeds)
    with Run(originals("disks"), quiet=True) as run:
        at = run.series.set_index("step").loc[run.frames.step]
        regime = at[at["strain"] >= 0.02]
        tau = regime["stress_ratio"].to_numpy()
        rows = run.series[run.series["step"].between(regime.index[0], regime.index[-1])]
        assert found["disks"] == str(len(run.frame(0).radius))
    assert found["intervals in the regime"] == str(len(tau) - 1)
    # Phases end where τ turns; long ones have more than three intervals.
    turns = np.flatnonzero(np.diff(np.sign(np.diff(tau))))
    lengths = np.diff([0, *(turns + 1), len(tau) - 1])
    assert found["phases in the regime"] == str(len(lengths))
    assert found["long phases (t_p > 3Δγ)"] == str((lengths > 3).sum())
    # ⟨S⟩/⟨N⟩ over all rows, and the deviation of S from τN over ⟨N⟩.
    mean = rows["shear_force"].mean() / rows["normal_force"].mean()
    rest = (rows["shear_force"] - mean * rows["normal_force"]) / rows["normal_force"].mean()
    deviation = np.sqrt(np.mean(rest**2))
    assert found["τ in the regime, mean and deviation"] == f"{mean:.3f}, {deviation:.3f}"
    drops = read_csv(of_seeds / "drops.csv")
    ends = np.cumsum([0, *lengths])
    changes = np.sort(np.diff(tau[ends]))
    first = drops[drops["run"] == drops["run"][0]]
    np.testing.assert_array_equal(first["delta_tau_p"], changes[changes < 0][:20])
    assert first["rank"].tolist() == list(range(1, len(first) + 1))


def test_coefficients_of_lee_hurley_against_scipy(of_seeds: Path) -> None:
    found = read_csv(of_seeds / "fig-13.csv")
    phases = read_csv(of_seeds / "run-1" / "measures.csv")
    compared = 0
    for panel, (name, over) in zip("abcdefghij", lee_hurley.PANELS, strict=True):
        if over == "intervals":
            continue
        rows = phases if over == "all" else phases[phases["length"] == over]
        of: Any
        for of in found[found["panel"] == panel].rename(columns={"from": "nearer"}).itertuples():
            size = rows["delta_tau_p"] * np.sign(of.to)
            inside = rows[(size >= abs(of.nearer)) & (size < abs(of.to))]
            assert of.pairs == len(inside)
            if len(inside) > 2 and np.ptp(inside[name]) > 0:
                wanted = stats.spearmanr(inside["delta_tau_p"], inside[name])
                assert of.rho == pytest.approx(wanted.statistic, abs=1e-12)
                assert of.p == pytest.approx(wanted.pvalue, rel=1e-9)
                compared += 1
    assert compared > 5


def test_files_of_lee_hurley(originals: Originals, of_seeds: Path) -> None:
    page = files_are_linked(of_seeds)
    assert "Figure 25: no run of the large sample." in page
    for number in (*range(2, 14), *range(14, 26)):
        assert (of_seeds / f"fig-{number:02}.svg").exists() == (number < 14)
    # Figures show one of the runs that differ in their seeds; a seed given twice counts once.
    assert len(read_csv(of_seeds / "fig-13.csv")) == 10 * 8
    ensemble = read_csv(of_seeds / "ensemble.csv").set_index("what")
    assert (ensemble["runs"] <= 2).all()
    each = [len(read_csv(of_seeds / f"run-{k}" / "measures.csv")) for k in (1, 2)]
    assert ensemble.loc["phases", "mean"] == np.mean(each)
    assert ensemble.loc["phases", "error"] == pytest.approx(abs(each[0] - each[1]) / 2)
    assert (of_seeds / "ensemble-small.svg").exists()
    # The steps of the maps are numbered through, from Stage I to Stage III.
    maps = pd.concat([read_csv(of_seeds / f"fig-{number:02}.csv") for number in (3, 4, 5)])
    assert maps["step"].is_monotonic_increasing
    assert list(maps["stage"].unique()) == ["I", "II", "III"]
    with Run(originals("disks"), quiet=True) as run:
        step = maps[maps["step"] == 1]
        index = int(np.argmin(np.abs(run.frames.strain - step["end_strain"].iloc[0])))
        np.testing.assert_array_equal(step["dmin"], run.dmin(index))
        np.testing.assert_array_equal(step["x"], run.frame(index).position[:, 0])


def test_wrong_runs_of_lee_hurley(originals: Originals, tmp_path: Path) -> None:
    assert "no such file or folder" in refused("lee_hurley", tmp_path / "none")
    for other in ("box", "spheres"):
        message = refused("lee_hurley", originals(other), "--out", tmp_path / "out")
        assert "must be a run of disks between walls" in message
    short: dict[str, object] = {"shear.strain": 1e-3, "output.frame_strain": 0}
    run = simulate(SCENES / "crossing.toml", tmp_path / "run", ranks=1, values=short, quiet=True)
    message = refused("lee_hurley", run)
    assert "run.h5: has 0 frames: the study needs two or more" in message
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    base = tmp_path_factory.mktemp("boxes")
    scene = SCENES / "periodic.toml"
    values: dict[str, object] = {
        "sample.grains": 60,
        "aqs.steps": 5,
        "aqs.frame_every": 1,
        "aqs.spectrum": True,
    }
    values |= {"aqs.birth_precision": 1e-3}
    return [
        simulate(scene, base / f"seed-{k}", ranks=1, values=values | {"seed": k}, quiet=True)
        for k in (3, 4)
    ]


def test_one_box(boxes: list[Path], tmp_path: Path) -> None:
    done = run_module("bonfanti", boxes[0], "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    page, found = files_are_linked(tmp_path), numbers(tmp_path, "statement")
    assert "Figure 2: no eigenvalues in time: set newtonian.spectra." in page
    with Run(boxes[0] / "run.h5/newtonian", quiet=True) as run:
        stress = run.series["shear_stress"].to_numpy()
        assert found["drop of the shear stress"] == f"{100 * (1 - stress[-1] / stress[0]):.1f} %"
        np.testing.assert_array_equal(read_csv(tmp_path / "fig-05.csv")["shear_stress"], stress)
        lambda_i = run.parameters["lambda_i"]
    name = "imaginary part of the pair at the start of Newton's equations"
    assert float(found[name]) == pytest.approx(lambda_i, rel=1e-4)
    with Run(boxes[0], quiet=True) as run:
        birth = found["strain at which the first complex pair appears"]
        assert float(birth.split()[0]) == pytest.approx(run.parameters["birth_after"], abs=1e-12)
    grains = read_csv(tmp_path / "fig-06.csv")
    assert grains["eigenvector_square"].sum() == pytest.approx(1)


def test_several_boxes(boxes: list[Path], tmp_path: Path) -> None:
    done = run_module("bonfanti", *boxes, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert files_are_linked(tmp_path)
    runs = read_csv(tmp_path / "ensemble-runs.csv")
    for k, path in enumerate(boxes):
        with Run(path / "run.h5/newtonian", quiet=True) as run:
            series = run.series
        # The change to the mean over the last tenth of the time.
        time, stress = series["time"].to_numpy(), series["shear_stress"].to_numpy()
        end = time >= time[-1] - 0.1 * (time[-1] - time[0])
        width, middle = np.diff(time[end]), (stress[end][1:] + stress[end][:-1]) / 2
        mean = (width * middle).sum() / width.sum()
        change = abs(mean - stress[0]) / series["pressure"][0]
        rounding = 1e-12 * abs(stress[0]) / series["pressure"][0]
        assert runs["change_over_pressure"][k] == pytest.approx(change, abs=rounding)
        for form, options in (("", []), ("_paper_form", ["--paper-form"])):
            folder = tmp_path / f"all-{k}{form}"
            _output.reduce("stability", path / "run.h5", folder, *options)
            first = read_csv(folder / "stability.csv").query("pairs > 0").iloc[0]
            assert runs[f"first_frame_with_pair{form}"][k] == first["strain"]
            # ω² = λ.
            omega = complex(runs[f"first_omega_r{form}"][k], runs[f"first_omega_i{form}"][k])
            value = complex(first["pair_real"], first["imaginary_greatest"])
            assert omega**2 == pytest.approx(value, rel=1e-12)
    means = read_csv(tmp_path / "ensemble.csv").set_index("what")
    assert means.loc["birth", "mean"] == pytest.approx(runs["birth"].mean())
    assert means.loc["growing", "mean"] == (runs["aftermath"] == "growing").mean()
    points = read_csv(tmp_path / "ensemble-distributions.csv")
    points = points[points["panel"] == "(a)"]
    assert points["value"].tolist() == sorted(runs["change_over_pressure"])
    assert points["share_of_runs"].tolist() == [0.5, 1.0]


def test_boxes_of_a_packing(originals: Originals, tmp_path: Path) -> None:
    of_file: dict[str, object] = {"sample.solid_fraction": None, "aqs.steps": 1}
    of_file |= {f"sample.{key}": None for key in ("sizes", "large_fraction", "grains")}
    of_file |= {f"sample.radius_{end}": None for end in ("min", "max")}
    of_file |= {f"newtonian.{key}": None for key in ("growth_times", "rows", "frames")}
    packing = tmp_path / "box.data"
    words = ["export", str(originals("box")), "--format=lammps-data", f"--out={packing}"]
    programs.run([programs.find("gshear-reduce"), *words], quiet=True)
    scene = SCENES / "periodic.toml"
    runs = [
        simulate(
            scene,
            tmp_path / f"run-{k}",
            ranks=1,
            values=of_file | {"sample.packing": packing, "aqs.strain_step": k * 1e-3},
            quiet=True,
        )
        for k in (1, 2)
    ]
    done = run_module("bonfanti", *runs, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    families = read_csv(tmp_path / "out" / "ensemble-runs.csv")["runs_of"]
    assert families.tolist() == [f"packing {packing} N = 150"] * 2


def test_wrong_runs_of_bonfanti(
    originals: Originals, copy: Callable[[str], Path], boxes: list[Path], tmp_path: Path
) -> None:
    out = ["--out", str(tmp_path / "out")]
    assert "has no strain steps" in refused("bonfanti", originals("disks"), *out)
    stopped = copy("box")
    with h5py.File(stopped / "run.h5", "r+") as file:
        del file["newtonian/parameters"].attrs["digest"]
    message = refused("bonfanti", boxes[0], stopped, *out)
    assert "run.h5/newtonian: is not done" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("module", ["lee_hurley", "bonfanti"])
def test_help(module: str) -> None:
    done = run_module(module, "--help")
    assert done.returncode == 0
    text = " ".join(done.stdout.split())
    assert all(word in text for word in ("RUN", "--out DIR", "Exit codes: 0 done, 2 bad input"))
    assert run_module(module).returncode == 2
