#!/usr/bin/env python3
"""Speed of sound in columns of spheres, against the moduli of their packings and effective media.

sound.py BOX...     (of configs/moduli-friction-3d.toml; docs/validation/physics.md has the
commands)

Beside each BOX are runs of the column of its copies: BOX-held, in which the walls rest, BOX-p with
one cycle of the bottom wall along the column, and BOX-s with one of the top wall across it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from moduli import relaxation, stress_change
from response import springs, stiffness
from scipy.interpolate import CubicSpline

from gshear import Run

# Mean diameters from the walls to the part of the column that is measured, and of each layer in it.
MARGIN = 12.0
LAYER = 4.0
# Times at which signals are compared, over those of the frames.
FINER = 200


def flight(held: Run, sent: Run, axis: int, expected: float) -> tuple[float, float]:
    """Speed of a pulse and its standard error, by the delays between layers.

    Args:
        held: The run without the pulse.
        sent: The run with it.
        axis: Axis of the motion: z from the bottom wall, or x from the top wall.
        expected: Speed within a factor of 1.5.
    """
    steps, of_held, of_sent = np.intersect1d(
        held.frames.step, sent.frames.step, return_indices=True
    )
    frame = held.frame(0)
    height, free = frame.position[:, 2], frame.body == 0
    margin = MARGIN * 2.0 * float(np.mean(frame.radius))
    low, high = height[free].min() + margin, height[free].max() - margin
    count = round((high - low) / (LAYER / MARGIN * margin))
    layer = np.digitize(height, np.linspace(low, high, count + 1)) - 1
    layers = [np.flatnonzero(free & (layer == k)) for k in range(count)]
    signal = np.zeros((len(steps), count))
    for row, (one, other) in enumerate(zip(of_held, of_sent, strict=True)):
        moved = sent.frame(int(other)).velocity - held.frame(int(one)).velocity
        signal[row] = [np.mean(moved[grains, axis]) for grains in layers]
    time = steps * held.scene["time.step"]
    fine = np.linspace(time[0], time[-1], FINER * len(time))
    signal = CubicSpline(time, signal)(fine)
    places = np.array([height[grains].mean() for grains in layers])
    # Delays against the layer next to the wall that moves, of less than that of an echo.
    first = 0 if axis == 2 else count - 1
    spectrum = np.fft.rfft(signal, 2 * len(fine), axis=0)
    similar = np.fft.irfft(spectrum * spectrum[:, first : first + 1].conj(), axis=0)
    step = fine[1] - fine[0]
    delays = []
    for k, way in enumerate(np.abs(places - places[first])):
        most = int(1.5 * way / expected / step) + 1
        delays.append(np.argmax(similar[:most, k]) * step)
    (slowness, _), covariance = np.polyfit(places, delays, 1, cov=True)
    speed = 1.0 / abs(float(slowness))
    return speed, speed**2 * float(np.sqrt(covariance[0, 0]))


def effective_medium(run: Run) -> tuple[float, float]:
    """Bulk and shear modulus of an effective medium (Makse et al., Phys. Rev. E 70, 061302)."""
    young, nu = run.scene["material.young_modulus"], run.scene["material.poisson_ratio"]
    rigidity = young / (2.0 * (1.0 + nu))
    k_n, k_t = 4.0 * rigidity / (1.0 - nu), 8.0 * rigidity / (2.0 - nu)
    series = run.series
    contacts = (series.solid_fraction[0] * series.coordination[0]) ** (2.0 / 3.0)
    contacts *= (6.0 * np.pi * series.pressure[0] / k_n) ** (1.0 / 3.0)
    return k_n / (12.0 * np.pi) * contacts, (k_n + 1.5 * k_t) / (20.0 * np.pi) * contacts


def main() -> None:
    """Prints moduli and speeds of each packing, and the means of their ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("boxes", type=Path, nargs="+")
    rows = []
    for folder in parser.parse_args().boxes:
        with Run(folder) as box, Run(f"{folder}-held") as held:
            net, volume = springs(box, 0), box.frame(0).box.volume
            matrix, _, places = stiffness(folder.resolve(), 0)
            series = box.series
            density = series.solid_fraction[0] * box.scene["material.density"]
            small = np.diff(series.shear_stress) / np.diff(series.strain)
            print(
                f"{folder.name}: P {series.pressure[0]:.4g}, Phi {series.solid_fraction[0]:.4f}, z "
                f"{series.coordination[0]:.3f}; G of a small strain "
                f"{1.5 * small[0] - 0.5 * small[1]:.6g}"
            )
            bulk, shear = effective_medium(box)
            row = []
            for wave, axis, strain, medium in (
                ("p", 2, "uniaxial", bulk + 4.0 / 3.0 * shear),
                ("s", 0, "simple-shear", shear),
            ):
                motion = relaxation(net, 3, strain, matrix, places)
                modulus = stress_change(net, volume, 3, strain, motion)
                affine = stress_change(net, volume, 3, strain, np.zeros_like(motion))
                expected = float(np.sqrt(modulus / density))
                with Run(f"{folder}-{wave}") as sent:
                    speed, error = flight(held, sent, axis, expected)
                row += [speed, expected, speed / expected, medium / modulus, affine / modulus]
                print(
                    f"  {wave}: flight {speed:.5f} ± {error:.5f}; modulus by K {modulus:.6g}, "
                    f"its speed {expected:.5f}, ratio {speed / expected:.4f}; effective medium "
                    f"{medium:.5g}, affine {affine:.5g}"
                )
            rows.append(row)
    values = np.array(rows)
    errors = np.std(values, axis=0, ddof=min(1, len(values) - 1)) / np.sqrt(len(values))
    names = ("flight", "by K", "flight over K", "modulus of the medium over K", "affine over K")
    for k, (mean, error) in enumerate(zip(np.mean(values, axis=0), errors, strict=True)):
        print(f"{'ps'[k // 5]}, {names[k % 5]}: {mean:.4f} ± {error:.4f}")


if __name__ == "__main__":
    main()
