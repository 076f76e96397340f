"""Helpers of analysis, compared with closed forms, planted data, SciPy and recorded numbers."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from gshear import Run
from gshear.analysis import (
    autocorrelation,
    avalanches,
    b_value,
    coarse_grained,
    durations,
    fabric,
    power_spectrum,
    profiles,
    rattlers,
    temperatures,
    time_mean,
)

from .planted import planted


def test_a_sine_has_its_power_at_its_frequency() -> None:
    spacing, frequency, amplitude = 0.01, 12.5, 0.3
    time = spacing * np.arange(1600)
    for segments in (1, 3):
        at, power = power_spectrum(
            5 + amplitude * np.sin(2 * np.pi * frequency * time), spacing, segments=segments
        )
        assert at[power.argmax()] == frequency
        assert power.sum() * at[1] == pytest.approx(amplitude**2 / 2, rel=1e-12)
    noise = np.random.default_rng(1).normal(0, 0.2, 200_000)
    _, power = power_spectrum(noise, spacing, segments=199)
    np.testing.assert_allclose(power[2:-2].mean(), 2 * 0.2**2 * spacing, rtol=0.02)


@pytest.mark.parametrize(("count", "segments"), [(1000, 1), (1001, 1), (1000, 7), (1003, 4)])
def test_power_spectra_are_those_of_scipy(count: int, segments: int) -> None:
    values = np.random.default_rng(2).normal(size=count).cumsum()
    at, power = power_spectrum(values, 0.5, segments=segments)
    length = 2 * (len(at) - 1) + (count % 2 if segments == 1 else 0)
    assert count - (segments + 1) * length / 2 < segments + 2
    own, theirs = signal.welch(values[: (segments + 1) * length // 2], 2.0, nperseg=length)
    np.testing.assert_allclose(at, own)
    np.testing.assert_allclose(power, theirs, rtol=1e-9, atol=1e-12 * theirs.max())


def test_what_has_no_spectrum_is_refused() -> None:
    with pytest.raises(ValueError, match="row 2 is not finite"):
        power_spectrum([1.0, 2.0, np.nan, 3.0])
    with pytest.raises(ValueError, match="7 values are too few for 6 segments"):
        power_spectrum(np.arange(7.0), segments=6)
    with pytest.raises(ValueError, match="give a series"):
        power_spectrum(np.zeros((4, 4)))
    for wrong in ({"segments": 0}, {"spacing": 0.0}, {"spacing": np.nan}):
        with pytest.raises(ValueError, match="give 1 or more, and above 0"):
            power_spectrum(np.arange(9.0), **wrong)


def test_autocorrelations_in_closed_form() -> None:
    lags = np.arange(100)
    np.testing.assert_allclose(autocorrelation(3 + (-1.0) ** lags), (-1.0) ** lags, atol=1e-12)
    # A process in which each value keeps the part 0.8 of the one before.
    random = np.random.default_rng(3).normal(size=400_000)
    process = signal.lfilter([1.0], [1.0, -0.8], random)
    np.testing.assert_allclose(autocorrelation(process)[:10], 0.8 ** lags[:10], atol=0.02)


def test_the_autocorrelation_of_vectors_is_the_sum_by_hand() -> None:
    v = np.random.default_rng(4).normal(size=(20, 5, 3))
    v -= v.mean(axis=0)
    by_hand = np.array([(v[k:] * v[: 20 - k]).sum() / (20 - k) for k in range(20)])
    np.testing.assert_allclose(autocorrelation(v + 7), by_hand / by_hand[0], atol=1e-12)


def test_planted_avalanches() -> None:
    values = [0.0, 1.0, 2.0, 1.5, 0.5, 0.5, 3.0, 2.9, 4.0, 1.0]
    time = 10.0 * np.arange(10)
    found = avalanches(values, time)
    assert found["start"].tolist() == [2, 6, 8]
    assert found["end"].tolist() == [4, 7, 9]
    np.testing.assert_allclose(found["size"], [1.5, 0.1, 3.0])
    assert found["duration"].tolist() == [20, 10, 10]
    np.testing.assert_array_equal(found["waiting"], [np.nan, 20, 10])
    large = avalanches(values, time, least=1.0)
    assert large["start"].tolist() == [2, 8]
    np.testing.assert_array_equal(large["waiting"], [np.nan, 40])
    assert len(avalanches(np.arange(5.0))) == 0
    assert avalanches([1.0, 0.0])["duration"].tolist() == [1]
    with pytest.raises(ValueError, match="give one each"):
        avalanches(values, time[:5])


def test_avalanches_of_the_stress_ratio_are_the_slip_phases(walls: Run) -> None:
    drops = walls.drops()
    found = avalanches(walls.series["stress_ratio"]).sort_values("size", ascending=False)
    found = found.head(10)
    np.testing.assert_allclose(found["size"], -drops["delta_tau_p"][:10])
    assert found["start"].tolist() == drops["start_row"][:10].tolist()


def test_b_of_exponential_magnitudes() -> None:
    b, count = 0.9, 40_000
    magnitudes = -2 + np.random.default_rng(5).exponential(1 / (b * np.log(10)), count)
    found, error = b_value(magnitudes, -2)
    assert error == pytest.approx(b / np.sqrt(count), rel=0.05)
    assert found == pytest.approx(b, abs=3 * error)
    # Memoryless: larger ones alone have the same b; so have sizes S^-1.9.
    assert b_value(magnitudes, -1)[0] == pytest.approx(b, abs=4 * b_value(magnitudes, -1)[1])
    sizes = np.random.default_rng(6).pareto(b, count) + 1
    assert b_value(np.log10(sizes), 0)[0] == pytest.approx(b, abs=3 * error)
    # Rounding to 0.1 needs its correction.
    rounded = np.round(magnitudes, 1)
    assert b_value(rounded, -1.5, step=0.1)[0] == pytest.approx(b, abs=0.03)
    assert abs(b_value(rounded, -1.5)[0] - b) > 0.06
    with pytest.raises(ValueError, match="0 magnitudes from 9 on"):
        b_value(magnitudes, 9)


def test_a_mean_of_a_ratio_is_the_ratio_of_the_means() -> None:
    """A row with N near zero, and rows of unequal length; a constant ratio is exact."""
    shear, normal = np.array([1.0, 2.0, 3.0, 2.0, 1.0]), np.array([2.0, 4.0, 6.0, 4.0, -1e-6])
    assert time_mean(shear, normal).mean == 9.0 / (16.0 - 1e-6)
    weights = durations([0.0, 1.0, 3.0, 3.5, 4.5, 5.0])[1:]
    assert weights.tolist() == [1.0, 2.0, 0.5, 1.0, 0.5]
    assert time_mean(shear, weights=weights).mean == (1 + 4 + 1.5 + 2 + 0.5) / 5
    assert time_mean(0.5 * normal, normal, weights=weights) == (0.5, 0.0, 0.0)
    assert durations([0.0, 0.1, 0.2, 0.3]).tolist() == [1.0] * 4
    assert np.isnan(time_mean([1.0, np.nan], [2.0, 1.0]).error)
    with pytest.raises(ValueError, match="give one each"):
        time_mean([1.0, 2.0], [1.0])


def test_errors_of_means_are_the_scatter_of_repetitions() -> None:
    """Series x' = 0.9 x + noise, whose mean has the variance 1/12/(1 - 0.9)²/n."""
    noise = np.random.default_rng(5).random((2000, 800)) - 0.5
    series = np.zeros(noise.shape)
    for k in range(1, len(noise)):
        series[k] = 0.9 * series[k - 1] + noise[k]
    found = [time_mean(1 + x) for x in series.T]
    expected = np.sqrt(1 / 12 / 0.01 / 2000)
    assert np.sqrt(np.mean([of.error**2 for of in found])) == pytest.approx(expected, rel=0.12)
    assert np.std([of.mean for of in found]) == pytest.approx(expected, rel=0.12)


def test_fabric_in_closed_form() -> None:
    angle = 2 * np.pi * np.arange(360) / 360
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(360)], axis=1)
    np.testing.assert_allclose(fabric(normals), np.diag([0.5, 0.5, 0]), atol=1e-14)
    # A density 1 + a cos 2(θ - θ₀) has ⟨n ⊗ n⟩ = 1/2 + a/4 along θ₀.
    tensor = fabric(normals, 5 + 2 * np.cos(2 * (angle - 0.7)))
    along = np.array([np.cos(0.7), np.sin(0.7), 0])
    np.testing.assert_allclose(tensor @ along, 0.6 * along, atol=1e-14)
    every = np.random.default_rng(7).normal(size=(200_000, 3))
    every /= np.linalg.norm(every, axis=1, keepdims=True)
    np.testing.assert_allclose(fabric(every), np.eye(3) / 3, atol=3e-3)


def test_rattlers_are_removed_one_after_another() -> None:
    """Four disks that all touch hold each other; the chain beside them falls from its end on."""
    pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3), (3, 4), (4, 5), (4, 6), (5, 6), (6, 7)]
    grains = {"position": np.zeros((8, 3)), "radius": np.ones(8), "body": np.zeros(8, dtype=int)}
    contacts = planted(2, [9.0, 9.0, 1.0], grains, walls=True, pairs=pairs).contacts
    assert np.flatnonzero(rattlers(contacts)).tolist() == [4, 5, 6, 7]
    assert np.flatnonzero(rattlers(contacts, 2)).tolist() == [7]
    assert rattlers(contacts, 4).all()
    # With friction two contacts hold a disk and a sphere, without it three and four.
    for dimension, free in [(2, [4, 5, 6, 7]), (3, list(range(8)))]:
        with_friction = planted(
            dimension, [9.0, 9.0, 9.0], grains, walls=True, pairs=pairs, friction=0.3
        )
        without = planted(dimension, [9.0, 9.0, 9.0], grains, walls=True, pairs=pairs)
        assert np.flatnonzero(rattlers(with_friction.contacts)).tolist() == [7]
        assert np.flatnonzero(rattlers(without.contacts)).tolist() == free
    # Grains of walls are held without contacts.
    grains["body"][7] = 1
    grains["body"][5] = 2
    assert np.flatnonzero(rattlers(contacts)).tolist() == []


@pytest.mark.parametrize("dimension", [2, 3])
def test_profiles_of_planted_grains(dimension: int) -> None:
    """Rows of grains in a linear flow, with fluctuations of ± 0.3 along every axis."""
    up, across = dimension - 1, 10 if dimension == 3 else 1
    places = np.zeros((20 * across * 40, 3))
    places[:, up] = np.repeat(np.arange(40) + 0.5, 20 * across)
    signs = np.random.default_rng(8).choice([-1.0, 1.0], places.shape)
    signs[:, dimension:] = 0
    flow = np.zeros_like(places)
    flow[:, 0] = 0.1 * places[:, up]
    radius, count = np.full(len(places), 0.4), len(places)
    edges = [20.0, float(across), 40.0] if dimension == 3 else [20.0, 40.0, 1.0]
    grains = {"position": places, "radius": radius, "mass": np.ones(count)}
    frames = [
        planted(dimension, edges, grains | {"velocity": flow + 0.3 * s * signs}, walls=True)
        for s in (1, -1)
    ]
    found = profiles(frames, 10)
    inner = found.iloc[1:-1]
    np.testing.assert_allclose(inner["velocity"], 0.1 * inner["height"], atol=0.02)
    np.testing.assert_allclose(inner["temperature"], 0.3**2, rtol=0.1)
    volume = {2: np.pi * 0.4**2, 3: 4 / 3 * np.pi * 0.4**3}[dimension]
    assert found["solid_fraction"].sum() * (39.8 / 10 * 20 * across) == pytest.approx(
        volume * count, rel=1e-12
    )
    # A grain between two layers counts in each with its part.
    one = {"position": np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]), "mass": np.ones(2)}
    one |= {"radius": np.array([1.0, 0.5]), "velocity": np.zeros((2, 3))}
    parts = profiles([planted(dimension, [2.0, 2.0, 2.0], one, walls=True)], 4)
    small, large = (np.array([0, 0.5, 0.5, 0]), {2: 0.19550, 3: 0.15625}[dimension])
    large_parts = np.array([large, 0.5 - large, 0.5 - large, large])
    whole = np.array([np.pi, np.pi / 4] if dimension == 2 else [np.pi * 4 / 3, np.pi / 6])
    expected = whole[0] * large_parts + whole[1] * small
    layer = 2.0 * 0.5 if dimension == 2 else 2.0 * 2.0 * 0.5
    np.testing.assert_allclose(parts["solid_fraction"] * layer, expected, rtol=1e-4)


def test_profiles_of_a_run_follow_the_walls(walls: Run) -> None:
    frames = walls.frames[-5:]
    found = profiles(frames, 12)
    last = walls.series.iloc[-1]
    assert found["height"].is_monotonic_increasing
    if walls.dimension == 2:
        # The outermost layers are those of the walls; they move with one velocity.
        assert found["velocity"].iloc[0] == pytest.approx(0, abs=0.05 * last["slip_rate"])
        assert found["velocity"].iloc[-1] == pytest.approx(last["slip_rate"], rel=0.05)
    assert found["solid_fraction"].iloc[2:-2].between(0.3, 1.0).all()
    with pytest.raises(ValueError, match="one frame or more"):
        profiles([])


def test_profiles_need_walls(box: Run) -> None:
    with pytest.raises(ValueError, match="between walls"):
        profiles(box.frames)


@pytest.mark.parametrize("name", ["box", "disks in a box"])
def test_coarse_grained_fields_have_the_means_of_the_box(
    name: str, reduced: Callable[[str], Path]
) -> None:
    """Over a grid of the whole sheared box, mass and stress are those of all grains."""
    with Run(reduced(name)) as run:
        frame, d = run.frame(-1), run.dimension
        assert frame.box.image_offset != 0
        edges = frame.box.edges[:d]
        axes = [np.arange(16) / 16 * edge for edge in edges]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        fields = coarse_grained(frame, points.reshape(16, -1, d), edges.min() / 12)
        volume = frame.box.volume
        assert fields.density.shape == (16, 16 ** (d - 1))
        assert fields.density.mean() == pytest.approx(frame.mass.sum() / volume, rel=1e-6)
        assert fields.density.std() > 0.01 * fields.density.mean()
        contacts = frame.contacts
        whole = contacts.separation.T @ contacts.force / volume
        mean = fields.stress.mean(axis=(0, 1))
        np.testing.assert_allclose(mean, whole, atol=1e-5 * np.abs(whole).max())
        with pytest.raises(ValueError, match=f"give {d} coordinates"):
            coarse_grained(frame, points[..., 0], 1.0)


def test_a_single_grain_is_a_gaussian() -> None:
    grain = {"position": np.array([[0.1, 5.0, 0.0]]), "radius": np.ones(1), "mass": np.array([3.0])}
    grain["velocity"] = np.array([[2.0, -1.0, 0.0]])
    frame = planted(2, [10.0, 10.0, 1.0], grain, walls=True)
    # The second point is nearest to the image beyond the boundary.
    fields = coarse_grained(frame, [[0.1, 5.0], [9.6, 5.0], [5.0, 90.0]], 0.5)
    peak = 3.0 / (2 * np.pi * 0.5**2)
    np.testing.assert_allclose(fields.density, [peak, peak * np.exp(-0.5), 0], rtol=1e-12)
    np.testing.assert_allclose(fields.velocity[:2], [[2.0, -1.0, 0.0]] * 2)
    np.testing.assert_allclose(fields.temperature[:2], 0, atol=1e-12)
    assert np.isnan(fields.velocity[2]).all()


def test_temperature_and_stress_of_two_grains() -> None:
    """Between them the stress is that of a line under a Gaussian."""
    grains = {"position": np.array([[9.5, 5.0, 0.0], [1.5, 5.0, 0.0]]), "radius": np.ones(2)}
    grains |= {"velocity": np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), "mass": np.ones(2)}
    frame = planted(2, [10.0, 10.0, 1.0], grains, walls=False, pairs=[(0, 1)])
    width, length = 0.5, 2.0
    fields = coarse_grained(frame, [[0.5, 5.0], [0.5, 5.5], [9.5, 5.0]], width)
    np.testing.assert_allclose(fields.velocity[0], [2, 0, 0])
    assert fields.temperature[0] == pytest.approx(0.5)
    middle = math.erf(length / 2 / (width * math.sqrt(2))) / (width * math.sqrt(2 * math.pi))
    end = math.erf(length / (width * math.sqrt(2))) / (2 * width * math.sqrt(2 * math.pi))
    expected = 7.0 * np.array([middle, middle * math.exp(-0.5), end])
    np.testing.assert_allclose(fields.stress[:, 0, 0], expected, rtol=2e-4)
    np.testing.assert_allclose(fields.stress[:, 1, 1], 0, atol=1e-12)


@pytest.mark.parametrize("name", ["disks", "spheres", "flow", "spheres without walls"])
def test_temperatures_are_those_of_the_series(name: str, originals: Callable[[str], Path]) -> None:
    with Run(originals(name), quiet=True) as run:
        rows = run.series.set_index("step")
        frames = [frame for frame in run.frames if frame.step in rows.index and frame.step > 0]
        assert len(frames) > 2
        for frame in frames:
            row, found = rows.loc[frame.step], temperatures(frame)
            assert found.velocities == pytest.approx(row["granular_temperature"], rel=1e-10)
            assert found.spins == pytest.approx(row["spin_temperature"], rel=1e-10)
            assert found.velocities > 0.0


def test_a_file_without_temperatures_has_those_of_its_frames(tmp_path: Path) -> None:
    """Files of versions before `output.temperatures`."""
    kept = Path(__file__).parents[2] / "tests/files/walls/run.h5.gz"
    (tmp_path / "run.h5").write_bytes(gzip.decompress(kept.read_bytes()))
    with Run(tmp_path, quiet=True) as run:
        assert not {"granular_temperature", "spin_temperature"} & set(run.series.columns)
        found = np.array([temperatures(frame) for frame in run.frames])
    assert len(found) > 3
    assert np.isfinite(found).all()
    assert (found[1:] > 0.0).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_temperature_of_a_maxwellian(dimension: int) -> None:
    """On a translation and a shear, which have none."""
    random, count, up = np.random.default_rng(5), 4000, dimension - 1
    places = random.random((count, 3)) * 20.0
    places[:, dimension:] = 0.0
    flow = np.zeros_like(places)
    flow[:, 0] = 5.0 + 0.3 * places[:, up]
    radius = 0.3 + 0.4 * random.random(count)
    mass = radius**dimension
    spins = 3 if dimension == 3 else 1
    spin = np.full((count, spins), 0.7) * places[:, [up]]
    grains = {"position": places, "radius": radius, "mass": mass, "body": np.zeros(count, int)}

    def found(of_velocities: float, of_spins: float) -> tuple[float, float]:
        inertia = (0.5 if dimension == 2 else 0.4) * mass * radius**2
        v = random.standard_normal((count, 3)) * np.sqrt(of_velocities / mass)[:, None]
        v[:, dimension:] = 0.0
        w = random.standard_normal((count, spins)) * np.sqrt(of_spins / inertia)[:, None]
        motion = {"velocity": flow + v, "angular_velocity": (spin + w).squeeze()}
        return temperatures(planted(dimension, [20.0] * 3, grains | motion, walls=True))

    np.testing.assert_allclose(found(0.0, 0.0), 0.0, atol=1e-24)
    # Four standard errors.
    error = 4 * np.sqrt(2 / (dimension * count))
    np.testing.assert_allclose(found(3.0, 0.0)[0], 3.0, rtol=error)
    np.testing.assert_allclose(found(0.0, 0.5)[1], 0.5, rtol=4 * np.sqrt(2 / (spins * count)))
