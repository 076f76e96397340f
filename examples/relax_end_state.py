#!/usr/bin/env python3
"""What is left of stress and energy once a catastrophe of a box has come to rest?

    python3 examples/relax_end_state.py RUN [RUN ...] [--drag 0.2]

Takes the last frame of Newton's equations of scenes like configs/bonfanti.toml (spheres, law
mindlin) and follows overdamped dynamics at the same strain, with a drag on velocities and spins,
until no force exceeds 3e-8. Prints shear stress and elastic energy, each over that at the start of
Newton's equations. Forces, stress and energy are those of gshear-mpi; histories turn with their
contacts, about n, too.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gshear import Run

AT_REST = 3e-8
SKIN = 0.15


class State:
    """Spheres in a sheared box, with the histories of their contacts."""

    def __init__(self, run: Run, index: int) -> None:
        """Takes over a frame."""
        frame, contact = run.frames[index], run.scene["contact"]
        self.box, self.radius, self.mass = frame.box, frame.radius, frame.mass
        self.k_n, self.k_t = contact["normal_stiffness"], contact["tangential_stiffness"]
        self.threshold = contact["friction"] * self.k_n / self.k_t
        self.x = frame.unwrapped.copy()
        self.v, self.spin = np.zeros_like(self.x), np.zeros_like(self.x)
        self.i = self.j = np.zeros(0, dtype=int)
        self.t = np.zeros((0, 3))
        kept = frame.contacts
        self.find(
            {
                (int(a), int(b)): t
                for a, b, t in zip(kept.i, kept.j, kept.tangential_history, strict=True)
            }
        )
        self.evaluate(0.0)

    def find(self, histories: dict[tuple[int, int], np.ndarray]) -> None:
        """Lists the pairs that are near each other."""
        i, j = np.triu_indices(len(self.radius), 1)
        apart = np.linalg.norm(self.box.minimum_image(self.x[i] - self.x[j]), axis=1)
        near = apart < self.radius[i] + self.radius[j] + SKIN
        self.i, self.j, self.listed = i[near], j[near], self.x.copy()
        none = np.zeros(3)
        self.t = np.array(
            [histories.get((a, b), none) for a, b in zip(self.i, self.j, strict=True)]
        )

    def evaluate(self, dt: float) -> None:
        """Moves the histories by `dt` and computes forces, torques, stress and energy."""
        i, j = self.i, self.j
        r = self.box.minimum_image(self.x[i] - self.x[j])
        distance = np.linalg.norm(r, axis=1)
        n = r / distance[:, None]
        overlap = np.maximum(self.radius[i] + self.radius[j] - distance, 0.0)
        touch = overlap > 0
        before = np.linalg.norm(self.t, axis=1)
        turned = self.t - np.sum(self.t * n, axis=1)[:, None] * n
        after = np.linalg.norm(turned, axis=1)
        turned *= np.divide(before, after, out=np.zeros_like(after), where=after > 0)[:, None]
        # Half of the rotation of both grains about n.
        twist = 0.5 * dt * np.sum((self.spin[i] + self.spin[j]) * n, axis=1)[:, None]
        turned = np.cos(twist) * turned + np.sin(twist) * np.cross(n, turned)
        rolling = self.radius[i, None] * self.spin[i] + self.radius[j, None] * self.spin[j]
        slip = self.v[i] - self.v[j] + np.cross(n, rolling)
        slip -= np.sum(slip * n, axis=1)[:, None] * n
        self.t = np.where(touch[:, None], turned + dt * slip, 0.0)
        limit = self.threshold * np.maximum(overlap, 1e-200)
        length = np.linalg.norm(self.t, axis=1)
        s = np.minimum(length / limit, 1.0)
        self.t *= np.where(length > limit, limit / np.maximum(length, 1e-300), 1.0)[:, None]
        root = np.sqrt(overlap)
        tangential = -(self.k_t * root * (1 + s - s * s))[:, None] * self.t
        force = (self.k_n * overlap * root)[:, None] * n + tangential
        self.force, self.torque = np.zeros_like(self.x), np.zeros_like(self.x)
        np.add.at(self.force, i, force)
        np.subtract.at(self.force, j, force)
        moment = np.cross(n, tangential)
        np.subtract.at(self.torque, i, self.radius[i, None] * moment)
        np.subtract.at(self.torque, j, self.radius[j, None] * moment)
        self.stress = -np.sum(r[:, 0] * force[:, 2]) / np.prod(self.box.edges)
        stored = 0.4 * self.k_n * root * overlap**2
        square = np.sum(self.t**2, axis=1)
        stored += self.k_t * root * square * (0.5 + s / 3 - s * s / 4)
        self.energy = np.sum(stored)

    def relax(self, drag: float, dt: float, most: int) -> float:
        """Comes to rest; returns the greatest force, or torque over radius."""
        inertia = (0.4 * self.mass * self.radius**2)[:, None]
        half = 0.5 * dt * drag
        for _ in range(most):
            residual = max(np.abs(self.force).max(), np.abs(self.torque).max() / self.radius.max())
            if residual < AT_REST:
                break
            acceleration = self.force / self.mass[:, None]
            self.v = (self.v * (1 - half) + dt * acceleration) / (1 + half)
            self.spin = (self.spin * (1 - half) + dt * self.torque / inertia) / (1 + half)
            self.x += dt * self.v
            if np.abs(self.x - self.listed).max() > 0.4 * SKIN:
                self.find({(a, b): t for a, b, t in zip(self.i, self.j, self.t, strict=True)})
            self.evaluate(dt)
        return float(residual)


def main() -> None:
    """Prints a line per run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    parser.add_argument("--drag", type=float, default=0.2, help="in units of the run")
    parser.add_argument("--steps", type=int, default=20000, help="most steps of dynamics")
    options = parser.parse_args()
    for path in options.runs:
        run = Run(path / "run.h5/newtonian", quiet=True)
        before, state = State(run, 0), State(run, len(run.frames) - 1)
        residual = state.relax(options.drag, 0.4, options.steps)
        print(
            f"{path.name}: stress {state.stress / before.stress:.3f}, "
            f"energy {state.energy / before.energy:.3f}, greatest force {residual:.1e}"
        )


if __name__ == "__main__":
    main()
