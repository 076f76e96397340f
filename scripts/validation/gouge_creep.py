#!/usr/bin/env python3
"""What relaxes μ in a gouge: the impedance of the layer, its stiffness, and agitation.

    gouge_creep.py OUT [NAME ...]

Runs configs/gouge-holds-cheap.toml with three seeds into OUT, branches of it, and prints the tables
of docs/validation/gouge.md. NAME is one or more of impedance, holds, frequencies, loads, kicks,
long_holds, large, reload, reslides, damping, steps, long_steps, collapse, figure (default: all).
Runs that are there already are not made again. About five hours of a core, three of them the steps
of 5 mm.
kicks needs xxhash of PyPI, for the checksum of a checkpoint that it changes. e_k is the kinetic
energy of a free grain over P d³.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
from pandas import read_csv

from gshear import Run

SCENE = Path(__file__).parents[2] / "configs/gouge-holds-cheap.toml"
PROGRAM = os.environ.get("GSHEAR_MPI", "gshear-mpi")
SEEDS = (1, 2, 3)
FAST = "{velocity=1.0,distance=20e-3}"
SLIDE = "{velocity=0.1,distance=1e-3}"
VELOCITIES = (0.0, 0.01, 0.05, 0.1, 0.15, 0.2, 0.4, 1.0)
FREQUENCY = 20e3
AMPLITUDES = (0.5e-6, 1e-6, 2e-6, 4e-6)
# Since the start of a hold (s).
TIMES = (1e-4, 1e-3, 3e-3, 10e-3)
# A grain slips through a wall of one layer in a second of agitation.
THICK = ("sample.wall_thickness=2", "sample.grains=915")
# Other frequencies, and amplitudes whose velocities are those of AMPLITUDES.
FREQUENCIES = (10e3, 40e3)
# Amplitudes of the load (Pa) at FREQUENCY, another source of agitation.
LOADS = (0.05e6, 0.1e6, 0.2e6, 0.5e6)
# Random kicks (m/s, the deviation of each component of the velocity), and the time between two (s).
KICKS = (0.05, 0.1, 0.2, 0.4)
BETWEEN_KICKS = 1.0 / FREQUENCY
# Figure S2: velocities of the slide and of the reslides (m/s), and slip where curves are read (m).
SLOW = 0.02
RESLIDES = (0.05, 0.1, 0.3)
RESLIDE_SLIPS = (0.02e-3, 0.05e-3, 0.1e-3, 0.2e-3, 0.5e-3, 1e-3, 2e-3)
# Slip at 0.1 m/s (m): windows of the table of the direct effect.
SLIPS = (0.0, 1e-6, 2.5e-6, 5e-6, 10e-6, 25e-6)


def program(out: Path, *arguments: str) -> None:
    """Makes a run, if it is not there and finished."""
    if (out / "run.h5").exists():
        with Run(out, quiet=True) as run:
            if run.finished:
                return
        shutil.rmtree(out)
    # Rank and messages are of no interest; the reason of a failure is on standard error.
    subprocess.run([PROGRAM, *arguments, "--quiet"], check=True, stdout=subprocess.DEVNULL)


def base(out: Path, seed: int, name: str = "base", *sets: str) -> Path:
    """Returns the folder of the base case of a seed, with other keys if they are given."""
    folder = out / f"{name}/seed-{seed}"
    changes = [word for key in sets for word in ("--set", key)]
    program(folder, str(SCENE), "--sweep", str(seed), "--out", str(out / name), *changes)
    return folder


def checkpoint_after(folder: Path, parts: int) -> Path:
    """Returns the checkpoint of a run at the end of its first `parts` parts."""
    with Run(folder, quiet=True) as run:
        velocity, step = (run.series[name].to_numpy() for name in ("drive_velocity", "step"))
        last = int(step[np.flatnonzero(np.diff(velocity))[parts - 1]])
    kept = [int(p.stem.rpartition("-")[2]) for p in folder.glob("checkpoint-[0-9]*.h5")]
    return folder / f"checkpoint-{min(kept, key=lambda step: abs(step - last))}.h5"


def branch(out: Path, start: tuple[Path, int], name: str, parts: list[str], *sets: str) -> Path:
    """Makes a branch that begins after parts of a run, and returns its folder."""
    source, done = start
    folder = out / name / source.name
    branch_from(checkpoint_after(source, done), folder, parts, *sets)
    return folder


def branch_from(checkpoint: Path, folder: Path, parts: list[str], *sets: str) -> None:
    """Makes a branch of a checkpoint with another protocol and perhaps other keys."""
    keys = [f"shear.protocol=[{','.join(parts)}]", *sets]
    changes = [word for key in keys for word in ("--set", key)]
    program(folder, "--resume", str(checkpoint), "--branch", str(folder), *changes)


def columns(folder: Path, *names: str) -> list[np.ndarray]:
    """Returns columns of the time series."""
    with Run(folder, quiet=True) as run:
        return [run.series[name].to_numpy() for name in names]


def mean(values: list[float]) -> str:
    """Mean and standard error over the seeds."""
    error = np.std(values, ddof=1) / np.sqrt(len(values))
    return f"{np.mean(values):.4g} ± {error:.2g}"


def impedance(out: Path) -> None:
    """Jumps of the drive's velocity from one state that slides at 0.1 m/s."""
    found: dict[float, list[list[float]]] = {}
    for seed in SEEDS:
        start = (base(out, seed), 2)
        curves = {}
        for v in VELOCITIES:
            parts = [FAST, SLIDE, f"{{velocity={v},time=3e-4}}"]
            time, mu = columns(branch(out, start, f"jump-{v}", parts), "time", "stress_ratio")
            curves[v] = (time - time[0], mu)
        time, at_rest = curves[0.1]
        for v in VELOCITIES:
            if v == 0.1:
                continue
            change = (np.interp(time, *curves[v]) - at_rest) / (v - 0.1)
            windows = [
                change[(time > a / 0.1) & (time <= b / 0.1)].mean() for a, b in pairwise(SLIPS)
            ]
            late = change[(time > 1.5e-4)].mean()
            found.setdefault(v, []).append([change[time < 1e-4].max(), *windows, late])
    print(
        "velocity,peak (s/m)," + ",".join(f"to {b / 0.1 * 1e6:.0f} us" for b in SLIPS[1:]) + ",late"
    )
    for v, rows in found.items():
        print(f"{v}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def agitated(amplitude: float, frequency: float = FREQUENCY) -> str:
    """Keys of a part under vibration."""
    return f",bottom_amplitude={amplitude},bottom_frequency={frequency}" if amplitude else ""


def holds(out: Path) -> None:
    """Holds under vibration, after a slide without and with it."""
    print(
        "vibrated,amplitude (m),e_k," + ",".join(f"{t * 1e3:g} ms" for t in TIMES) + ",per factor e"
    )
    for kind, amplitudes in (("hold", (0.0, *AMPLITUDES)), ("slide", AMPLITUDES[1:2])):
        for amplitude in amplitudes:
            of = agitated(amplitude)
            slide = SLIDE[:-1] + (of if kind == "slide" else "") + "}"
            parts = [FAST, slide, f"{{velocity=0.0,time=10e-3{of}}}"]
            rows = []
            for seed in SEEDS:
                start = (base(out, seed), 2 if kind == "hold" else 1)
                folder = branch(out, start, f"{kind}-{amplitude}", parts)
                rows.append(relaxation(folder, start[0] if kind == "hold" else folder))
            print(
                f"{kind},{amplitude},"
                + ",".join(mean(list(column)) for column in np.transpose(rows))
            )


def frequencies(out: Path) -> None:
    """Holds under vibrations of other frequencies, of the same velocities."""
    print(
        "frequency (Hz),amplitude (m),e_k," + ",".join(f"{t * 1e3:g} ms" for t in TIMES) + ",slope"
    )
    for frequency in FREQUENCIES:
        for amplitude in AMPLITUDES:
            of = agitated(amplitude * FREQUENCY / frequency, frequency)
            parts = [FAST, SLIDE, f"{{velocity=0.0,time=10e-3{of}}}"]
            rows = []
            for seed in SEEDS:
                start = (base(out, seed), 2)
                folder = branch(out, start, f"hold-{frequency:g}-{amplitude}", parts)
                rows.append(relaxation(folder, start[0]))
            means = ",".join(mean(list(column)) for column in np.transpose(rows))
            print(f"{frequency},{amplitude * FREQUENCY / frequency:g},{means}")


def loads(out: Path) -> None:
    """Holds while the load vibrates, not the wall."""
    print("amplitude (Pa),e_k," + ",".join(f"{t * 1e3:g} ms" for t in TIMES) + ",slope")
    for amplitude in LOADS:
        of = f"pressure=5e6,pressure_amplitude={amplitude},pressure_frequency={FREQUENCY}"
        rows = []
        for seed in SEEDS:
            start = (base(out, seed), 2)
            parts = [FAST, SLIDE, f"{{velocity=0.0,time=10e-3,{of}}}"]
            rows.append(relaxation(branch(out, start, f"load-{amplitude:g}", parts), start[0]))
        print(f"{amplitude:g}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def kick(checkpoint: Path, deviation: float, random: np.random.Generator) -> None:
    """Adds normal deviates (m/s) without a mean to the velocities of the free grains."""
    from xxhash import xxh3_64_intdigest

    with h5py.File(checkpoint, "r+") as file:
        grains = file["grains"]
        velocity, free = grains["velocity"][:], grains["body"][:] == 0
        kicks = random.normal(0.0, deviation, (int(free.sum()), 3))
        velocity[free] += kicks - kicks.mean(axis=0)
        # In the order of a record; the first material is not written.
        names = "id body position velocity angular_velocity radius force torque image material"

        def checksum() -> str:
            present = [name for name in names.split() if name in grains]
            types = [(name, grains[name].dtype, grains[name].shape[1:]) for name in present]
            records = np.empty(len(velocity), types)
            for name in present:
                records[name] = grains[name][:]
            total = sum(xxh3_64_intdigest(record.tobytes()) for record in records)
            return f"{total % 2**64:016x}"

        if checksum().encode() != file.attrs["checksum_grains"]:
            sys.exit(f"{checkpoint}: the checksum of the grains is another")
        grains["velocity"][:] = velocity
        file.attrs.modify("checksum_grains", np.bytes_(checksum()))


def kicks(out: Path) -> None:
    """Holds in which the free grains get random velocities at 20 kHz."""
    print("kicks (m/s),e_k," + ",".join(f"{t * 1e3:g} ms" for t in TIMES) + ",slope")
    for deviation in KICKS:
        rows = []
        for seed in SEEDS:
            start = (base(out, seed), 2)
            folder = out / f"kicks-{deviation}/seed-{seed}"
            if not (folder / "kicked").exists():
                shutil.rmtree(folder, ignore_errors=True)
                kicked_hold(checkpoint_after(*start), folder, deviation, seed)
                (folder / "kicked").touch()
            rows.append(relaxation(folder, start[0]))
        print(f"{deviation}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def kicked_hold(checkpoint: Path, folder: Path, deviation: float, seed: int) -> None:
    """A hold of 10 ms in legs, with a kick before each."""
    random = np.random.default_rng(seed)
    with Run(checkpoint.parent, quiet=True) as run:
        step = run.parameters["time_step"]
    first = int(checkpoint.stem.rpartition("-")[2])
    between = round(BETWEEN_KICKS / step)
    started = shutil.copy(checkpoint, checkpoint.with_name("kicked.h5"))
    kick(started, deviation, random)
    arguments = ["--resume", str(started), "--branch", str(folder)]
    for leg in range(1, round(TIMES[-1] / BETWEEN_KICKS)):
        stop = ["--stop-at", str(first + leg * between), "--quiet"]
        done = subprocess.run([PROGRAM, *arguments, *stop], stdout=subprocess.DEVNULL)
        if done.returncode != 75:
            sys.exit(f"{folder} ended with {done.returncode}")
        kick(folder / "checkpoint.h5", deviation, random)
        arguments = ["--resume", str(folder)]
    subprocess.run([PROGRAM, *arguments, "--quiet"], check=True, stdout=subprocess.DEVNULL)


def long_holds(out: Path) -> None:
    """Holds of 100 ms under vibration: whether the logarithm goes on."""
    # Rows are 0.1 ms apart.
    times = (*TIMES[1:], 30e-3, 90e-3)
    print("amplitude (m),e_k," + ",".join(f"{t * 1e3:g} ms" for t in times) + ",slope")
    for amplitude in AMPLITUDES[1:3]:
        parts = [FAST, SLIDE, f"{{velocity=0.0,time=100e-3{agitated(amplitude)}}}"]
        rows = []
        for seed in SEEDS:
            start = (base(out, seed), 2)
            folder = branch(out, start, f"long-hold-{amplitude}", parts)
            rows.append(relaxation(folder, start[0], times))
        print(f"{amplitude}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def large(out: Path) -> None:
    """The same holds with the paper's number of spheres, one packing."""
    size = ("sample.grains=4815", "sample.length=60e-3", "sample.width=60e-3")
    print("amplitude (m),e_k," + ",".join(f"{t * 1e3:g} ms" for t in TIMES) + ",per factor e")
    for amplitude in AMPLITUDES[1:]:
        parts = [FAST, SLIDE, f"{{velocity=0.0,time=10e-3{agitated(amplitude)}}}"]
        start = (base(out, 1, "large", *size), 2)
        folder = branch(out, start, f"large-hold-{amplitude}", parts)
        print(f"{amplitude}," + ",".join(f"{x:.4g}" for x in relaxation(folder, start[0])))


def reslides(out: Path) -> None:
    """Holds of 0.1 to 100 ms and slides after each, all of it under vibration."""
    for amplitude, start, sets in (
        (AMPLITUDES[2], "base", ()),
        (AMPLITUDES[2], "thick", THICK),
        (AMPLITUDES[1], "thick", THICK),
    ):
        of = agitated(amplitude)
        slide = SLIDE[:-1] + of + "}"
        parts = [FAST, slide]
        for time in (1e-4, 1e-3, 1e-2, 1e-1):
            parts += [f"{{velocity=0.0,time={time}{of}}}", slide]
        folders = [
            branch(out, (base(out, seed, start, *sets), 1), f"healing-{start}-{amplitude}", parts)
            for seed in SEEDS
        ]
        reduced = folders[0].parent / "rate-state"
        reducer = os.environ.get("GSHEAR_REDUCE", "gshear-reduce")
        command = [reducer, "rate-state", *map(str, folders), "--out", str(reduced)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        holds = read_csv(reduced / "holds.csv")
        print(f"reslides at {amplitude} m, {start}:")
        print(holds[["t_hold", "relaxation", "healing", "error"]].to_csv(index=False))


def damping(out: Path) -> None:
    """Slide and hold with the damping of eq. 8 taken literally, after the fast part."""
    parts = [FAST, SLIDE, "{velocity=0.0,time=10e-3}"]
    literal = [
        *("contact.restitution=none", "contact.impact_speed=none", "contact.impact_diameter=none"),
        "contact.normal_damping=1.0e4",
    ]
    print("damping,e_k in the slide," + ",".join(f"{t * 1e3:g} ms" for t in TIMES))
    for name, sets in (("base", []), ("literal", literal)):
        folders = [
            branch(out, (base(out, seed), 1), name + "-damping", parts, *sets) for seed in SEEDS
        ]
        rows = [[slide_energy(f), *relaxation(f, f)[1:-1]] for f in folders]
        print(f"{name}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def slide_energy(folder: Path) -> float:
    """e_k less that of a linear profile in the latter half of a slide at 0.1 m/s."""
    velocity, rate, kinetic = columns(folder, "drive_velocity", "slip_rate", "kinetic_energy")
    slide = np.flatnonzero(velocity == 0.1)
    late = slide[len(slide) // 2 :]
    unit, free, mass = units(folder)
    return float((kinetic[late] / free - mass * rate[late] ** 2 / 6.0).mean() / unit)


def units(folder: Path) -> tuple[float, int, float]:
    """P d³ (J), the number of free grains and their mean mass (kg)."""
    with Run(folder, quiet=True) as run:
        grains = run.hdf5["particles/trajectory"]
        unit = run.parameters["pressure"] * (2.0 * grains["radius"][:].mean()) ** 3
        free = grains["body"][:] == 0
        return unit, int(free.sum()), float(grains["mass"][:][free].mean())


def relaxation(folder: Path, slide: Path, times: tuple[float, ...] = TIMES) -> list[float]:
    """e_k in the latter half of a hold, changes of μ after `times`, and their slope over ln t.

    Changes are since the end of the slide before, which is in the run `slide`.
    """
    velocity, mu = columns(slide, "drive_velocity", "stress_ratio")
    start = mu[velocity == 0.1][-20:].mean()
    velocity, time, mu, kinetic = columns(
        folder, "drive_velocity", "time", "stress_ratio", "kinetic_energy"
    )
    unit, free, _ = units(folder)
    hold = np.flatnonzero(velocity == 0.0)
    since = time[hold] - time[hold[0]] + (time[hold[1]] - time[hold[0]])
    mu, kinetic = mu[hold], kinetic[hold]
    changes = []
    for t in times:
        near = (since > t / 1.2) & (since < t * 1.2)
        line = np.polyfit(np.log(since[near] / t), mu[near], 1)
        changes.append(line[1] - start)
    slope = (changes[-1] - changes[0]) / np.log(times[-1] / times[0])
    return [kinetic[len(hold) // 2 :].mean() / free / unit, *changes, slope]


def reload(out: Path) -> None:
    """A slow slide after an agitated hold: the slope of μ over the displacement of the drive.

    It is taken until μ has risen half of the way to its greatest value, as rate-state does.
    """
    amplitude = AMPLITUDES[-2]
    hold = f"{{velocity=0.0,time=10e-3{agitated(amplitude)}}}"
    slopes = []
    for seed in SEEDS:
        held = branch(out, (base(out, seed), 2), f"hold-{amplitude}", [FAST, SLIDE, hold])
        parts = [FAST, SLIDE, hold, "{velocity=0.02,distance=5e-4}"]
        folder = out / "reload" / held.name
        last = max(held.glob("checkpoint-[0-9]*.h5"), key=lambda p: int(p.stem.split("-")[1]))
        branch_from(last, folder, parts)
        driven, mu = columns(folder, "drive_displacement", "stress_ratio")
        risen = np.argmax(mu >= mu[0] + 0.5 * (mu.max() - mu[0]))
        slopes.append(np.polyfit(driven[:risen] - driven[0], mu[:risen], 1)[0])
        print(
            f"seed {seed}: from {mu[0]:.4f} to {mu.max():.4f}, {slopes[-1]:.0f} /m in {risen} rows"
        )
    print(f"reload: {mean(slopes)} /m")


def steps(out: Path) -> None:
    """Velocity steps 0.1, 0.01, 0.1 m/s with and without vibration."""
    for amplitude in (0.0, AMPLITUDES[1]):
        of = agitated(amplitude)
        slides = [(0.1, 2e-3), (0.01, 1e-3), (0.1, 2e-3)]
        parts = [FAST, *(f"{{velocity={v},distance={d}{of}}}" for v, d in slides)]
        changes = []
        for seed in SEEDS:
            folder = branch(out, (base(out, seed), 1), f"steps-{amplitude}", parts)
            velocity, mu = columns(folder, "drive_velocity", "stress_ratio")
            edges = [0, *(np.flatnonzero(np.diff(velocity)) + 1), len(mu)]
            last = [mu[(a + b) // 2 : b].mean() for a, b in pairwise(edges)]
            changes.append([last[-2] - last[-3], last[-1] - last[-2]])
        down, up = (list(column) for column in np.transpose(changes))
        print(f"steps, {amplitude} m: down {mean(down)}, up {mean(up)}")


def long_steps(out: Path) -> None:
    """Velocity steps of 5 mm, 0.1, 0.01, 0.1 m/s, under vibration, for gshear-reduce rate-state."""
    print("amplitude (m),e_k at 0.01 m/s,down,up,the last 2.5 mm over ln 10")
    for amplitude in (AMPLITUDES[2], 0.0, AMPLITUDES[1], AMPLITUDES[3]):
        of = agitated(amplitude)
        parts = [FAST, *(f"{{velocity={v},distance=5e-3{of}}}" for v in (0.1, 0.01, 0.1))]
        rows = []
        for seed in SEEDS:
            start = (base(out, seed, "thick", *THICK), 1)
            folder = branch(out, start, f"long-steps-{amplitude}", parts)
            velocity, mu, kinetic = columns(
                folder, "drive_velocity", "stress_ratio", "kinetic_energy"
            )
            edges = [0, *(np.flatnonzero(np.diff(velocity)) + 1), len(mu)]
            fast, slow, again = [mu[(a + b) // 2 : b].mean() for a, b in pairwise(edges)][-3:]
            unit, free, _ = units(folder)
            energy = kinetic[velocity == 0.01].mean() / free / unit
            rate = (0.5 * (fast + again) - slow) / np.log(10.0)
            rows.append([energy, slow - fast, again - slow, rate])
        print(f"{amplitude}," + ",".join(mean(list(column)) for column in np.transpose(rows)))


def collapse(out: Path) -> None:
    """Figure S2: reslides after a slide at 0.02 m/s and a hold of 0.11 s, vibrated and not.

    Prints μ - μ_ss over the slip for each V_r, the line through the peaks over ln(V_r/V_i), and
    the C of (μ - μ_ss)/(C + ln(V_r/V_i)) that brings the peaks together.
    """
    logs = np.log(np.array(RESLIDES) / SLOW)
    for amplitude in (AMPLITUDES[2], 0.0):
        of = agitated(amplitude)
        parts = [
            FAST,
            f"{{velocity={SLOW},distance=5e-3{of}}}",
            f"{{velocity=0.0,time=0.11{of}}}",
        ]
        curves, peaks = [], []
        for seed in SEEDS:
            start = (base(out, seed, "thick", *THICK), 1)
            held = branch(out, start, f"s2-{amplitude}", parts)
            velocity, mu, slip = columns(held, "drive_velocity", "stress_ratio", "slip")
            slide = np.flatnonzero(velocity == SLOW)
            steady = mu[slide[slip[slide] > slip[slide[-1]] - 2e-3]].mean()
            found = []
            for v in RESLIDES:
                reslide = [*parts, f"{{velocity={v},distance=2e-3{of}}}"]
                folder = out / f"s2-{amplitude}-{v}" / held.name
                branch_from(held / "checkpoint.h5", folder, reslide, "output.series_rows=2000")
                mu, slip = columns(folder, "stress_ratio", "slip")
                slip = slip - slip[0]
                windows = pairwise((0.0, *RESLIDE_SLIPS))
                means = [mu[(slip > a) & (slip <= b)].mean() for a, b in windows]
                found.append([mu[slip < RESLIDE_SLIPS[2]].max() - steady, *(means - steady)])
            curves.append(found)
            peaks.append([row[0] for row in found])
        print(f"reslides at {amplitude} m: V_r,peak," + ",".join(f"{s:g}" for s in RESLIDE_SLIPS))
        for v, rows in zip(RESLIDES, np.transpose(curves, (1, 2, 0)), strict=True):
            print(f"{v}," + ",".join(mean(list(of_seeds)) for of_seeds in rows))
        lines = [np.polyfit(logs, row, 1) for row in peaks]
        slopes, at_one = (list(column) for column in np.transpose(lines))
        ratio = np.mean(at_one) / np.mean(slopes)
        print(f"slope {mean(slopes)}, peak at V_r = V_i {mean(at_one)}, C = {ratio:.2g}")


def figure(out: Path) -> None:
    """The slopes of all agitated holds over e_k, in OUT/creep.csv and OUT/creep.svg."""
    table = ["source,amplitude,scaled_kinetic_energy,error,per_factor_e,error_per_factor_e"]
    sources = {
        "wall, 20 kHz": [(a, f"hold-{a}", "base", SEEDS) for a in AMPLITUDES],
        **{
            f"wall, {f / 1e3:g} kHz": [
                (a * FREQUENCY / f, f"hold-{f:g}-{a}", "base", SEEDS) for a in AMPLITUDES
            ]
            for f in FREQUENCIES
        },
        "load, 20 kHz": [(a, f"load-{a:g}", "base", SEEDS) for a in LOADS],
        "random kicks, 20 kHz": [(a, f"kicks-{a}", "base", SEEDS) for a in KICKS],
        "wall, 20 kHz, 4815 spheres": [
            (a, f"large-hold-{a}", "large", SEEDS[:1]) for a in AMPLITUDES[1:]
        ],
    }
    for source, holds in sources.items():
        for amplitude, name, before, seeds in holds:
            rows = [relaxation(out / name / f"seed-{s}", out / before / f"seed-{s}") for s in seeds]
            rows = np.array(rows)[:, [0, -1]]
            error = (
                rows.std(axis=0, ddof=1) / np.sqrt(len(seeds)) if len(seeds) > 1 else [np.nan] * 2
            )
            energy, per_factor = rows.mean(axis=0)
            cells = f"{amplitude:g},{energy:.4g},{error[0]:.2g},{per_factor:.4f},{error[1]:.4f}"
            table.append(f'"{source}",{cells}'.replace("nan", ""))
    (out / "creep.csv").write_text("\n".join(table) + "\n")
    draw(out / "creep.csv", out / "creep.svg")


def draw(table: Path, path: Path) -> None:
    """Draws the table of `figure`."""
    import matplotlib.pyplot as plt

    axes = plt.figure(figsize=(6.0, 4.0), layout="constrained").subplots()
    for source, rows in read_csv(table).groupby("source", sort=False):
        line = "s" if rows["error"].isna().all() else "o-"
        energy, per_factor = rows["scaled_kinetic_energy"], -rows["per_factor_e"]
        errors = rows["error_per_factor_e"], rows["error"]
        axes.errorbar(energy, per_factor, *errors, fmt=line, capsize=2, label=source)
    axes.axhline(0.0247, color="black", linestyle="--", label="a of the paper")
    axes.set(xscale="log", xlabel="kinetic energy of a grain over P d³", xlim=(1e-6, 1e-4))
    axes.set_ylim(0, None)
    axes.xaxis.set_minor_formatter("")
    axes.set_ylabel("fall of μ in a hold, per factor e of time")
    axes.legend(fontsize="small")
    axes.figure.savefig(path, metadata={"Date": None})


EXPERIMENTS = (
    impedance,
    holds,
    frequencies,
    loads,
    kicks,
    long_holds,
    large,
    reload,
    reslides,
    damping,
    steps,
    long_steps,
    collapse,
    figure,
)


def main(out: Path, names: list[str]) -> None:
    """Makes and prints the experiments of these names."""
    for experiment in EXPERIMENTS:
        if not names or experiment.__name__ in names:
            experiment(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
