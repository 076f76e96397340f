#!/usr/bin/env python3
"""Means and errors of mu(I) and Phi(I) over seeds, drawn, for docs/validation/physics.md.

mu_of_i.py OUT.svg --disks RUN... --spheres RUN...     (one run for each seed)
"""

from __future__ import annotations

import argparse
import csv
import itertools
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.optimize import curve_fit

from gshear import Run

mpl.use("svg")
import matplotlib.pyplot as plt

# Of each part, in which the velocity is constant, the first share is left out.
TRANSIENT = 0.4
# Of a single run, errors are those of the means of so many consecutive blocks.
BLOCKS = 6
# The fits take inertial numbers up to this one: at greater ones the top wall bounces.
GREATEST = 0.12
# mu_2 - mu_s of glass beads (Jop et al. 2006), which numbers up to GREATEST do not determine.
RISE = 0.26
# Share of the layer, around its middle, in which shear rate and solid fraction are measured.
BULK = 0.6


def below(z: np.ndarray, radius: np.ndarray, plane: float, dimension: int) -> float:
    """Area or volume of the grains below a plane."""
    h = np.clip((plane - z) / radius, -1.0, 1.0)
    if dimension == 2:
        part = np.arccos(-h) + h * np.sqrt(1.0 - h * h)
        return float(np.sum(radius**2 * part))
    return float(np.sum(np.pi * radius**3 * (2.0 / 3.0 + h - h**3 / 3.0)))


def bulk(run: Run, frames: np.ndarray) -> tuple[float, float]:
    """Shear rate and solid fraction in the middle of the layer, means over frames."""
    axis = run.dimension - 1
    rates, fractions = [], []
    for number in frames:
        frame = run.frame(int(number))
        height = frame.position[:, axis]
        low, high = np.quantile(height, [0.02, 0.98])
        margin = 0.5 * (1.0 - BULK) * (high - low)
        low, high = low + margin, high - margin
        inside = (height > low) & (height < high)
        rates.append(np.polyfit(height[inside], frame.velocity[inside, 0], 1)[0])
        volume = below(height, frame.radius, high, run.dimension)
        volume -= below(height, frame.radius, low, run.dimension)
        plane = np.prod([run.scene[f"sample.{key}"] for key in ("length", "width")[:axis]])
        fractions.append(volume / (plane * (high - low)))
    return float(np.mean(rates)), float(np.mean(fractions))


def flow(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Means and errors by blocks, for each velocity that lasts: V, I, mu, Phi, I of the walls."""
    with Run(folder) as run:
        series = run.series
        density = run.scene["material.density"]
        radius = run.frame(0).radius
        axes = run.dimension
        lengths = [run.scene[f"sample.{key}"] for key in ("length", "width")[: axes - 1]]
        plane = np.prod(lengths)
        means, errors = [], []
        parts = run.scene["shear.protocol"]
        # The first velocity is reached in steps, which are not measured.
        first = int(np.argmax([part["velocity"] for part in parts]))
        start = sum(part["distance"] for part in parts[:first])
        for part in parts[first:]:
            edges = start + part["distance"] * np.linspace(TRANSIENT, 1.0, BLOCKS + 1)
            start += part["distance"]
            blocks = []
            for since, end in itertools.pairwise(edges):
                at = series.drive_displacement
                during = series[(at > since) & (at <= end)]
                pressure = during.normal_force.mean() / plane
                # Disks sqrt(m/P), spheres d sqrt(rho/P).
                length = np.sqrt(np.pi * np.mean(radius**2)) if axes == 2 else 2.0 * radius.mean()
                unit = length * np.sqrt(density / pressure)
                steps = run.frames.step
                chosen = (steps > during.step.min()) & (steps <= during.step.max())
                rate, fraction = bulk(run, np.flatnonzero(chosen))
                ratio = during.shear_force.mean() / during.normal_force.mean()
                of_walls = part["velocity"] / during.wall_height.mean()
                values = [part["velocity"], rate * unit, ratio, fraction, of_walls * unit]
                blocks.append(values)
            means.append(np.mean(blocks, axis=0))
            errors.append(np.std(blocks, axis=0, ddof=1) / np.sqrt(BLOCKS))
        return np.array(means), np.array(errors)


def table(folders: list[Path]) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard errors over the seeds, by velocity from slow to fast.

    Not every run needs to have all velocities. Of a velocity of one run the error is that of its
    blocks.
    """
    runs: dict[float, list[tuple[np.ndarray, np.ndarray]]] = {}
    for folder in folders:
        for mean, error in zip(*flow(folder), strict=True):
            runs.setdefault(float(mean[0]), []).append((mean, error))
    means, errors = [], []
    for _, seeds in sorted(runs.items()):
        values = np.array([mean for mean, _ in seeds])
        means.append(values.mean(axis=0))
        errors.append(
            values.std(axis=0, ddof=1) / np.sqrt(len(seeds)) if len(seeds) > 1 else seeds[0][1]
        )
    return np.array(means), np.array(errors)


def saturating(i: np.ndarray, static: float, i0: float) -> np.ndarray:
    """Friction that rises by RISE around i0."""
    return static + RISE / (1.0 + i0 / i)


def power(i: np.ndarray, static: float, factor: float, exponent: float) -> np.ndarray:
    """Friction that grows as a power of I."""
    return static + factor * i**exponent


def main() -> None:
    """Prints the fits; writes the figure and, beside it, the points."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--disks", type=Path, nargs="+", required=True)
    parser.add_argument("--spheres", type=Path, nargs="+", required=True)
    arguments = parser.parse_args()
    figure, (above, beneath) = plt.subplots(2, 1, figsize=(6.4, 6.4), sharex=True)
    with arguments.out.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["dimension", "V", "I", "I_error", "mu", "mu_error", "phi", "phi_error", "I_walls"]
        )
        for dimension, folders, colour in (
            (2, arguments.disks, "C0"),
            (3, arguments.spheres, "C1"),
        ):
            mean, error = table(folders)
            for m, e in zip(mean, error, strict=True):
                values = (m[0], m[1], e[1], m[2], e[2], m[3], e[3], m[4])
                writer.writerow([dimension, *(f"{value:.4g}" for value in values)])
            slow = mean[:, 1] < GREATEST
            i, ratio = mean[slow, 1], mean[slow, 2]
            line = np.geomspace(i.min(), i.max(), 200)
            name = "disks" if dimension == 2 else "spheres"
            laws = [("power", power, (0.28, 1.0, 0.8), ":")]
            if dimension == 3:
                laws.append(("saturating", saturating, (0.3, 0.3), "-"))
            for label, law, guess, style in laws:
                fit, covariance = curve_fit(
                    law, i, ratio, guess, error[slow, 2], absolute_sigma=True, bounds=(0.0, 10.0)
                )
                root = np.sqrt(np.diag(covariance))
                distance = np.sum(((ratio - law(i, *fit)) / error[slow, 2]) ** 2)
                distance /= len(i) - len(fit)
                numbers = ", ".join(f"{a:.3f} ± {b:.3f}" for a, b in zip(fit, root, strict=True))
                print(f"{name}, {label}: {numbers}; chi^2 per degree {distance:.1f}")
                above.plot(line, law(line, *fit), style, color=colour, lw=1)
            i = mean[:, 1]
            above.errorbar(i, mean[:, 2], error[:, 2], fmt="o", ms=4, color=colour, label=name)
            beneath.errorbar(i, mean[:, 3], error[:, 3], fmt="o", ms=4, color=colour, label=name)
            slope, at_rest = np.polyfit(i[slow], mean[slow, 3], 1)
            print(f"{name}, Phi = {at_rest:.4f} {slope:+.3f} I")
    line = np.geomspace(3e-5, 0.4, 200)
    above.plot(line, 0.25 + 1.1 * line, "--", color="C0", lw=1, label="da Cruz et al. 2005, disks")
    above.plot(
        line, saturating(line, 0.38, 0.28), "--", color="C1", lw=1, label="Jop et al. 2006, beads"
    )
    beneath.plot(line, 0.81 - 0.3 * line, "--", color="C0", lw=1)
    above.set(xscale="log", ylabel="μ = S/N", ylim=(0.2, 0.75))
    beneath.set(xlabel="I", ylabel="Φ")
    above.legend(frameon=False, fontsize=9)
    figure.tight_layout()
    figure.savefig(arguments.out)


if __name__ == "__main__":
    main()
