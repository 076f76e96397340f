#!/usr/bin/env python3
"""Peaks of friction after a hold against ln(V_r/V_i), figure S2 of Ferdowsi & Rubin.

    s2_peaks.py SLIDES RESLIDES RESLIDES ...

SLIDES is the folder of a sweep of configs/gouge-s2.toml or gouge-s2-cheap.toml, with a run for each
seed; each of the RESLIDES holds branches of the same names at one velocity V_r. The peak is that of
the first 0.1 mm of slip, less μ_ss, the mean over the last 2 mm of the slide before the hold.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from gshear import Run

PEAK = 0.1e-3
STEADY = 2e-3


def column(path: Path, *names: str) -> list[np.ndarray]:
    """Returns columns of the time series of a run."""
    with Run(path, quiet=True) as run:
        return [run.series[name].to_numpy() for name in names]


def before(path: Path) -> tuple[float, float, float, float]:
    """Returns V_i, μ_ss, μ at the end of the slide less μ_ss, and the change of μ in the hold."""
    velocity, mu, slip = column(path, "drive_velocity", "stress_ratio", "slip")
    hold = np.flatnonzero(velocity == 0.0)
    v_i = velocity[hold[0] - 1]
    slide = np.flatnonzero(np.isclose(velocity, v_i) & (np.arange(len(mu)) < hold[0]))
    steady = slide[slip[slide] > slip[slide[-1]] - STEADY]
    mu_ss = mu[steady].mean()
    end = mu[slide[-1]]
    return v_i, mu_ss, end - mu_ss, mu[hold[-1]] - end


def main(folders: list[Path]) -> None:
    """Prints a line for each run, the means and the slope."""
    slides, reslides = folders[0], folders[1:]
    peaks, slopes, relaxations = [], [], []
    print("run,mu_ss,end_of_slide,relaxation," + ",".join(f"peak_{f.name}" for f in reslides))
    for path in sorted(slides.iterdir()):
        v_i, mu_ss, end, relaxation = before(path)
        found = []
        for folder in reslides:
            velocity, mu, slip = column(
                folder / path.name, "drive_velocity", "stress_ratio", "slip"
            )
            peak = mu[slip - slip[0] < PEAK].max() - mu_ss
            found.append((np.log(velocity[-1] / v_i), peak))
        x, y = np.array(found).T
        slopes.append(np.polyfit(x, y, 1)[0])
        peaks.append(y)
        relaxations.append(relaxation)
        numbers = [mu_ss, end, relaxation, *y]
        print(path.name + "," + ",".join(f"{number:.5f}" for number in numbers))

    def mean(values: list) -> str:
        error = np.std(values, axis=0, ddof=1) / np.sqrt(len(values))
        return f"{np.round(np.mean(values, axis=0), 4)} ± {np.round(error, 4)}"

    print(f"# relaxation {mean(relaxations)}, peaks {mean(peaks)}, slope {mean(slopes)}")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
