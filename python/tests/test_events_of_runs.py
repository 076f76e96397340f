"""Events of runs, compared with clusters of SciPy and the local strain of `gshear.analysis`."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gshear import Frame, Run, analysis, programs

# Runs, and the share of D²min that is active.
SHARES = {
    "disks": 0.02,
    "spheres": 0.02,
    "disks without walls": 0.02,
    "disks in a box": 0.1,
    "box": 0.1,
}
REACH, GAP = 1.5, 1


def active_grains(run: Run, share: float) -> pd.DataFrame:
    """Returns the grains of the greatest D²min: interval and grain."""
    free = run.frame(0).body == 0
    rows = []
    for t in range(1, len(run.frames)):
        dmin = run.dmin(t)
        defined = np.flatnonzero(free & np.isfinite(dmin))
        rows += [{"interval": t - 1, "grain": n, "dmin": dmin[n]} for n in defined]
    table = pd.DataFrame(rows)
    count = round(share * len(table))
    return table.nlargest(count, "dmin").sort_values(["interval", "grain"], ignore_index=True)


def clusters(run: Run, active: pd.DataFrame) -> list[set[tuple[int, int]]]:
    """Returns the clusters of active grains by all pairs: interval and grain of each."""
    frames = list(run.frames)
    places, radius = [frame.position for frame in frames], frames[0].radius
    diameter = 2 * radius.mean()
    interval, grain = active["interval"].to_numpy(), active["grain"].to_numpy()
    links = []
    for a in range(len(active)):
        for b in range(a + 1, len(active)):
            ahead = interval[b] - interval[a]
            if ahead > GAP + 1:
                break
            # Within an interval in its earlier frame, else where the first one ends.
            end = places[interval[a] + (ahead > 0)][grain[a]]
            r = places[interval[b]][grain[b]] - end
            distance = np.linalg.norm(frames[interval[b]].box.minimum_image(r))
            touching = radius[grain[a]] + radius[grain[b]]
            if distance <= max(REACH * diameter, touching):
                links.append((a, b))
    i, j = np.array(links, dtype=int).reshape(-1, 2).T
    count = len(active)
    _, label = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(count, count)))
    found: dict[int, set[tuple[int, int]]] = {}
    for k, name in enumerate(label):
        found.setdefault(int(name), set()).add((int(interval[k]), int(grain[k])))
    return list(found.values())


@pytest.mark.parametrize("name", SHARES)
def test_events_are_clusters_of_scipy_with_the_local_strain(
    name: str, copy: Callable[[str], Path]
) -> None:
    with Run(copy(name), quiet=True) as run:
        options = ["--share", str(SHARES[name]), "--gap", str(GAP), "--formats", "svg"]
        program = str(programs.find("gshear-reduce"))
        programs.run([program, "events", str(run.path), *options], quiet=True)
        events, grains = run.events(), run.event_grains()
        active = active_grains(run, SHARES[name])
        assert len(active) > 10
        listed = grains.sort_values(["start_frame", "grain"], ignore_index=True)
        np.testing.assert_array_equal(listed["start_frame"], active["interval"])
        np.testing.assert_array_equal(listed["grain"], active["grain"])
        np.testing.assert_allclose(listed["dmin"], active["dmin"], rtol=1e-9)
        found = [
            set(zip(rows["start_frame"], rows["grain"], strict=True))
            for _, rows in grains.groupby("event")
        ]
        wanted = clusters(run, active)
        assert len(found) == len(events) > 1
        assert sorted(map(sorted, found)) == sorted(map(sorted, wanted))
        # One by one.
        for number, rows in grains.groupby("event"):
            event = events.loc[number]
            assert event["grains"] == rows["grain"].nunique()
            assert event["start_frame"] == rows["start_frame"].min()
            assert event["end_frame"] == rows["end_frame"].max()
            assert event["dmin_sum"] == pytest.approx(rows["dmin"].sum(), rel=1e-12)
            assert event["shear_strain_sum"] == pytest.approx(rows["shear_strain"].sum(), rel=1e-9)
        up = run.dimension - 1
        for row in grains.iloc[:: max(1, len(grains) // 10)].to_dict("records"):
            pair = [run.frame(row["start_frame"]), run.frame(row["end_frame"])]
            at = analysis.local_strain(pair).isel(frame=0, grain=row["grain"])
            assert row["strain"] == pytest.approx(float(at["shear"]), rel=1e-8)
            along = 2 * float(at["strain"][0, up])
            assert row["shear_strain"] == pytest.approx(along, rel=1e-8, abs=1e-12)
        assert events.attrs["units"]["dmin_sum"] == "m2"
        assert events.attrs["units"]["stress_drop"] == "Pa"


def test_the_propagator_is_the_mean_over_grains_around_events(copy: Callable[[str], Path]) -> None:
    """Of one ring: a fit by NumPy to the non-affine displacements of `gshear.analysis`."""
    with Run(copy("disks without walls"), quiet=True) as run:
        events, found = run.events(), run.propagator()
        diameter = 2 * run.frame(0).radius.mean()
        ring = found[(found["range"] == "ring") & (found["quantity"] == "radial_displacement")]
        inner, outer = ring["from"].unique()[2], ring["to"].unique()[2]
        at = ring["at"].unique()[2]
        functions, values = [], []
        for event in events.to_dict("records"):
            earlier, later = run.frame(event["start_frame"]), run.frame(event["end_frame"])
            counts = (earlier.contacts.coordination() > 2) & (earlier.body == 0)
            u = analysis.non_affine_displacement([earlier, later], grains=counts)[0].to_numpy()
            r = earlier.box.minimum_image(earlier.position - [event["x"], event["y"], 0])
            distance = np.hypot(r[:, 0], r[:, 1])
            near = counts & (distance >= inner) & (distance < outer)
            r, distance, u = r[near], distance[near], u[near]
            angle = np.arctan2(r[:, 1], r[:, 0])
            waves = [np.ones(len(angle))]
            for m in range(1, 5):
                waves += [np.cos(m * angle), np.sin(m * angle)]
            functions.append(np.array(waves).T * (at / distance)[:, None])
            values.append((u[:, :2] * r[:, :2]).sum(axis=1) / distance)
        design, value = np.concatenate(functions), np.concatenate(values)
        best = np.linalg.lstsq(design, value, rcond=None)[0]
        of_ring = ring[ring["from"] == inner]
        assert (of_ring["grains"] == len(value)).all()
        assert outer - inner == pytest.approx(diameter)
        scale = np.abs(best).max()
        np.testing.assert_allclose(of_ring["cos"], best[[0, 1, 3, 5, 7]], atol=1e-8 * scale)
        np.testing.assert_allclose(of_ring["sin"][1:], best[[2, 4, 6, 8]], atol=1e-8 * scale)
        assert (of_ring["cos_error"] > 0).all()


def test_events_of_another_run_are_found_anew(
    copy: Callable[[str], Path], reduced: Callable[[str], Path]
) -> None:
    other = reduced("other disks")
    with Run(other, quiet=True) as run:
        run.events()
    with Run(copy("disks"), quiet=True) as run:
        right = run.events()
        for name in ("events.csv", "events-grains.csv"):
            shutil.copy(other / name, run.folder / name)
        pd.testing.assert_frame_equal(run.events(), right)
        shutil.copy(other / "events.csv", run.folder / "events.csv")
        pd.testing.assert_frame_equal(run.events(), right)


def test_tables_without_lines_are_those_that_were_asked_for(copy: Callable[[str], Path]) -> None:
    with Run(copy("disks"), quiet=True) as run:
        program = str(programs.find("gshear-reduce"))
        programs.run([program, "events", str(run.path), "--threshold", "1e9"], quiet=True)
        programs.run([program, "correlate", str(run.path), "--from", "10"], quiet=True)
        assert len(run.events()) == len(run.event_grains()) == 0
        assert len(run.measures()) == 0
        assert run.correlations()["pairs"].sum() == 0


def test_scalars_phases_and_stages_of_spheres(copy: Callable[[str], Path], tmp_path: Path) -> None:
    """Regions by scikit-learn's definition, principal stresses and angles by NumPy."""
    with Run(copy("spheres"), quiet=True) as run:
        regions = run.regions()
        frames = len(run.frames)
        assert len(regions) == frames
        for t in (frames // 2, frames - 1):
            earlier, later = run.frame(t - 1), run.frame(t)
            before = dict(zip(map(tuple, earlier.contacts.pairs), sizes(earlier), strict=True))
            reduction = np.zeros(len(later.radius))
            for pair, size in zip(later.contacts.pairs, sizes(later), strict=True):
                change = size - before[tuple(pair)] if tuple(pair) in before else 0.0
                reduction[pair] += change
            order = np.lexsort((np.arange(len(reduction)), reduction))
            chosen = order[: max(1, round(0.01 * len(reduction)))]
            chosen = np.sort(chosen[reduction[chosen] < 0])
            places = later.position[chosen]
            apart = later.box.minimum_image(places[:, None] - places[None])
            near = np.linalg.norm(apart, axis=2) <= 5 * later.radius.mean()
            assert regions["regions"][t] == connected_components(coo_array(near))[0]
            touching = np.isin(later.contacts.pairs, chosen).any(axis=1)
            force = later.contacts.force[touching]
            angle = np.arccos(np.abs(force[:, 0]) / np.linalg.norm(force, axis=1))
            assert regions["region_angle_mean"][t] == pytest.approx(angle.mean(), rel=1e-6)
            assert regions["dmin_greatest"][t] == pytest.approx(np.nanmax(run.dmin(t)), rel=1e-12)
            stress = [
                np.linalg.eigvalsh(analysis.grain_stress(frame.contacts).to_numpy())[:, -1]
                for frame in (earlier, later)
            ]
            defined = np.isfinite(run.dmin(t))
            ranks = [
                pd.Series(x[defined]).rank() for x in (np.abs(stress[1] - stress[0]), run.dmin(t))
            ]
            rho = ranks[0].corr(ranks[1])
            assert regions["stress_dmin_rho"][t] == pytest.approx(rho, abs=1e-9)
        assert run.measures()["dmin_max"].max() > 0
        assert len(run.correlations()) > 0
        program = str(programs.find("gshear-reduce"))
        programs.run([program, "stages", str(run.path), "--out", str(tmp_path)], quiet=True)
        grains = pd.read_csv(tmp_path / "stages-grains.csv")
        assert {"x", "y", "z", "u_x", "u_y", "u_z"} <= set(grains)
        steps = pd.read_csv(tmp_path / "stages-steps.csv")
        row = steps.iloc[0]
        pair = run.frames.step.searchsorted([row["start_step"], row["end_step"]])
        earlier, later = (run.frame(int(t)) for t in pair)
        few = earlier.contacts.coordination() <= np.where(earlier.body == 0, 3, 2)
        u = analysis.non_affine_displacement([earlier, later], grains=~few)[0].to_numpy()
        own = grains[grains["step"] == 1][["u_x", "u_y", "u_z"]].to_numpy()
        np.testing.assert_allclose(own, u, atol=1e-9 * np.abs(u).max())
        contacts = pd.read_csv(tmp_path / "stages-contacts.csv")
        assert {"z_i", "z_j", "force_change"} <= set(contacts)


def sizes(frame: Frame) -> NDArray[np.float64]:
    """Returns |f| of the contacts."""
    size: NDArray[np.float64] = np.linalg.norm(frame.contacts.force, axis=1)
    return size
